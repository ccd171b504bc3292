"""What a candidate gains, on readings and by parameters that stay where they are believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.experiment_rigs import rigs_of

from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit import evidence
from eha_bench.diagnosis.fit.evidence import Excess, Groups, compare
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.suites import load_suite

RUNS, BLOCKS, ROWS = 4, 10, 20
SIZE = RUNS * BLOCKS * ROWS


def fitted(readings: np.ndarray, *beliefs: float) -> Fit:
    """A fit that left so much of its readings and beliefs."""
    residual = np.append(readings, beliefs)
    return Fit(np.zeros(1), (), residual, np.zeros((residual.size, 0)), 0.0, beliefs=len(beliefs))


@pytest.fixture
def groups() -> Groups:
    rows = np.arange(SIZE)
    return Groups(tuple(np.split(rows, RUNS)), tuple(np.split(rows, RUNS * BLOCKS)))


def test_a_cause_that_leaves_parameters_where_they_are_believed_gains(groups: Groups) -> None:
    """The readings hardly change: of four runs two are fitted a little worse."""
    left = np.random.default_rng(0).standard_normal(SIZE)
    other = left * np.repeat([0.9999, 1.0001, 0.9999, 1.0001], SIZE // RUNS)
    found = compare(fitted(left, 20.0), fitted(other, 0.5), groups, 200.0)
    assert DEFAULT.allow(found)
    assert found.runs_better == 1.0
    assert found.p_value < 1e-9
    # the other way round it loses by as much
    assert not DEFAULT.allow(compare(fitted(other, 0.5), fitted(left, 20.0), groups, 200.0))


def test_what_most_runs_speak_against_is_no_gain(groups: Groups) -> None:
    left = np.random.default_rng(0).standard_normal(SIZE)
    other = left * np.repeat([0.5, 1.05, 1.05, 1.05], SIZE // RUNS)
    found = compare(fitted(left), fitted(other), groups, 200.0)
    assert found.gain > DEFAULT.gain
    assert found.runs_better == 0.25
    assert not DEFAULT.allow(found)


def test_parameters_far_from_what_is_believed_are_worth_a_look() -> None:
    """They may imitate what is missing, down to the noise."""
    assert not DEFAULT.is_worth_a_look(Excess(0.0, SIZE, 0.0, {}))
    assert not DEFAULT.is_worth_a_look(Excess(0.0, SIZE, 0.0, {}, against_beliefs=20.0))
    assert DEFAULT.is_worth_a_look(Excess(0.0, SIZE, 0.0, {}, against_beliefs=40.0))


@pytest.mark.slow(35)
def test_a_delay_that_a_slower_spool_imitates_is_found_by_what_is_believed_of_the_spool(
    tmp_path: Path,
) -> None:
    """One sine: with a natural frequency five tolerances off the model fits down to the noise."""
    rig = rigs_of("valve_cylinder", foreign=False)["command_delay"](1200)
    found = diagnose(rig.record_first(tmp_path), tmp_path / "found")
    left = {item.cause for item in found.rivals if item.standing != "runner_up"}
    assert left == {"command_delay", "valve_lag"}


@pytest.mark.slow(35)
def test_a_delay_is_named_alone_once_small_steps_are_recorded_as_well(tmp_path: Path) -> None:
    """Its fit is long: it leads back from a spool that had imitated it.

    The log rests for 0.4 s: too short to show that the pressures' noise has a memory.
    """
    rig = rigs_of("valve_cylinder", foreign=False)["command_delay"](1200)
    rig.record_first(tmp_path)
    steps = load_suite({
        "name": "steps",
        "defaults": {"sample_rate": "500 Hz"},
        "trials": [{
            "id": "steps", "mode": "valve_command", "duration": "1 s",
            "signal": {"kind": "steps", "initial": 0.0, "at": "0.05 s", "hold": "0.0512 s",
                       "levels": [0.35 * k for k in (1.0, -1.0, 0.5, -0.5, 0.0)] * 4},
        }],
    }).trials  # fmt: skip
    rows = [rig.perform(trial, tmp_path / trial.id)[0] for trial in steps]
    found = diagnose(rig.dataset(tmp_path, "both.yaml", rows), tmp_path / "found")
    assert [effect.id for effect in found.effects] == ["command_delay"]
    assert found.equivalent == ()
    assert any("pressure_a" in note and "not white" in note for note in found.notes)


@pytest.mark.slow(35)
def test_a_rival_in_a_long_valley_is_not_behind(tmp_path: Path) -> None:
    """Mass and bulk modulus of a short sine: only their ratio shows; each fit stopped elsewhere.

    A lopsided dry friction and a weight along a slide are one force.
    """
    rig = rigs_of("valve_cylinder", foreign=False)["gravity_load"](1200)
    found = diagnose(rig.record_first(tmp_path), tmp_path / "found")
    behind = {item.id: item.behind for item in found.rivals if item.standing != "runner_up"}
    assert behind.keys() >= {"gravity_load", "asymmetric_friction"}
    assert abs(behind["gravity_load"] - behind["asymmetric_friction"]) < 3.0


@pytest.mark.parametrize(("outliers", "sure"), [
    # a valve that opens a little sooner: four blocks lose what a hundred others gain
    ((-426.0, -364.0, -243.0, -221.0), True),
    # made by a few blocks, and a few speak against it
    ((900.0, -426.0, -364.0), False),
    # more is lost than gained
    ((-426.0, -364.0, -243.0, -221.0, -900.0), False),
    # ten in 340 are not few
    (10 * (-130.0,), False),
])  # fmt: skip
def test_few_blocks_that_speak_against_many_do_not_decide(
    outliers: tuple[float, ...], sure: bool
) -> None:
    many = 4.0 if len(outliers) != 3 else 0.0
    sums = many + 8.0 * np.random.default_rng(4).normal(size=340)
    sums[: len(outliers)] = outliers
    assert evidence._bootstrap_p(float(sums.sum()), sums, 0) > 0.01
    assert (evidence._winsorised_p(float(sums.sum()), sums) < DEFAULT.p_value) is sure


def test_a_gain_that_is_none_is_rarely_taken_for_one() -> None:
    """Of sums with heavy tails of both signs and a mean of zero."""
    rng = np.random.default_rng(8)
    draws = rng.standard_t(2, size=(4000, 300))
    chances = np.array([evidence._winsorised_p(float(sums.sum()), sums) for sums in draws])
    assert np.mean(chances < DEFAULT.p_value) < DEFAULT.p_value
