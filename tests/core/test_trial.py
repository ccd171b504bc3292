"""What a trial tells a target while it runs."""

import math

import pytest

from eha_bench.core.limit import Bounds, SafetyLimit
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.suites.signals.constant import Constant

LIMITS = (
    SafetyLimit("current", Bounds(-9.0, 9.0), "+- 9 A"),
    SafetyLimit("pressure_a", Bounds(high=6e7), "<= 60 MPa"),
)


@pytest.mark.parametrize(
    ("reading", "told"),
    [
        ({"current": 9.0, "pressure_a": 6e7}, ""),
        ({"current": 9.01, "pressure_a": 0.0}, "safety limit current +- 9 A: 9.01 A"),
        ({"current": -9.01, "pressure_a": 9e9}, "safety limit current +- 9 A: -9.01 A"),
        ({"current": 0.0, "pressure_a": 6.1e7}, "safety limit pressure_a <= 60 MPa: 61 MPa"),
        ({"current": math.nan, "pressure_a": 0.0}, "safety limit current +- 9 A: no value"),
        (
            {"pressure_a": 0.0},
            "safety limit current +- 9 A: the target does not measure it",
        ),
    ],
)
def test_the_first_safety_limit_that_a_reading_breaks(reading: dict[str, float], told: str) -> None:
    signal = Constant(kind="constant", value=0.0)
    trial = Trial("t", signal, ControlMode("current"), Setup(), 1.0, safety=LIMITS)
    assert trial.violation(reading) == told


@pytest.mark.parametrize(
    ("limit", "value", "told"),
    [
        (SafetyLimit("joint_angle", Bounds(high=2.0), "<= 114.6 deg"), 2.0944, "120 deg"),
        (SafetyLimit("oil_temperature", Bounds(high=353.15), "<= 80 degC"), 363.15, "90 degC"),
        (SafetyLimit("tension", Bounds(high=3.0), "<= 3 N", "N"), 4.0, "4 N"),
        (SafetyLimit("tension", Bounds(high=3.0), "<= 3"), 4.0, "4"),
        (SafetyLimit("current", Bounds(-9.0, 9.0), "-9 .. 9"), 10.0, "10 A"),
    ],
)
def test_what_broke_a_limit_is_told_in_its_unit(
    limit: SafetyLimit, value: float, told: str
) -> None:
    assert limit.broken_by(value) == f"safety limit {limit.channel} {limit.text}: {told}"


def test_without_limits_nothing_breaks() -> None:
    signal = Constant(kind="constant", value=0.0)
    trial = Trial("t", signal, ControlMode("current"), Setup(), 1.0)
    assert trial.violation({}) == ""
