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
        ({"current": 9.01, "pressure_a": 0.0}, "safety limit current +- 9 A: 9.01"),
        ({"current": -9.01, "pressure_a": 9e9}, "safety limit current +- 9 A: -9.01"),
        ({"current": 0.0, "pressure_a": 6.1e7}, "safety limit pressure_a <= 60 MPa: 6.1e+07"),
        ({"current": math.nan, "pressure_a": 0.0}, "safety limit current +- 9 A: nan"),
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


def test_without_limits_nothing_breaks() -> None:
    signal = Constant(kind="constant", value=0.0)
    trial = Trial("t", signal, ControlMode("current"), Setup(), 1.0)
    assert trial.violation({}) == ""
