"""The shipped suites hold what they promise."""

import math
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.trial import Bypass, ControlMode, Piston
from eha_bench.suites import Suite, load_suite


def suite(repository: Path, name: str) -> Suite:
    return load_suite(repository / "suites" / f"{name}.yaml")


@pytest.mark.parametrize(
    ("pressure", "response", "holding"), [(15, 0.039, 11.0), (20, 0.043, 15.8), (30, 0.050, 24.0)]
)
def test_published_pressure_steps(
    repository: Path, pressure: int, response: float, holding: float
) -> None:
    trial = suite(repository, "paper").trial(f"pressure_step-{pressure}MPa")
    assert trial.mode == ControlMode.PRESSURE
    assert trial.setup.piston is Piston.LOCKED
    assert trial.setup.initial == {"piston_position": 0.0}
    (edge,) = trial.signal.edges
    assert (edge.time, edge.before, edge.after) == (0.001, 0.0, pressure * 1e6)
    limits = {limit.metric: limit.bounds for limit in trial.limits}
    assert limits["response_time"].low == pytest.approx(0.94 * response)
    assert limits["response_time"].high == pytest.approx(1.06 * response)
    assert limits["holding_current"].low == pytest.approx(0.94 * holding)
    assert limits["holding_current"].high == pytest.approx(1.06 * holding)
    assert ("peak" in limits) == (pressure == 30)
    if pressure == 30:
        assert (limits["peak"].low, limits["peak"].high) == (38e6, 41e6)


def test_published_sines_by_both_readings(repository: Path) -> None:
    paper = suite(repository, "paper")
    for amplitude in (20e6, 30e6):
        trials = [
            trial
            for trial in paper.trials
            if trial.id.startswith("pressure_sine") and trial.id.endswith(f"{amplitude / 1e6:g}MPa")
        ]
        spans = []
        for trial in trials:
            values = trial.reference(trial.clock())
            spans.append((round(np.ptp(values) / 1e6), round(values.min() / 1e6)))
            assert trial.signal.tones[0].frequency == 6.7
        span = round(amplitude / 1e6)
        assert sorted(spans) == [(span, 0), (2 * span, -span)]


def test_published_knee(repository: Path) -> None:
    paper = suite(repository, "paper")
    step = paper.trial("knee_step")
    (edge,) = step.signal.edges
    assert (edge.before, edge.after) == (pytest.approx(math.radians(50)), math.radians(120))
    assert step.setup.initial == {"joint_angle": pytest.approx(math.radians(50))}
    limits = {limit.metric: limit.bounds for limit in step.limits}
    assert (limits["response_time"].low, limits["response_time"].high) == pytest.approx(
        (0.57, 0.63)
    )
    assert limits["steady_state_error"].high == pytest.approx(math.radians(0.1))
    assert limits["steady_state_error"].low == -limits["steady_state_error"].high
    sine = paper.trial("knee_sine")
    values = np.degrees(sine.reference(sine.clock()))
    assert (values.min(), values.max()) == (pytest.approx(60), pytest.approx(120))
    assert values[0] == pytest.approx(math.degrees(sine.setup.initial["joint_angle"]))


def test_identification_is_open_loop_and_works_both_ways(repository: Path) -> None:
    trials = suite(repository, "identify").trials
    assert {trial.mode for trial in trials} == {ControlMode.CURRENT}
    assert {trial.setup.bypass for trial in trials} == {Bypass.CLOSED, Bypass.OPEN}
    opened = [trial for trial in trials if trial.setup.bypass is Bypass.OPEN]
    assert {np.sign(trial.signal.edges[0].after) for trial in opened} == {-1.0, 1.0}


def test_bandwidth_covers_both_loops_and_ways(repository: Path) -> None:
    trials = suite(repository, "bandwidth").trials
    for mode in (ControlMode.PRESSURE, ControlMode.JOINT_ANGLE):
        own = [trial for trial in trials if trial.mode == mode]
        assert any(len(trial.signal.tones) >= 10 for trial in own)
        assert any(len(trial.signal.lines) >= 3 for trial in own)
        scored = [{metric for metric, _ in trial.scores} for trial in own]
        assert all("bandwidth_3db" in metrics for metrics in scored)
        # The multisine of the knee ends before its phase reaches -90 degrees; the others do not.
        assert sum("bandwidth_90deg" in metrics for metrics in scored) >= 2


def test_smoke_takes_a_few_seconds(repository: Path) -> None:
    trials = suite(repository, "smoke").trials
    assert sum(trial.duration + trial.settle for trial in trials) < 5
    assert {trial.mode for trial in trials} >= {
        ControlMode.CURRENT,
        ControlMode.PRESSURE,
        ControlMode.JOINT_ANGLE,
    }


def test_nothing_moves_a_locked_or_free_piston_out_of_its_stroke(repository: Path) -> None:
    """The first reference of an angle trial is where the joint stands, within the swing of it."""
    for name in ("paper", "bandwidth", "smoke"):
        for trial in suite(repository, name).trials:
            if trial.mode == ControlMode.JOINT_ANGLE:
                values = np.degrees(trial.reference(trial.clock()))
                assert values.min() > 49.9
                assert values.max() < 120.1
