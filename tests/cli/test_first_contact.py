"""The first five minutes: an empty folder, names instead of paths, what there is, what next."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError
from eha_bench.core.shipped import shipped_file

from .conftest import Cli


@pytest.mark.parametrize(
    "plant", ["eha_knee", pytest.param("linear_drive", marks=pytest.mark.slow)]
)
def test_a_new_project_runs_scores_and_diagnoses_at_once(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plant: str
) -> None:
    cli("init", "mine", "--plant", plant, check=0)
    monkeypatch.chdir(tmp_path / "mine")
    cli("validate", *sorted(Path().glob("*.yaml")), check=2)  # the recordings are not there yet
    cli("run", "suite.yaml", "--target", "target.yaml", check=0)
    cli("validate", *sorted(Path().glob("*.yaml")), check=0)
    step = next(line for line in Path("README.md").read_text().splitlines() if "--trial" in line)
    cli(*step.split()[1:], "--out", "scored", check=0)
    cli("calibrate", "dataset.yaml", "--out", "calibrated", check=0)
    assert Path(".github/workflows/bench.yml").is_file()
    assert "reports/" in Path(".gitignore").read_text()


def test_the_way_into_a_project_can_be_pasted(cli: Cli) -> None:
    told = cli("init", "my bench", check=0).stderr
    assert "next: cd 'my bench' && eha-bench run suite.yaml" in told


def test_init_asks_nothing_and_overwrites_nothing(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "suite.yaml").write_text("mine")
    told = cli("init", check=0).stderr
    assert "left alone: suite.yaml" in told
    assert (tmp_path / "suite.yaml").read_text() == "mine"
    assert ". already holds all files" in cli("init", check=2).stderr
    assert "did you mean 'eha_knee'?" in cli("init", "x", "--plant", "eha_nee", check=2).stderr


def test_shipped_files_go_by_name_anywhere(cli: Cli, tmp_path: Path) -> None:
    trials = json.loads(cli("run", "paper", "--dry-run", "--json", check=0).stdout)["trials"]
    assert "knee_step" in trials
    cli("run", "smoke", "--target", "physical", "--dry-run", check=0)
    (tmp_path / "mine.yaml").write_text(
        "target: simulator\nmodel: physical\ncontroller: physical\n"
    )
    cli("validate", "mine.yaml", check=0)
    cli("run", "smoke", "--target", "mine.yaml", "--dry-run", check=0)
    wrong = cli("run", "papr", check=2).stderr
    assert "unknown suite 'papr'" in wrong
    assert "did you mean 'paper'?" in wrong
    # a folder of that name, as an earlier --out made, is no suite and hides none
    (tmp_path / "smoke").mkdir()
    cli("run", "smoke", "--dry-run", check=0)
    # a file of that name comes first
    (tmp_path / "paper").write_text("name: own\ntrials: []\n")
    assert "paper:2, key 'trials'" in cli("run", "paper", check=2).stderr


def test_what_there_is_can_be_listed(cli: Cli) -> None:
    wanted = {
        "suites": "paper", "metrics": "settling_time", "effects": "entrained_air",
        "plants": "linear_drive", "targets": "simulator", "signals": "multisine",
    }  # fmt: skip
    for kind, name in wanted.items():
        assert f"\n{name} " in cli("list", kind, check=0).stdout
        found = json.loads(cli("list", kind, "--json", check=0).stdout)[kind]
        assert name in [item["name"] for item in found]
        assert all(item["description"] for item in found)
    assert "did you mean 'metrics'?" in cli("list", "metric", check=2).stderr


def test_a_bare_command_shows_what_to_do_next(cli: Cli) -> None:
    told = cli(check=0).stdout
    commands = [line.split("  ")[1] for line in told.splitlines() if line.startswith("  eha-bench")]
    assert len(commands) == 3
    for command in commands:
        assert "Usage" in cli(*command.split()[1:2], "-h", check=0).stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("eha-bench run pa", "paper"),
        ("eha-bench run ", "tiny.yaml"),
        ("eha-bench run paper --target ph", "physical"),
        ("eha-bench score log.mcap --suite tiny.yaml --trial h", "hold"),
        ("eha-bench list eff", "effects"),
        ("eha-bench schema chan", "channels"),
        ("eha-bench init --plant li", "linear_drive"),
    ],
)
def test_a_shell_completes_names(suite: Path, words: str, expected: str) -> None:
    environment = {
        **os.environ,
        "_EHA_BENCH_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    done = subprocess.run(
        [str(Path(sys.executable).with_name("eha-bench"))],
        env=environment, cwd=suite.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert expected in done.stdout.split()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "target.yaml"), "target.yaml:1: this is a target, and a suite is expected"),
        (("run", "model.yaml"), "model.yaml:1: this is a model, and a suite is expected"),
        (("run", "suite.yaml", "--target", "suite.yaml"), "suite.yaml:1: this is a suite, and a "
         "target or a model is expected"),
        (("run", "suite.yaml", "--target", "channels.yaml"), "this is a channel map"),
        (("diagnose", "suite.yaml", "--out", "x"), "this is a suite, and a dataset is expected"),
        (("diagnose", "model.yaml", "--out", "x"), "this is a model, and a dataset is expected"),
        (("predict", "dataset.yaml", "--model", "target.yaml", "--out", "x"), "this is a target"),
        (("score", "logs/example.csv", "--suite", "suite.yaml", "--channels", "model.yaml"),
         "this is a model, and a channel map is expected"),
    ],
)  # fmt: skip
def test_a_file_of_another_kind_is_called_so(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    cli("init", check=0)
    (tmp_path / "dataset.yaml").write_text(
        "model: model.yaml\ninputs: [current_command]\nruns: [{log: logs/example.csv}]\n"
    )
    assert message in cli(*words, check=2).stderr


def test_all_mistakes_of_a_file_are_told(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(
        """\
name: s
defaults:
  mode: pressure
  sped: 3
trials:
  - id: a
    durtion: 1 s
    signal: {kind: step, final: 1 mm}
    accept: {overshot: <= 4 %, rise_time: <= 3 A}
    safety: {pressure_c: <= 3 MPa}
  - id: b
    signal: {kind: sine, amplitude: 1 MPa, frequency: 3 Hz, cycles: 2}
    accept: {overshoot: <= 3 %}
"""
    )
    told = cli("validate", "s.yaml", check=2).stderr.splitlines()
    assert sorted(int(line.split(":")[2].partition(",")[0]) for line in told) == [
        4, 7, 8, 9, 9, 10, 13,
    ]  # fmt: skip
    done = cli("run", "s.yaml", check=2).stderr.splitlines()
    assert len(done) == 6
    assert "2 more: eha-bench validate lists all" in done[-1]
    found = json.loads(cli("validate", "s.yaml", "--json", check=2).stdout)["files"][0]
    assert len(found["errors"]) == 7
    assert found["error"] == found["errors"][0]


def test_controllers_extend_one_another(tmp_path: Path) -> None:
    base = tmp_path / "base.yaml"
    base.write_text(
        "extends: physical\npressure: {k_p: 3 A/MPa}\njoint_angle: {profile: {rate: 30 1/s}}\n"
    )
    own = tmp_path / "own.yaml"
    own.write_text("extends: base.yaml\npressure:\n  k_i: 90 A/(MPa*s)\n")
    found = load_controllers(own)
    physical = load_controllers(shipped_file("controllers/physical.yaml"))
    gains = found.by_mode["pressure"].gains
    assert (gains.k_p, gains.k_i) == (pytest.approx(3e-6), pytest.approx(90e-6))
    assert gains.k_2 == pytest.approx(1.55)
    profile = found.by_mode["joint_angle"].gains.profile
    assert (profile.rate, profile.speed) == (30.0, 0.16)
    assert "motor_speed" in found.by_mode
    # a recording carries the whole: it reads without the files it came from
    (tmp_path / "alone.yaml").write_text(found.text)
    alone = load_controllers(tmp_path / "alone.yaml")
    assert {mode: spec.gains for mode, spec in alone.by_mode.items()} == {
        mode: spec.gains for mode, spec in found.by_mode.items()
    }
    assert found.sha256 != physical.sha256


def test_a_mistake_in_what_is_extended_is_told_where_it_stands(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("extends: physical\npressure:\n  k_p: 3 A\n")
    own = tmp_path / "own.yaml"
    own.write_text("extends: base.yaml\n")
    with pytest.raises(InputError, match=r"base.yaml:3, key 'pressure.k_p'.*wrong dimension"):
        load_controllers(own)
    own.write_text("extends: own.yaml\n")
    with pytest.raises(InputError, match=r"own.yaml:1, key 'extends': 'own.yaml' extends this"):
        load_controllers(own)
    own.write_text("extends: nothing.yaml\n")
    with pytest.raises(InputError, match=r"own.yaml:1, key 'extends': there is no file"):
        load_controllers(own)


def test_python_takes_dicts_where_files_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    suite = {
        "name": "quick",
        "trials": [
            {
                "id": "step",
                "mode": "pressure",
                "setup": {"piston": "locked"},
                "duration": "0.4 s",
                "signal": {"kind": "step", "final": "10 MPa"},
                "accept": {"overshoot": "<= 60 %"},
            }
        ],
    }
    target = {"target": "simulator", "model": "physical", "controller": "physical"}
    result = eb.run(suite, target)
    assert result.status == "passed"
    dataset = {
        "model": "physical",
        "inputs": ["current_command"],
        "runs": [{"log": str(result.folder / "recordings/step-0.mcap"), "piston": "locked"}],
    }
    (predicted,) = eb.predict(dataset, {"model": "eha_knee"})
    assert "pressure_a" in predicted.values
    suite["trials"][0]["accept"] = {"overshot": "<= 60 %"}
    with pytest.raises(InputError, match=r"key 'trials\.step\.accept\.overshot': unknown metric"):
        eb.run(suite)
