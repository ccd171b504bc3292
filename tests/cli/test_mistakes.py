"""Typical mistakes: each is told with file, line, key and the way out, before anything is run."""

import re
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from typer.testing import CliRunner

from eha_bench.cli.app import app

from .conftest import Cli

LOG = "t,p_ref,i_cmd,n,p_a,p_b\n0,0,0,0,6,6\n0.001,0,0,0,6,6\n"


class Mistake(NamedTuple):
    """A slip in a file of a new project, and what has to be told about it."""

    file: str
    old: str
    new: str
    key: str
    told: str
    way_out: str


TO_CURRENT = """\
    mode: current
    signal: {kind: steps, levels: [5 A, 10 A, 15 A, 8 A, 0 A], hold: 0.3 s, at: 0.1 s}
"""
TO_ANGLE = """\
    mode: joint_angle
    signal: {kind: steps, levels: [600 deg], hold: 0.3 s, at: 0.1 s}
"""

MISTAKES = [
    # --- suite.yaml: keys
    Mistake(
        "suite.yaml",
        "mode: pressure",
        "mod: pressure",
        "defaults.mod",
        "unknown key 'mod'",
        "did you mean 'mode'",
    ),
    Mistake(
        "suite.yaml",
        "duration: 0.4 s",
        "durtion: 0.4 s",
        "trials.step.durtion",
        "unknown key",
        "did you mean 'duration'",
    ),
    Mistake(
        "suite.yaml",
        "    accept:\n      resp",
        "    acept:\n      resp",
        "trials.step.acept",
        "unknown key",
        "did you mean 'accept'",
    ),
    Mistake(
        "suite.yaml",
        "trials:",
        "trails:",
        "trails",
        "is not a key of any kind of file",
        "did you mean 'trials'",
    ),
    Mistake(
        "suite.yaml",
        "mode: current",
        "mode: curent",
        "trials.stairs.mode",
        "unknown mode 'curent'",
        "current",
    ),
    Mistake(
        "suite.yaml",
        "piston: locked",
        "piston: fixed",
        "defaults.setup.piston",
        "'fixed' is not known here",
        "locked",
    ),
    # --- suite.yaml: quantities
    Mistake(
        "suite.yaml",
        "duration: 0.4 s",
        "duration: 0.4 m",
        "trials.step.duration",
        "wrong dimension",
        "dimension of s",
    ),
    Mistake(
        "suite.yaml",
        "duration: 0.4 s",
        "duration: -0.4 s",
        "trials.step.duration",
        "not greater than 0",
        "greater than 0",
    ),
    Mistake(
        "suite.yaml",
        "duration: 0.4 s",
        "duration: 0.4 sceonds",
        "trials.step.duration",
        "unknown unit 'sceonds'",
        "dimension of s",
    ),
    Mistake(
        "suite.yaml",
        "10 MPa, 20 MPa",
        "10 mm, 20 MPa",
        "trials.step.signal.final",
        "wrong dimension",
        "Pa|trial controls pressure",
    ),
    Mistake(
        "suite.yaml",
        "10 MPa, 20 MPa",
        "ten MPa, 20 MPa",
        "trials.step.signal.final",
        "not a number with a unit",
        "Pa",
    ),
    Mistake(
        "suite.yaml",
        "frequency: 4 Hz",
        "frequency: 4 rad",
        "trials.sine.signal.frequency",
        "wrong dimension",
        "Hz",
    ),
    Mistake(
        "suite.yaml",
        "frequency: 4 Hz",
        "frequency: 600 Hz",
        "trials.sine.sample_rate",
        "reaches 600 Hz",
        "more than twice",
    ),
    # --- suite.yaml: signals
    Mistake(
        "suite.yaml",
        "kind: sine",
        "kind: sinus",
        "trials.sine.signal.kind",
        "unknown signal 'sinus'",
        "did you mean 'sine'",
    ),
    Mistake(
        "suite.yaml",
        "{kind: sine, ",
        "{",
        "trials.sine.signal.kind",
        "key 'kind' is missing",
        "known: ",
    ),
    Mistake(
        "suite.yaml",
        "amplitude: 5 MPa",
        "amplitde: 5 MPa",
        "trials.sine.signal.amplitde",
        "unknown key",
        "did you mean 'amplitude'",
    ),
    Mistake(
        "suite.yaml",
        "{kind: step, final",
        "{kind: step, to",
        "trials.step.signal.to",
        "unknown key 'to'",
        "known: |did you mean",
    ),
    Mistake(
        "suite.yaml",
        "levels: [5 A, 10 A, 15 A, 8 A, 0 A]",
        "levels: []",
        "trials.stairs.signal.levels",
        "is empty",
        "at least 1",
    ),
    Mistake(
        "suite.yaml",
        "    duration: 0.4 s\n",
        "",
        "trials.step.duration",
        "key 'duration' is missing",
        "duration: 1 s",
    ),
    Mistake(
        "suite.yaml",
        TO_CURRENT,
        TO_ANGLE,
        "trials.stairs.signal.levels.0",
        "600 deg cannot be reached",
        "ask for less",
    ),
    Mistake(
        "suite.yaml",
        "setup: {piston: locked}",
        "setup: {initial: {joint_angle: 500 deg}}",
        "defaults.setup.initial.joint_angle",
        "500 deg cannot be reached",
        "ask for less",
    ),
    # --- suite.yaml: limits
    Mistake(
        "suite.yaml",
        "overshoot: <=",
        "overshot: <=",
        "trials.step.accept.overshot",
        "unknown metric",
        "did you mean 'overshoot'",
    ),
    Mistake(
        "suite.yaml",
        "<= 60 ms",
        "60 ms",
        "trials.step.accept.response_time",
        "is not a limit",
        "write '<=",
    ),
    Mistake(
        "suite.yaml",
        "<= 60 ms",
        "<= 60 MPa",
        "trials.step.accept.response_time",
        "wrong dimension",
        "dimension of s",
    ),
    Mistake(
        "suite.yaml",
        "phase_lag: <= 60 deg",
        "overshoot: <= 5 %",
        "trials.sine.accept.overshoot",
        "needs a step",
        "remove the limit",
    ),
    Mistake(
        "suite.yaml",
        "phase_lag: <= 60 deg",
        "bandwidth_3db: '>= 5 Hz'",
        "trials.sine.accept.bandwidth_3db",
        "needs a sweep",
        "remove the limit",
    ),
    Mistake(
        "suite.yaml",
        "<= 40 %",
        "50 % .. 40 %",
        "trials.step.accept.overshoot",
        "accepts no value",
        "lower bound is above",
    ),
    Mistake(
        "suite.yaml",
        "{pressure_a: <= 60 MPa}",
        "{presure_a: <= 60 MPa}",
        "defaults.safety.presure_a",
        "unknown channel",
        "did you mean 'pressure_a'",
    ),
    Mistake(
        "suite.yaml",
        "- id: sine",
        "- id: stairs",
        "trials.stairs.id",
        "two trials are called 'stairs'",
        "its own id",
    ),
    Mistake(
        "suite.yaml",
        "- id: sine",
        "- id: a/b",
        "trials.a/b.id",
        "cannot be a file name",
        "use letters",
    ),
    Mistake(
        "suite.yaml",
        '"${pressure}"',
        '"${presure}"',
        "trials.step.signal.final",
        "unknown parameter 'presure'",
        "did you mean 'pressure'",
    ),
    Mistake(
        "suite.yaml",
        "name: knee",
        "name: knee\nmodel: modell.yaml",
        "model",
        "there is no file 'modell.yaml'",
        "relative to",
    ),
    # --- target.yaml, model.yaml, controller.yaml
    Mistake(
        "target.yaml",
        "target: simulator",
        "target: simulater",
        "target",
        "unknown target 'simulater'",
        "did you mean 'simulator'",
    ),
    Mistake(
        "target.yaml",
        "model: model.yaml",
        "model: models.yaml",
        "model",
        "there is no file 'models.yaml'",
        "relative to",
    ),
    Mistake(
        "target.yaml",
        "controller: controller.yaml",
        "controler: controller.yaml",
        "controler",
        "unknown key",
        "did you mean 'controller'",
    ),
    Mistake(
        "model.yaml",
        "eha_knee",
        "eha_nee",
        "model",
        "unknown plant 'eha_nee'",
        "did you mean 'eha_knee'",
    ),
    Mistake(
        "model.yaml",
        "rotor_inertia: 0.0",
        "rotor_inerta: 0.0",
        "parameters.rotor_inerta",
        "rotor_inerta",
        "did you mean 'rotor_inertia'",
    ),
    Mistake(
        "model.yaml",
        "41 A",
        "41 V",
        "parameters.current_limit",
        "wrong dimension",
        "dimension of A",
    ),
    Mistake(
        "model.yaml",
        "effect: anti_cavitation",
        "effect: anticavitation",
        "effects.0.effect",
        "anticavitation",
        "anti_cavitation",
    ),
    Mistake(
        "model.yaml",
        "effect: anti_cavitation, charge_pressure: 0.6 MPa",
        "effect: valve_lag, charge_pressure: 0.6 MPa",
        "effects.0.effect",
        "'valve_lag' acts on a valve_drive, and eha_knee has none",
        "it has places for: anti_cavitation, ",
    ),
    Mistake(
        "model.yaml",
        "leakage, bulk",
        "leekage, bulk",
        "calibrate.3",
        "leekage",
        "did you mean 'leakage'",
    ),
    Mistake(
        "controller.yaml",
        "k_p: 5.41",
        "kp: 5.41",
        "pressure.kp",
        "unknown key 'kp'",
        "did you mean 'k_p'",
    ),
    Mistake("controller.yaml", "5.41 A/MPa", "5.41 A", "pressure.k_p", "wrong dimension", "A/Pa"),
    Mistake(
        "controller.yaml",
        "pressure_law:PressureLaw",
        "presure_law:PressureLaw",
        "pressure.controller",
        "cannot be loaded",
        "in the same folder as the file",
    ),
    Mistake(
        "controller.yaml",
        "extends: physical",
        "extends: phisical.yaml",
        "extends",
        "there is no file",
        "relative to",
    ),
    # --- channels.yaml, dataset.yaml
    Mistake(
        "channels.yaml",
        "unit: rpm",
        "unit: rpn",
        "channels.motor_speed.unit",
        "unknown unit 'rpn'",
        "rad/s",
    ),
    Mistake(
        "channels.yaml",
        "{column: p_a, unit: bar}",
        "{column: p_a, unit: A}",
        "channels.pressure_a.unit",
        "wrong dimension",
        "Pa",
    ),
    Mistake(
        "channels.yaml",
        "{column: i_cmd",
        "{colum: i_cmd",
        "channels.current_command.colum",
        "unknown key 'colum'",
        "did you mean 'column'",
    ),
    Mistake(
        "dataset.yaml",
        "use: holdout",
        "use: holdot",
        "runs.3.use",
        "'holdot' is not known",
        "holdout",
    ),
    Mistake("dataset.yaml", "model: model.yaml", "model: modl.yaml", "model", "modl.yaml", "there"),
    Mistake(
        "dataset.yaml",
        "inputs: [current_command]",
        "inputs: [curent_command]",
        "inputs.0",
        "curent_command",
        "did you mean 'current_command'",
    ),
    Mistake(
        "dataset.yaml", "stairs-0.mcap", "stiars-0.mcap", "runs.0.log", "stiars-0.mcap", "there"
    ),
]


@pytest.fixture(scope="module")
def new_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new project, with files where its recordings will be."""
    folder = tmp_path_factory.mktemp("project")
    assert CliRunner().invoke(app, ["init", str(folder)]).exit_code == 0
    for name in re.findall(r"log: (\S+?),", (folder / "dataset.yaml").read_text()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(LOG)
    return folder


@pytest.fixture
def project(new_project: Path, tmp_path: Path) -> Path:
    """The new project, to make a mistake in."""
    return Path(shutil.copytree(new_project, tmp_path, dirs_exist_ok=True))


@pytest.mark.parametrize(
    "mistake", MISTAKES, ids=[f"{m.file[:-5]}-{m.key}-{i}" for i, m in enumerate(MISTAKES)]
)
def test_a_typical_mistake_is_told_with_its_place_and_the_way_out(
    cli: Cli, project: Path, mistake: Mistake
) -> None:
    path = project / mistake.file
    text = path.read_text(encoding="utf-8")
    assert mistake.old in text, "the project has changed: this is not a mistake any more"
    wrong = text.replace(mistake.old, mistake.new, 1)
    path.write_text(wrong, encoding="utf-8")
    command = ["validate", mistake.file]
    if mistake.file == "controller.yaml":  # whose code validate does not load
        command = ["run", "suite.yaml", "--target", "target.yaml", "--dry-run"]
    told = cli(*command, check=2).stderr
    first = told.splitlines()[0]
    place = re.match(rf"eha-bench: \S*{re.escape(mistake.file)}:(\d+), key '([^']+)': ", first)
    assert place, first
    assert place[2] == mistake.key, first
    assert mistake.told in first
    assert re.search(mistake.way_out, first[place.end() :]), first
    # the line holds what was written, or what lacks it
    changed = {
        number
        for number, line in enumerate(wrong.splitlines(), 1)
        if line not in text.splitlines() or mistake.old not in line
    }
    assert int(place[1]) in changed


def test_there_are_at_least_forty() -> None:
    assert len(MISTAKES) >= 40


SWEEP = ("sweep", "suite.yaml", "--over", "mine.yaml")
TUNE = ("tune", "suite.yaml", "--model", "model.yaml", "--vary", "mine.yaml", "--out", "out")


@pytest.mark.parametrize(
    ("text", "command", "place", "way_out"),
    [
        ("over:\n  gains: {pressure.k_q: [1, 2]}\n", SWEEP,
         "mine.yaml:2, key 'over.gains.pressure.k_q'", "did you mean 'pressure.k_p'"),
        ("over:\n  parameters: {bulk_modulis: [7e8]}\n", SWEEP,
         "mine.yaml:2, key 'over.parameters.bulk_modulis'", "did you mean 'bulk_modulus'"),
        ("over:\n  parameters: {bulk_modulus: {from: 7 MPa, to: 9 mm, steps: 3}}\n", SWEEP,
         "mine.yaml:2, key 'over.parameters.bulk_modulus.to'", "dimension of Pa"),
        ("over:\n  trials: {stop.duration: [1 s]}\n", SWEEP,
         "mine.yaml:2, key 'over.trials.stop.duration.0'", "did you mean 'step'"),
        ("vary:\n  pressure.k_p: {from: 9 A/MPa, to: 3 A/MPa}\n", TUNE,
         "mine.yaml:2, key 'vary.pressure.k_p.to'", "let 'to' be greater than 'from'"),
        ("vary:\n  pressure.k_p: 3 A/MPa\n", TUNE,
         "mine.yaml:2, key 'vary.pressure.k_p'", "give a range {from, to}, or a list"),
        ("vary: {}\n", TUNE, "mine.yaml:1, key 'vary'", "at least 1"),
        ("send: ftp://host/x\n", ("validate", "mine.yaml"),
         "mine.yaml:1, key 'send'", "begins with http:// or https://"),
        ("send: mail\nwhen: sometimes\n", ("validate", "mine.yaml"),
         "mine.yaml:2, key 'when'", "known: drifted, always"),
        ("", ("next", "dataset.yaml", "--out", "next.yaml"),
         "dataset.yaml", "give the folder that `eha-bench diagnose --out` wrote"),
        ("", ("run", "suite.yaml", "--target", "target.yaml", "--posterior", "model.yaml"),
         "model.yaml", "give the file that `diagnose` or `calibrate` wrote"),
        ("over:\n  gains: {pressure.k_p: [1 A/MPa, 2 A/MPa]}\n",
         ("run", "suite.yaml", "--target", "target.yaml", "--posterior", "model.yaml",
          "--conditions", "mine.yaml", "--out", "out"),
         "mine.yaml:2, key 'over.gains'", "name them under 'over: parameters:'"),
        ("over:\n  gains: {pressure.k_p: {from: 3 A/MPa, to: 9 A/MPa, steps: 0}}\n", SWEEP,
         "mine.yaml:2, key 'over.gains.pressure.k_p.steps'", "greater than or equal to 2"),
        ("design: sobel\npoints: 8\nover:\n  gains: {pressure.k_p: [3, 4]}\n", SWEEP,
         "mine.yaml:1, key 'design'", "known: grid, latin_hypercube, sobol"),
        ("over:\n  gains: {pressure.k_p: [3 A/MPa, 3 A/MPa]}\n", SWEEP,
         "mine.yaml:2, key 'over.gains.pressure.k_p'", "give each value once"),
        ("vary:\n  pressure.k_p: {from: 3 MPa, to: 9 MPa}\n", TUNE,
         "mine.yaml:2, key 'vary.pressure.k_p.from'", "dimension of A/Pa"),
        ("trials:\n- id: a\n  mode: current\n  duration: 1 s\n"
         "  signal: {kind: constant, value: 0 A}\n"
         "  setup: {initial: {piston_position: 5 m}}\n",
         ("run", "mine.yaml", "--target", "target.yaml", "--out", "out"),
         "mine.yaml:6, key 'trials.a.setup.initial.piston_position'", "between -0.04 and 0.04 m"),
        ("", ("history", "nowhere"), "nowhere", "give a folder of result folders"),
        ("", ("before-after", "nowhere", "elsewhere"), "nowhere", "give the folders that"),
        ("", ("channels", "nothing.csv"), "nothing.csv", "check its path"),
        ("", ("tune", "suite.yaml", "--model", "suite.yaml", "--vary", "mine.yaml", "--out", "out"),
         "suite.yaml:1", "a model.yaml with 'model:'"),
        ("", ("compare", "nowhere", "reports"), "nowhere", "give a result folder"),
        ("", ("serve", "nowhere"), "nowhere", "give a folder of result folders"),
        ("", ("recover", "logs/example.csv"), "logs/example.csv", "only MCAP files"),
        ("", ("score", "logs/example.csv", "--suite", "suite.yaml"),
         "logs/example.csv", "give a channels.yaml"),
    ],
)  # fmt: skip
def test_a_mistake_in_other_commands_is_told_with_its_place_and_the_way_out(
    cli: Cli, project: Path, text: str, command: tuple[str, ...], place: str, way_out: str
) -> None:
    (project / "mine.yaml").write_text(text, encoding="utf-8")
    told = cli(*command, check=2).stderr
    assert f"eha-bench: {place}: " in told
    assert way_out in told
    assert not (project / "out").exists()


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (("rig", "suite.yaml"), "suite.yaml:1: this is a suite, and a target is expected"),
        (("close", "dataset.yaml", "--target", "nosuch", "--out", "out"),
         "eha-bench: unknown target 'nosuch'"),
        (("next", "diagnosis", "--out", "next.yaml", "--budget", "5m"),
         "eha-bench: --budget '5m': unit 'm' has the wrong dimension"),
    ],
)  # fmt: skip
def test_a_wrong_option_is_named_before_anything_is_run(
    cli: Cli, project: Path, command: tuple[str, ...], told: str
) -> None:
    assert told in cli(*command, check=2).stderr
    assert not (project / "out").exists()


@pytest.mark.parametrize(
    ("text", "place", "way_out"),
    [
        ("name: x\ntrials:\n\t- id: a\n", "mine.yaml:3", "indent with spaces, not with tabs"),
        ("name: x\nname: y\n", "mine.yaml:2", "give each key once"),
        ("name: `x`\n", "mine.yaml:1", "put the text into quotes"),
        ("name: x: y\n", "mine.yaml:1", "quote text with ': '"),
        ("trials: [{id: a}\n", "mine.yaml:2", "close every [, { and quote"),
        ("name: *x\n", "mine.yaml:1", "put text that begins with * into quotes"),
        (
            "trials:\n  - {id: a, signal: {kind: step, final: ${p}, at: 1 ms}}\n",
            "mine.yaml:2",
            'put a parameter within braces into quotes: "${p}"',
        ),
        (
            "trials:\n  - {id: a, mode: pressure, duration: 1 s,\n"
            "     signal: {kind: step, final: 10,5 MPa}}\n",
            "mine.yaml:3, key 'trials.a.signal.5 MPa'",
            "a comma parts keys: write a number with a point",
        ),
        (
            "plant: x\nnodes: {s: {kind: rotation, inertia: 1 kg*m^2}}\n"
            "elements: {m: {kind: motor, on: s}}\n",
            "mine.yaml:3, key 'elements.m'",
            "a motor needs 'torque_constant'; add 'torque_constant: ... N*m/A'",
        ),
        ("", "mine.yaml", "'eha-bench init' writes files to start from"),
        ("name: knee/one\ntrials: []\n", "mine.yaml:1, key 'name'", "use letters, digits"),
        ("safety:\n  p: >= 60 MPa <= 2 MPa\n", "mine.yaml:2", "put the text into quotes"),
        ("name: \udcff\n", "mine.yaml", "an editor saves another encoding as UTF-8"),
        (
            "name: x\ntrials: [{id: a, repeats: many}]\n",
            "mine.yaml:2, key 'trials.a.repeats'",
            "'many' should be a whole number",
        ),
        (
            "name: x\ntrials: [{id: a, duration: '0,4 s'}]\n",
            "mine.yaml:2, key 'trials.a.duration'",
            "'0,4 s' has a comma; write 0.4 with a point",
        ),
        ("words, " * 99, "mine.yaml:1", "the kind is given by one of these keys"),
    ],
)
def test_a_slip_of_yaml_comes_with_the_way_out(
    cli: Cli, tmp_path: Path, text: str, place: str, way_out: str
) -> None:
    (tmp_path / "mine.yaml").write_bytes(text.encode("utf-8", "surrogateescape"))
    told = cli("validate", "mine.yaml", check=2).stderr
    assert f"eha-bench: {place}: " in told
    assert way_out in told


@pytest.mark.parametrize(
    ("limit", "remark"),
    [
        ("response_time: <= 45", "'<= 45' is 45 s, and the trial lasts 0.4 s; write the unit"),
        ("response_time: {max: 45, repeats: median}", "is 45 s, and the trial lasts 0.4 s"),
        ("overshoot: <= 40", "'<= 40' is 4000 %; write the unit, as in '40 %'"),
        ("response_time: <= 0.045", ""),
        ("response_time: <= 45 s", ""),
        ("response_time: <= 45 ms with 95 % confidence", ""),
        ("overshoot: <= 0.4", ""),
        ("overshoot: <= 400 %", ""),
        ("steady_state_error: <= 45", ""),
    ],
)
def test_a_limit_without_its_unit_is_remarked_on(
    cli: Cli, tmp_path: Path, limit: str, remark: str
) -> None:
    (tmp_path / "mine.yaml").write_text(
        "trials:\n  - id: a\n    mode: pressure\n    duration: 0.4 s\n"
        f"    signal: {{kind: step, final: 10 MPa}}\n    accept: {{{limit}}}\n"
    )
    told = cli("validate", "mine.yaml", check=0).stderr
    assert "mine.yaml: a valid suite" in told
    if remark:
        assert f"mine.yaml: trial 'a': {limit.partition(':')[0]}: " in told
    assert told.count("\n") == 1 + bool(remark)
    assert remark in told


@pytest.mark.parametrize(
    ("within", "remark"),
    [
        ("20", "within 20, 133 times its value of 0.15 (SI); a share is written 'within: 20 %'"),
        ("20 %", ""),
        ("0.1 N*m", ""),
    ],
)
def test_a_tolerance_of_many_times_the_value_is_remarked_on(
    cli: Cli, tmp_path: Path, within: str, remark: str
) -> None:
    (tmp_path / "mine.yaml").write_text(
        "model: eha_knee\nparameters: {coulomb_torque: 0.15}\n"
        f"calibrate: [{{parameter: coulomb_torque, within: {within}}}]\n"
    )
    told = cli("validate", "mine.yaml", check=0).stderr
    assert remark in told
    assert told.count("\n") == 1 + bool(remark)


def test_a_log_given_as_a_suite_is_not_repeated_in_the_message(cli: Cli, project: Path) -> None:
    told = cli("run", "logs/example.csv", check=2).stderr
    assert told.startswith("eha-bench: logs/example.csv:1: expected keys and values")
    assert len(told) < 200


def test_a_controller_without_its_method_is_refused_before_the_run(cli: Cli, project: Path) -> None:
    # a module name of its own: Python keeps those it has imported
    law = (project / "pressure_law.py").read_text(encoding="utf-8").replace("def step", "def setp")
    (project / "law_without_step.py").write_text(law, encoding="utf-8")
    gains = project / "controller.yaml"
    gains.write_text(
        gains.read_text(encoding="utf-8").replace("pressure_law:", "law_without_step:")
    )
    told = cli("run", "suite.yaml", "--target", "target.yaml", "--out", "out", check=2).stderr
    assert "controller.yaml:5, key 'pressure.controller': " in told
    assert "does not define step; write the method, or rename 'setp'" in told
    assert not (project / "out").exists()


def test_another_file_in_place_of_a_result_is_refused(cli: Cli, project: Path) -> None:
    told = cli("compare", "suite.yaml", "suite.yaml", check=2).stderr
    assert "eha-bench: suite.yaml: not a result; give the result.json that" in told


def test_a_log_that_is_not_there_names_how_to_make_one(cli: Cli, project: Path) -> None:
    log = next(project.glob("reports/**/stairs-0.mcap"))
    log.unlink()
    told = cli("validate", "dataset.yaml", check=2).stderr
    assert re.search(r"dataset\.yaml:\d+, key 'runs\.\d\.log': ", told)
    assert "`eha-bench run` makes recordings" in told


@pytest.mark.parametrize(
    ("command", "interrupted"),
    [
        (("run", "paper"), "eha_bench.api.run"),
        (("next", "diagnosis", "--out", "next.yaml"), "eha_bench.api.next_experiment"),
        (("diagnose", "dataset.yaml", "--out", "d"), "eha_bench.api.diagnose"),
        (("calibrate", "dataset.yaml", "--out", "d"), "eha_bench.diagnosis.calibrate.calibrate"),
        (("close", "dataset.yaml", "--target", "rig.yaml", "--out", "d"), "eha_bench.rounds.close"),
    ],
)
def test_ctrl_c_before_anything_is_done_is_said(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], interrupted: str
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(interrupted, stop)
    told = cli(*command, check=130).stderr
    goes_on = "; the same command goes on from here" if command[0] == "close" else ""
    assert told == f"eha-bench: interrupted{goes_on}\n"
