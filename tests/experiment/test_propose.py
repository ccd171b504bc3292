"""From a diagnosis that left two causes open to a suite that tells them."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from experiment_question import LOCKED, NOISE, rival, write_question

import eha_bench as eb
from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError
from eha_bench.core.limit import Bounds
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.beliefs import Belief
from eha_bench.diagnosis.outcome.beyond_training import SHOWN_BY_HELD_OUT
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.describe import width_words
from eha_bench.experiment.hypothesis import _with_doubt, read_question
from eha_bench.experiment.permitted import Limit, permitted_ranges
from eha_bench.experiment.proposal import ProposalEnding
from eha_bench.experiment.response import Bench, _room, predicted_readings
from eha_bench.plants.plant import Drive
from eha_bench.suites import load_suite
from eha_bench.targets.simulator import Simulator
from spindle_plant import SPINDLE

DELAY = ("command_delay", {"delay": 2e-3})
LAG = ("current_lag", {"time_constant": 2e-3})


@pytest.fixture(scope="module")
def proposed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("next")
    write_question(folder / "diagnosis", [rival(*DELAY), rival(*LAG)])
    eb.next_experiment(folder / "diagnosis", folder / "next.yaml", budget=3.0)
    return folder


def test_two_causes_are_told_apart_by_a_suite_that_loads(proposed: Path):
    figures = json.loads((proposed / "next.json").read_text())
    assert figures["ending"] == "proposed"
    assert figures["probability_right"] >= 0.95
    assert figures["probability_wrong"] <= 0.02
    assert figures["bench_seconds"] <= 3.0
    suite = load_suite(proposed / "next.yaml")
    assert sum(trial.duration for trial in suite.trials) == pytest.approx(figures["bench_seconds"])
    assert all(trial.setup.piston == "locked" for trial in suite.trials)
    page = (proposed / "next.html").read_text()
    assert "command_delay" in page
    assert "current_lag" in page
    scene = re.search(r'class="scene">(.*?)</script>', page)
    assert scene is not None
    command = json.loads(scene[1])["panels"][0]
    assert (command["heading"], command["unit"]) == ("Command", "A")
    assert "http" not in page.split("<body", 1)[1].split("</main>", maxsplit=1)[0].replace(
        "http://www.w3.org", ""
    )


def test_the_separation_begins_with_the_command(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*DELAY), rival(*LAG)])
    (trial, *_) = eb.next_experiment(folder, budget=1.0).trials
    moves = int(np.flatnonzero(trial.reference)[0])
    # nothing tells them apart before, nor is it drawn as if something did
    assert moves > 0
    assert trial.parts[:moves].max() < 1e-6 * trial.parts[-1]
    assert (np.diff(trial.parts) >= -1e-6 * trial.parts[-1]).all()


@pytest.mark.parametrize("truth", [DELAY, LAG])
def test_the_suite_keeps_every_limit_when_either_cause_is_the_true_one(proposed: Path, truth):
    suite = load_suite(proposed / "next.yaml")
    rig = Simulator(rival(*truth).model, load_controllers(shipped_file("controllers/paper.yaml")))
    for trial in suite.trials:
        assert trial.safety
        outcome = rig.run(trial, 0)
        assert outcome.ending == "complete", outcome.reason
        low, high = LOCKED["current_command"]
        assert Bounds(low, high).holds(float(np.abs(outcome.recording["current_command"]).max()))


@pytest.mark.slow
def test_no_draw_of_a_wide_posterior_breaks_a_tight_limit(tmp_path: Path):
    # limits that only a small experiment keeps, and parameters that may be off by a third
    tight = {**LOCKED, "pressure_a": (-1e6, 1e6), "pressure_b": (-1e6, 1e6)}
    rivals = [rival(*DELAY, share=0.15), rival(*LAG, share=0.15)]
    folder = write_question(tmp_path, rivals, extremes=tight, unexplained={"pressure_a": 2e4})
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=2.0)
    assert found.ending is ProposalEnding.PROPOSED
    assert max(room.used for trial in found.trials for room in trial.rooms) > 0.2
    rng = np.random.default_rng(8)
    for trial in load_suite(tmp_path / "next.yaml").trials:
        clock = trial.clock()
        drive = Drive(clock, {"current_command": trial.reference(clock)}, locked=True)
        known = read_question(folder).rivals
        vectors = [item.at(rng.standard_normal((100, len(item.keys)))) for item in known]
        for readings in predicted_readings(known, vectors, drive):
            names = known[0].model.plant.outputs
            for name in ("pressure_a", "pressure_b", "motor_speed"):
                values = readings[:, :, names.index(name)]
                values = values + NOISE[name] * rng.standard_normal(values.shape)
                beyond = 4.0 * NOISE[name]
                low, high = tight[name][0] - beyond, tight[name][1] + beyond
                assert values.min() >= low
                assert values.max() <= high


def test_a_dataset_takes_what_the_suite_records(proposed: Path):
    eb.run(proposed / "next.yaml", target="physical", out=proposed / "next-run")
    dataset = load_dataset(proposed / "next-dataset.yaml")
    assert [run.locked for run in dataset.training] == [True] * len(dataset.training)
    assert "pressure_a" in dataset.training[0].read()


@pytest.mark.slow
def test_what_nothing_measured_tells_apart_asks_for_a_sensor(tmp_path: Path):
    # a sensor's offset moves nothing but its own reading
    offsets = [rival("pressure_sensor_offset", {"offset": 1e5}), rival(None)]
    for item in offsets:
        assert item.model.plant.id == "eha_knee"
    folder = write_question(tmp_path, offsets, noise={"motor_speed": 0.1})
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=2.0)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert found.sensor is not None
    assert found.sensor.channel.startswith("pressure")
    assert found.sensor.right > 0.9
    assert found.sensor.channel in found.sentence
    assert not (tmp_path / "next.yaml").exists()


def test_one_rival_that_is_well_known_leaves_nothing_open(tmp_path: Path):
    found = eb.next_experiment(write_question(tmp_path, [rival(*LAG)]))
    assert found.ending is ProposalEnding.NOTHING_OPEN
    assert "nothing is open" in found.sentence


@pytest.mark.parametrize(
    ("equation", "variables", "says"),
    [
        (None, [], "was not located"),
        ("torque", [], "in the torque balance follows no curve of one logged channel"),
        ("torque", ["wheel_speed"], "in the torque balance depends on wheel_speed, and its curve"),
    ],
)
def test_an_unknown_without_a_model_is_not_planned_for(tmp_path: Path, equation, variables, says):
    folder = write_question(tmp_path, [rival(*LAG)])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text())
    unknown = {"equation": equation, "variables": variables, "description": ""}
    file.write_text(json.dumps(content | {"verdict": "unknown", "unknown": unknown}))
    found = eb.next_experiment(folder)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert says in found.sentence
    assert "log more channels" in found.sentence


def test_what_held_out_runs_show_is_to_be_trained_on_first(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*LAG)])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text())
    unknown = {"equation": "flow", "variables": [], "description": ""}
    note = f"{SHOWN_BY_HELD_OUT}: over short windows 'pressure_a' errs by 2.31 times its noise"
    more = {"verdict": "unknown", "unknown": unknown, "notes": [note]}
    file.write_text(json.dumps(content | more))
    found = eb.next_experiment(folder)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert "use such a run for training, and run `eha-bench diagnose` again" in found.sentence
    assert "log more channels" not in found.sentence


def test_an_unknown_that_a_curve_plays_is_still_open(tmp_path: Path):
    """Nothing is left to separate or narrow, and yet the machine has something without a name."""
    folder = write_question(tmp_path, [rival(*LAG)])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text())
    content["rivals"][0]["id"] = "learned of motor_speed"
    where = "something acts in the torque balance; a learned curve explains 95 % of the excess"
    unknown = {"equation": "torque", "variables": ["motor_speed"], "description": where}
    also = "what is missing may as well act in the actuation balance"
    content |= {"verdict": "unknown", "unknown": unknown, "notes": ["a plain note", also]}
    content["convergence"] = {"converged": True, "residual_over_floor": 1.46}
    file.write_text(json.dumps(content))
    found = eb.next_experiment(folder)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert f"{where}; {also}; the revised model still leaves 1.5 times the noise" in found.sentence
    assert "nothing is open" not in found.sentence
    assert "a plain note" not in found.sentence


def test_a_wide_interval_is_brought_under_what_is_asked(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*LAG, share=0.3)])
    found = eb.next_experiment(folder, budget=1.0, within=0.1)
    assert found.ending is ProposalEnding.PROPOSED
    assert found.odds is None
    assert max(item.before for item in found.widths) == pytest.approx(0.588, rel=0.01)
    assert max(item.after for item in found.widths) < 0.1
    assert "asked for" not in found.sentence


def test_no_experiment_is_shorter_than_a_second(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*LAG, share=0.12)])
    found = eb.next_experiment(folder, budget=3.0, within=0.2)
    assert found.ending is ProposalEnding.PROPOSED
    assert found.bench_seconds >= 1.0


def test_no_parameter_is_narrowed_while_something_has_no_name(tmp_path: Path):
    """A motor that warms up: better known friction tells nothing of it."""
    curve = replace(rival(*LAG, share=0.3), cause="learned of time")
    folder = write_question(tmp_path, [curve])
    file = folder / "diagnosis.json"
    described = "something acts in the actuation balance, at motor, and depends on time"
    unknown = {"equation": "actuation", "description": described, "variables": ["time"]}
    content = json.loads(file.read_text()) | {"verdict": "unknown", "unknown": unknown}
    file.write_text(json.dumps(content | {"complete": True}))
    found = eb.next_experiment(folder)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert described in found.sentence
    assert "declare what the plant lacks there" in found.sentence


def test_a_warning_of_the_diagnosis_is_not_kept_back(tmp_path: Path):
    folder = write_question(tmp_path, [rival(None)])
    file = folder / "diagnosis.json"
    moved = "leakage has moved from 3e-12 to 8e-12 m^3/(s*Pa), more than given under `within`"
    content = json.loads(file.read_text()) | {"notes": ["a plain note", f"CAUTION: {moved}"]}
    file.write_text(json.dumps(content))
    found = eb.next_experiment(folder)
    assert found.ending is ProposalEnding.NOTHING_OPEN
    assert found.sentence.endswith(f"; check what the diagnosis warns of: {moved}")


@pytest.mark.parametrize(("ended", "said"), [
    ({"converged": False, "residual_over_floor": 1.0}, "its calibration has not converged"),
    ({"converged": True, "residual_over_floor": 3.8},
     "its model leaves 3.8 times the noise unexplained, in the flow balance"),
])  # fmt: skip
def test_no_interval_is_narrowed_that_the_diagnosis_does_not_give(
    tmp_path: Path, ended: dict[str, object], said: str
):
    folder = write_question(tmp_path, [rival(*LAG, share=0.3)])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text()) | {"convergence": ended}
    content["remainder"] = {"equation": "flow", "share": 0.4}
    file.write_text(json.dumps(content))
    found = eb.next_experiment(folder, budget=1.0)
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert said in found.sentence


def test_an_interval_that_stays_wider_than_asked_is_said_to(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*LAG, share=0.3)])
    found = eb.next_experiment(folder, budget=1.0, within=1e-6)
    assert found.ending is ProposalEnding.PROPOSED
    assert "more than the 0.00 % asked for" in found.sentence


@pytest.mark.slow
def test_the_same_seed_proposes_the_same(proposed: Path, tmp_path: Path):
    again = eb.next_experiment(proposed / "diagnosis", tmp_path / "next.yaml", budget=3.0)
    assert (tmp_path / "next.yaml").read_text() == (proposed / "next.yaml").read_text()
    assert again.odds is not None


@pytest.mark.slow
def test_a_plant_of_channels_that_nobody_knows_gets_an_experiment_too(tmp_path: Path):
    servo = {"model": "geared_servo"}
    known = ("gear_friction.viscous", "gear_friction.coulomb")
    rivals = [
        rival("command_delay", {"delay": 0.02}, source=servo, known=known),
        rival("current_lag", {"time_constant": 0.02}, source=servo, known=known),
    ]
    extremes = {"duty": (-0.3, 0.3), "angle": (-3.0, 3.0), "velocity": (-9.0, 9.0)}
    folder = write_question(
        tmp_path, rivals, noise={"angle": 6e-4, "velocity": 8e-3}, extremes=extremes,
        command="duty", piston="free",
    )  # fmt: skip
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=2.0)
    assert found.ending is ProposalEnding.PROPOSED
    (trial, *_) = load_suite(tmp_path / "next.yaml").trials
    assert {limit.channel for limit in trial.safety} == {"angle", "velocity"}
    rig = Simulator(rivals[1].model, load_controllers(shipped_file("controllers/paper.yaml")))
    assert rig.run(trial, 0).ending == "complete"


# --- what is permitted ------------------------------------------------------------------------


def test_without_a_safety_file_nothing_goes_beyond_what_was_recorded(tmp_path: Path):
    question = read_question(write_question(tmp_path, [rival(*LAG)]))
    plant = question.rivals[0].model.plant
    found = permitted_ranges(
        plant, Commanded.of(question), [question.rivals[0].vector], question.covered, None
    )
    ((setup, limits),) = found.limits.items()
    assert setup == ("locked", "closed")
    assert (found.command[setup].low, found.command[setup].high) == LOCKED["current_command"]
    low, high = LOCKED["motor_speed"]
    assert limits["motor_speed"].high == pytest.approx(high + 4.0 * NOISE["motor_speed"])
    assert limits["motor_speed"].low == pytest.approx(low - 4.0 * NOISE["motor_speed"])


def test_a_suite_permits_its_setups_within_its_safety_limits(tmp_path: Path):
    question = read_question(write_question(tmp_path, [rival(*LAG)]))
    suite = tmp_path / "safe.yaml"
    suite.write_text(
        "name: safe\ndefaults: {safety: {motor_speed: -50 rad/s .. 60 rad/s}}\ntrials:\n"
        "  - {id: a, mode: current, duration: 1 s, setup: {bypass: open},\n"
        "     signal: {kind: constant, value: 1 A}, safety: {motor_speed: <= 40 rad/s}}\n"
        "  - {id: b, mode: current, duration: 1 s, signal: {kind: constant, value: 1 A}}\n"
    )
    vector = question.rivals[0].vector
    found = permitted_ranges(
        question.rivals[0].model.plant, Commanded.of(question), [vector], question.covered, suite
    )
    assert set(found.limits) == {("free", "open"), ("free", "closed")}
    for limits in found.limits.values():
        assert (limits["motor_speed"].low, limits["motor_speed"].high) == (-50.0, 40.0)
        assert limits["piston_position"].high == pytest.approx(0.04, rel=1e-3)


def test_a_motor_without_a_limit_is_driven_as_far_as_it_has_been(tmp_path: Path):
    plant = tmp_path / "plant.yaml"
    plant.write_text(SPINDLE.replace(", current_limit: 41 A", ""))
    item = rival(None, source=str(plant), known=("drag.coulomb",))
    folder = write_question(
        tmp_path / "diagnosis", [item], noise={"motor_speed": 0.3}, piston="free",
        extremes={"current_command": (-8.0, 6.0), "motor_speed": (-100.0, 100.0)},
    )  # fmt: skip
    question = read_question(folder)
    suite = tmp_path / "safe.yaml"
    suite.write_text(
        "name: safe\ntrials:\n  - {id: a, mode: current_command, duration: 1 s,\n"
        "     signal: {kind: constant, value: 1 A}, safety: {motor_speed: <= 200 rad/s}}\n"
    )
    (own,) = question.rivals
    commanded = Commanded.of(question)
    assert commanded.limit == math.inf
    found = permitted_ranges(own.model.plant, commanded, [own.vector], question.covered, suite)
    ((low, high),) = {(item.low, item.high) for item in found.command.values()}
    assert (low, high) == (-8.0, 6.0)


def test_a_drive_permits_its_limits_and_what_its_fixture_can(tmp_path: Path):
    question = read_question(write_question(tmp_path, [rival(*LAG)]))
    vector = question.rivals[0].vector
    drive = Path(__file__).parents[2] / "fixtures/rig/eha_drive.yaml"
    found = permitted_ranges(
        question.rivals[0].model.plant, Commanded.of(question), [vector], question.covered, drive
    )
    assert len(found.limits) == 4
    limits = found.limits["locked", "closed"]
    assert limits["pressure_a"].rate == pytest.approx(4e9)
    assert found.command["locked", "closed"].high == pytest.approx(42.0)


def test_a_file_that_says_nothing_of_safety_is_refused(tmp_path: Path):
    question = read_question(write_question(tmp_path, [rival(*LAG)]))
    other = tmp_path / "model.yaml"
    other.write_text("model: eha_knee\n")
    with pytest.raises(InputError, match="no safety limits"):
        permitted_ranges(
            question.rivals[0].model.plant,
            Commanded.of(question),
            [question.rivals[0].vector],
            question.covered,
            other,
        )


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "cannot be read as JSON"),
        ("[]", "not a diagnosis.json"),
        ('{"verdict": "none"}', "holds no rivals"),
        ('{"verdict": "none", "rivals": [{}], "covered": {"rate": 1}}', "cannot be read"),
    ],
)
def test_what_is_no_diagnosis_is_refused(tmp_path: Path, text: str, said: str):
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(InputError, match=said):
        eb.next_experiment(tmp_path)


def test_what_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no such diagnosis"):
        eb.next_experiment(tmp_path / "nothing")
    folder = write_question(tmp_path, [rival(*LAG)])
    with pytest.raises(InputError, match="names the suite"):
        eb.next_experiment(folder, tmp_path / "next.txt")


def test_a_limit_that_no_experiment_keeps_is_named(tmp_path: Path):
    folder = write_question(tmp_path, [rival(None, share=0.5)])
    (tmp_path / "tight.yaml").write_text(
        "name: tight\ndefaults: {mode: current, setup: {piston: locked}, "
        "safety: {motor_speed: -0.01 rad/s .. 0.01 rad/s, pressure_a: <= 30 MPa}}\n"
        "trials: [{id: one, duration: 1 s, signal: {kind: step, final: 1 A}}]\n"
    )
    found = eb.next_experiment(folder, budget=2.0, safety=tmp_path / "tight.yaml")
    assert found.ending is ProposalEnding.NONE_PERMITTED
    assert re.search(
        r"the limits are those of tight.yaml\): \d+ break the limit of motor_speed, -0.01 to 0.01 "
        r"rad/s, at any size; the mildest would go from \S+ to \S+ rad/s, with noise \S+ times",
        found.sentence,
    )


@pytest.mark.parametrize(("share", "of", "said"), [
    (0.05, "its value", "± 5 % of its value"),
    (48.0, "its value", "± 48 times its value"),
    (0.05, "its usual size", "± 5 % of its usual size"),
    (0.05, "1 rad", "± 0.05 rad"),
])  # fmt: skip
def test_an_interval_says_what_it_is_a_share_of(share: float, of: str, said: str):
    assert width_words(share, of) == said


def test_a_dataset_without_the_old_recordings_says_so(proposed: Path):
    # the question of this test names no dataset
    text = (proposed / "next-dataset.yaml").read_text()
    assert "those of the diagnosis are not there any more" in text


def test_trials_begin_where_the_recordings_do(tmp_path: Path):
    """A rod that stands half a stroke out is nearer to its end than one that stands at 0."""
    extremes = {**LOCKED, "piston_position": (0.012, 0.028)}
    folder = write_question(
        tmp_path, [rival(*DELAY), rival(*LAG)], piston="free", extremes=extremes,
        starts={"piston_position": 0.02},
    )  # fmt: skip
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=2.0)
    assert found.ending is ProposalEnding.PROPOSED
    assert found.suite["trials"][0]["setup"]["initial"] == {"piston_position": 0.02}
    (way,) = (room for room in found.trials[0].rooms if room.channel == "piston_position")
    assert 0.012 < way.low <= 0.02 <= way.high < 0.028
    (trial, *_) = load_suite(tmp_path / "next.yaml").trials
    assert trial.setup.initial == {"piston_position": 0.02}


def test_a_limit_of_what_the_model_does_not_have_is_said(tmp_path: Path):
    folder = write_question(tmp_path, [rival(*DELAY), rival(*LAG)])
    suite = tmp_path / "safe.yaml"
    suite.write_text(
        "name: safe\ntrials:\n  - {id: a, mode: current, duration: 1 s, setup: {piston: locked},\n"
        "     signal: {kind: constant, value: 1 A},\n"
        "     safety: {motor_speed: <= 200 rad/s, voltage: <= 48}}\n"
    )
    found = eb.next_experiment(folder, budget=2.0, safety=suite)
    assert any(note.startswith("CAUTION: 'voltage'") for note in found.notes)


def test_a_trial_that_begins_beyond_a_limit_does_not_keep_it(tmp_path: Path):
    question = read_question(write_question(tmp_path, [rival(*LAG)]))
    plant = question.rivals[0].model.plant
    bench = Bench.of(question.covered, plant, "current_command")
    curves = np.zeros((3, 10))
    speed = partial(_room, "motor_speed", curves, bench=bench)
    assert speed(Limit(-5.0, 5.0)).used <= 1.0
    assert speed(Limit(0.0, 5.0)).used <= 1.0  # at rest against a stop
    assert speed(Limit(3.0, 5.0)).used > 1.0


def test_a_limit_is_kept_with_what_was_declared_of_a_doubted_parameter(tmp_path: Path):
    """A friction that the fit has doubled holds a motor that may go twice as far."""
    (own,) = read_question(write_question(tmp_path, [rival(None)])).rivals
    at = own.model.plant.layout.index["coulomb_torque"]
    fitted = float(own.vector[at])
    near = Belief("coulomb_torque", at, fitted, 0.1 * fitted)
    far = Belief("coulomb_torque", at, 0.5 * fitted, 0.1 * fitted)
    assert _with_doubt(own, [near]).doubted is None
    doubted = _with_doubt(own, [far]).doubted
    assert doubted is not None
    assert doubted[at] == 0.5 * fitted
    assert np.count_nonzero(doubted != own.vector) == 1
