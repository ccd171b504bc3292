"""Leaks, friction of strokes, backlash and dead time: known answers, coverage, reasons."""

import importlib.util
import sys
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.signal import Edge, Signal
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics.scoring import measure_safely, metric
from eha_bench.suites.signals.constant import Constant


class Triangle(Signal):
    def __init__(self, amplitude=0.05, period=2.0, periods=2.0):
        self.amplitude, self.period, self.periods = amplitude, period, periods

    @property
    def duration(self):
        return self.period * self.periods

    def __call__(self, time):
        angle = 2 * np.pi * np.asarray(time) / self.period
        return self.amplitude * 2 / np.pi * np.arcsin(np.sin(angle))


class Off(Signal):
    duration = 5.0

    def __call__(self, time):
        return np.where(np.asarray(time) < 1.0, 2.0, 0.0)

    @property
    def edges(self):
        return (Edge(1.0, 2.0, 0.0, 5.0),)


def recorded(signal, mode, values, units, **metadata):
    time = np.arange(round(signal.duration * 500)) / 500
    reference = signal(time)
    made = {name: np.asarray(of(time, reference), dtype=float) for name, of in values.items()}
    recording = Recording(
        time, {**made, "reference": reference}, units, metadata={"signal_start": "0.0", **metadata}
    )
    return recording, Trial("t", signal, mode, Setup(), signal.duration, 0.0, 500.0)


def scored(name, pair, channel=None):
    found = metric(name)
    return measure_safely(found, *pair, channel or found.spec.channel_for(pair[1].channel))


def leak(level=lambda t: 5e6 - 2e4 * (t - 1.0), mode=ControlMode.CURRENT, **rest):
    values = {"pressure_difference": lambda t, _: level(t)}
    return recorded(Off(), mode, values, {"pressure_difference": "Pa"}, **rest)


def stroke(effort, signal=None):
    values = {
        "pressure_difference": lambda t, x: effort(x, np.sign(np.gradient(x))),
        "piston_position": lambda t, x: x,
    }
    units = {"pressure_difference": "Pa", "piston_position": "m"}
    return recorded(signal or Triangle(), ControlMode.PISTON_POSITION, values, units)


def joint(drive, signal=None, **more):
    values = {
        "piston_position": lambda t, x: drive(x, np.sign(np.gradient(x))),
        "joint_angle": lambda t, x: x,
    } | more
    units = {"piston_position": "m", "joint_angle": "rad"}
    return recorded(signal or Triangle(0.5), ControlMode.JOINT_ANGLE, values, units)


def test_a_straight_fall_is_its_slope_whatever_the_sign_of_the_pressure():
    for sign in (1.0, -1.0):
        found = scored("pressure_decay", leak(lambda t, s=sign: s * (5e6 - 2e4 * (t - 1.0))))
        assert found.value == pytest.approx(2e4, rel=1e-9)
        assert found.low <= found.value <= found.high
    rising = scored("pressure_decay", leak(lambda t: 5e6 + 1e4 * t))
    assert rising.value == pytest.approx(-1e4, rel=1e-9)


def test_a_gain_of_the_sensor_is_in_the_budget_of_a_fall():
    key = "sensor.pressure_difference.relative_uncertainty"
    found = scored("pressure_decay", leak(**{key: "0.01"}))
    assert found.high - found.value == pytest.approx(1.96 * 200.0, rel=1e-3)
    assert found.budget.parts[0].source == "sensor"


def test_a_constant_reference_is_one_hold():
    signal = Constant(kind="constant", value=0.0)
    time = np.arange(2000) / 500
    values = {"pressure_a": 3e6 - 1e3 * time, "reference": np.zeros(2000)}
    recording = Recording(time, values, {"pressure_a": "Pa"}, metadata={"signal_start": "0.0"})
    trial = Trial("t", signal, ControlMode.CURRENT, Setup(), 4.0, 0.0, 500.0)
    assert scored("pressure_decay", (recording, trial), "pressure_a").value == pytest.approx(1e3)


@pytest.mark.parametrize(
    ("pair", "channel", "reason"),
    [
        (leak(mode=ControlMode.PRESSURE), None, "makes up for the leakage"),
        (leak(lambda t: 0.0 * t), None, "not distinct from zero"),
        (leak(), "reference", "not a pressure"),
        (leak(), "pressure_a", "no pressure_a"),
        (stroke(lambda x, s: s), None, "held nowhere"),
    ],
)
def test_a_decay_that_cannot_be_had_says_why(pair, channel, reason):
    found = scored("pressure_decay", pair, channel)
    assert np.isnan(found.value)
    assert reason in found.reason


def test_friction_is_what_is_left_without_weight_and_offset():
    pair = stroke(lambda x, s: 3e5 + 1e6 * np.cos(12 * x) + 4e7 * x**2 + 7e4 * s)
    found = scored("stroke_friction", pair)
    assert found.value == pytest.approx(7e4, rel=1e-6)
    assert "0.1 m/s" in found.reason  # 0.2 m a period of 2 s
    # what opposes the motion may be counted the other way round
    assert scored("stroke_friction", stroke(lambda x, s: -7e4 * s)).value == pytest.approx(7e4)


def test_strokes_that_are_not_alike_widen_the_interval():
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1e3, 5000)

    def effort(spread):
        def of(x, s):
            turns = np.cumsum(np.abs(np.diff(s, prepend=s[0])) > 0)
            drift = rng.normal(0.0, spread, turns.max() + 1)[turns]
            return s * (7e4 + drift) + noise[: x.size]

        return of

    signal = Triangle(periods=5.0)
    alike, unlike = (scored("stroke_friction", stroke(effort(e), signal)) for e in (0.0, 1e4))
    assert unlike.high - unlike.low > 10 * (alike.high - alike.low)
    assert "strokes" in {part.source for part in unlike.budget.parts}
    assert "strokes" not in {part.source for part in alike.budget.parts}


class Staircase(Triangle):
    def __call__(self, time):
        return np.round(super().__call__(time) / 0.02) * 0.02


@pytest.mark.parametrize(
    ("pair", "channel", "reason"),
    [
        (leak(), None, "not a position"),
        (stroke(lambda x, s: s, Triangle(periods=0.6)), None, "does not go back and forth"),
        (stroke(lambda x, s: s, Staircase()), None, "halts"),
        (stroke(lambda x, s: s, Triangle(amplitude=0.0)), None, "does not move"),
        (stroke(lambda x, s: s), "piston_position", "is a position"),
        (stroke(lambda x, s: np.where(x > 0, np.nan, s)), None, "without a value"),
        (stroke(lambda x, s: s), "force", "no force"),
    ],
)
def test_a_friction_that_cannot_be_had_says_why(pair, channel, reason):
    found = scored("stroke_friction", pair, channel)
    assert np.isnan(found.value)
    assert reason in found.reason


def test_backlash_is_the_width_of_the_loop_whichever_way_the_linkage_turns():
    for turn in (1.0, -1.0):
        # the side that pushes is the one that the drive moves to
        pair = joint(lambda x, s, t=turn: t * (0.04 * np.sin(x) + 0.01 * x**2 + 2.5e-4 * s))
        found = scored("backlash", pair)
        assert found.value == pytest.approx(5e-4, rel=1e-5)


def test_a_position_that_was_carried_from_another_clock_is_in_the_budget():
    """Its samples may lie half a period off: what it moves in one, on both sides."""
    recording, trial = joint(lambda x, s: 0.04 * x + 2.5e-4 * s)
    own = scored("backlash", (recording, trial))
    for name, more in (("piston_position", True), ("joint_angle", True), ("current", False)):
        metadata = {**recording.metadata, "resampled": f'["{name}"]'}
        found = scored("backlash", (replace(recording, metadata=metadata), trial))
        assert found.value == own.value
        assert ("time stamps" in {part.source for part in found.budget.parts}) is more
        assert (found.high - found.low > own.high - own.low) is more


def test_a_driven_position_that_leads_is_said():
    found = scored("backlash", joint(lambda x, s: 0.04 * x - 2.5e-4 * s))
    assert found.value == pytest.approx(-5e-4, rel=1e-6)
    assert "check the channels' time stamps" in found.reason


@pytest.mark.parametrize(
    ("pair", "channel", "reason"),
    [
        (stroke(lambda x, s: s), None, "the motion itself"),
        (stroke(lambda x, s: s), "pressure_difference", "not a position"),
        (joint(lambda x, s: x), "reference", "not a position"),
    ],
)
def test_a_backlash_that_cannot_be_had_says_why(pair, channel, reason):
    found = scored("backlash", pair, channel)
    assert np.isnan(found.value)
    assert reason in found.reason


def test_dead_time_has_the_delay_as_a_whole(kit):
    def first_order(delay):
        return lambda t: -np.expm1(-np.maximum(t - delay, 0.0) / 0.02)

    plain, late = (
        kit.measure("dead_time", *kit.step(first_order(delay), hold=0.5)) for delay in (0.0, 0.03)
    )
    assert plain.value == pytest.approx(-0.02 * np.log(0.95), abs=1e-4)
    assert late.value - plain.value == pytest.approx(0.03, abs=3e-4)


@pytest.fixture(scope="module")
def coverage(repository):
    path = repository / "benchmarks" / "coverage.py"
    specification = importlib.util.spec_from_file_location("coverage_of_wear", path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("place", range(10))
def test_intervals_hold_the_truth(coverage, place):
    case = coverage.WEAR[place]
    (line,) = coverage.cover_case(case, 150, 3)
    # 150 recordings: three standard errors below what is wanted refute it
    assert line.coverage >= 0.88, line
    assert line.scored >= 0.95 * line.recordings, line
