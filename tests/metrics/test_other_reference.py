"""A log of another command than its trial's is said to be one, however a rig's log may differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.metrics.other_reference import ReferenceLevels, is_of_trial, other_reference
from eha_bench.suites import load_suite

STEP = {"kind": "step", "final": "10 MPa", "at": "20 ms"}
SINE = {"kind": "sine", "amplitude": "2 MPa", "offset": "6 MPa", "frequency": "5 Hz", "cycles": 20}
PRBS = {"kind": "prbs", "low": "2 MPa", "high": "6 MPa", "bit": "20 ms"}
CONSTANT = {"kind": "constant", "value": "5 MPa"}


def trial(signal: dict[str, object], duration: str = "500 ms") -> Trial:
    content = {"id": "a", "mode": "pressure", "signal": signal, "duration": duration}
    return load_suite({"name": "s", "trials": [content]}).trials[0]


def log(of: Trial, before: float = 0.3, clock: float = 1.0) -> Recording:
    """What a logger makes of a trial's command: it begins sooner, and has a clock of its own."""
    time = np.arange(0.0, before + of.duration + 0.1, 1e-3)
    asked: FloatArray = of.signal(np.clip((time - before) * clock, -1.0, of.duration))
    return Recording(time, {"reference": asked, "pressure_difference": asked})


@pytest.mark.parametrize("signal", [STEP, SINE, PRBS])
@pytest.mark.parametrize(("gain", "differs"), [(1.0, False), (1.02, False), (0.5, True)])
def test_a_command_of_another_size_is_another_one(
    signal: dict[str, object], gain: float, differs: bool
) -> None:
    of = trial(signal, "4 s")
    whole = log(of)
    made = Recording(whole.time, {"reference": gain * whole["reference"]})
    assert (other_reference(made, of) is not None) is differs
    assert is_of_trial(made, of) is not differs


def test_levels_of_both_are_said_in_a_unit_of_people() -> None:
    whole = log(trial(STEP))
    made = Recording(whole.time, {"reference": 0.5 * whole["reference"]}, {"reference": "Pa"})
    said = str(other_reference(made, trial(STEP)))
    assert said == "its reference goes 0 to 5 MPa, and the trial asks for 0 to 10 MPa"


def test_what_a_rig_s_log_differs_by_is_not_another_command() -> None:
    """A step that takes 15 ms, samples that are wrong, a late clock, an edge that hardly shows."""
    step, sine = log(trial(STEP)), log(trial(SINE), clock=1.002)
    slow = np.interp(step.time, [0.32, 0.335], [0.0, 10e6])
    odd = step["reference"].copy()
    odd[[350, 400, 500]] = (-5e7, 5e7, 0.0)
    for values in (slow, odd):
        assert other_reference(Recording(step.time, {"reference": values}), trial(STEP)) is None
    assert other_reference(sine, trial(SINE)) is None
    for at in ("1 ms", "24 ms", "25 ms", "26 ms", "475 ms"):
        late = trial({**STEP, "at": at})
        moved = log(late, before=0.3004)
        assert other_reference(moved, late) is None


def test_a_constant_that_was_another_is_said() -> None:
    made = Recording(
        np.arange(500) / 1e3, {"reference": np.full(500, 4e6)}, metadata={"signal_start": "0.0"}
    )
    assert other_reference(made, trial(CONSTANT)) is not None
    assert other_reference(made, trial({**CONSTANT, "value": "4 MPa"})) is None


def test_a_log_that_says_nothing_of_its_command_is_no_other() -> None:
    whole = log(trial(STEP))
    silent = Recording(whole.time, {"pressure_difference": whole["reference"]})
    still = Recording(whole.time, {"reference": np.zeros(len(whole))})
    for made in (silent, still, whole.between(0.0, 0.004)):
        assert other_reference(made, trial(STEP)) is None
        assert not is_of_trial(made, trial(STEP))
    assert other_reference(whole, trial({"kind": "recorded"})) is None


def test_scores_name_the_trial_that_a_log_is_of(tmp_path: Path) -> None:
    small = {"id": "small", "mode": "pressure", "duration": "500 ms", "signal": STEP}
    large = {**small, "id": "large", "signal": {**STEP, "final": "20 MPa"}}
    suite = {"name": "s", "trials": [small, large]}
    for name in ("large", "small"):
        eb.write(tmp_path / f"{name}.mcap", log(trial(STEP)))
    made = [tmp_path / "large.mcap", tmp_path / "small.mcap"]
    first, second = eb.score_files(made, suite, out=tmp_path / "scored").trials
    (said,) = [note for note in first.notes if "CAUTION" in note]
    assert "goes 0 to 10 MPa, and the trial asks for 0 to 20 MPa" in said
    assert "score it as small (--trial)" in said
    assert not [note for note in second.notes if "CAUTION" in note]


def test_logs_of_several_commands_are_no_repeats_of_one_that_takes_any(tmp_path: Path) -> None:
    whole = log(trial(STEP))
    sizes = {"a": 1.0, "b": 1.01, "c": 0.5, "d": 2.0}
    for name, size in sizes.items():
        values = {key: size * whole[key] for key in whole}
        eb.write(tmp_path / f"{name}.mcap", Recording(whole.time, values, {"reference": "Pa"}))
    any_step = {"id": "any", "mode": "pressure", "duration": "900 ms"}
    suite = {"name": "s", "trials": [{**any_step, "signal": {"kind": "recorded"}}]}
    made = [tmp_path / f"{name}.mcap" for name in sizes]
    done = eb.score_files(made, suite, out=tmp_path / "scored").trials
    assert [any("no repeats" in note for note in item.notes) for item in done] == [
        False, False, True, False,
    ]  # fmt: skip
    (said,) = [note for note in done[2].notes if "no repeats" in note]
    assert "the reference of c.mcap goes 0 to 5 MPa, and that of a.mcap 0 to 10 MPa" in said


def levels(values: np.ndarray) -> ReferenceLevels:
    found = ReferenceLevels.of(Recording(0.01 * np.arange(values.size), {"reference": values}))
    assert found is not None
    return found


def test_an_edge_a_little_later_and_what_flickers_about_a_level_are_no_other_reference() -> None:
    rows = np.arange(1000)
    early, late = (np.where(rows > 1000 * (1.0 - up), 10.0, 0.0) for up in (0.055, 0.045))
    assert not levels(early).differ_from(levels(late))
    flicker = np.random.default_rng(2).normal(0.0, 100.0, 1000)
    held = levels(5e6 + flicker)
    assert not held.differ_from(levels(5e6 + 20.0 + flicker))
    assert held.differ_from(levels(10e6 + flicker))
    assert levels(np.where(rows > 500, 10.0, 0.0)).differ_from(
        levels(np.where(rows > 500, 5.0, 0.0))
    )
