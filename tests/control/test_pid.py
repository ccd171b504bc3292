"""PID: each term by hand, what keeps it from winding up, and its units."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.control.controller import Context
from eha_bench.control.pid import Pid, PidGains
from eha_bench.core.errors import InputError

PERIOD = 1e-3


def pid(limit: float = math.inf, unit: str = "m", command: str = "V", **gains: object) -> Pid:
    context = Context(PERIOD, limit, None, "voltage", command, "x", unit)
    return Pid(PidGains.model_validate({"k_p": 0.0, **gains}), context)


def test_proportional_with_set_point_weight_and_feed_forward() -> None:
    law = pid(k_p="3 V/mm", setpoint_weight=0.5, k_f=100.0)
    assert law.step(2e-3, {"x": 1e-3}) == pytest.approx(3e3 * (1e-3 - 1e-3) + 0.2)
    assert law.step(4e-3, {"x": 1e-3}) == pytest.approx(3e3 * (2e-3 - 1e-3) + 0.4)


def test_the_integral_adds_the_error_of_every_tick() -> None:
    law = pid(k_i="2 V/(m*s)")
    given = [law.step(1.0, {"x": 0.25}) for _ in range(4)]
    assert given == pytest.approx([0.0, 1.5e-3, 3.0e-3, 4.5e-3])


def test_the_derivative_is_of_the_measurement_and_filtered() -> None:
    """A ramp of slope 2 gives k_d * 2 after the filter's time; a step of the reference nothing."""
    law = pid(k_d="0.5 V*s/m", filter_time="5 ms")
    given = [law.step(1.0 if k > 20 else 0.0, {"x": 2.0 * k * PERIOD}) for k in range(200)]
    assert given[0] == 0.0
    assert given[-1] == pytest.approx(-1.0)
    keeps = 5.0 / 6.0
    expected = -1.0 * (1.0 - keeps ** np.arange(200))
    np.testing.assert_allclose(given, expected, atol=1e-12)


def test_the_command_stays_within_the_smaller_limit() -> None:
    assert pid(k_p=100.0, limit=3.0, output_limit="2 V").step(1.0, {"x": 0.0}) == 2.0
    assert pid(k_p=100.0, limit=1.0, output_limit="2 V").step(-1.0, {"x": 0.0}) == -1.0


@given(ticks=st.integers(200, 4000), k_d=st.sampled_from([0.0, 0.02]))
def test_the_integral_does_not_wind_up(ticks: int, k_d: float) -> None:
    """However long the command was at its limit, it leaves it within a few tracking times."""
    law = pid(k_p=1.0, k_i=10.0, k_d=k_d, limit=1.0)
    for _ in range(ticks):
        assert law.step(10.0, {"x": 0.0}) == 1.0
    after = [law.step(10.0, {"x": 11.0}) for _ in range(100)]
    assert after[-1] < 0.0


def test_an_integral_alone_does_not_wind_up_either() -> None:
    law = pid(k_i=5.0, limit=1.0)
    for _ in range(5000):
        law.step(1.0, {"x": 0.0})
    law.step(-1.0, {"x": 0.0})
    assert law.step(-1.0, {"x": 0.0}) < 1.0


def test_it_positions_an_integrator_without_an_error_at_rest() -> None:
    """dx/dt = u + d under PI: the closed loop's poles are at -10 twice, the disturbance is gone."""
    law, x = pid(k_p=20.0, k_i=100.0), 0.0
    for _ in range(3000):
        x += PERIOD * (law.step(1.0, {"x": x}) + 0.7)
    assert x == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("gains", "unit", "command", "key"),
    [
        ({"k_p": "1 V/rad"}, "m", "V", "k_p"),
        ({"k_i": "1 V/m"}, "m", "V", "k_i"),
        ({"k_d": "1 V/m"}, "m", "V", "k_d"),
        ({"k_f": "1 A/m"}, "m", "V", "k_f"),
        ({"output_limit": "1 A"}, "m", "V", "output_limit"),
        ({"output_limit": -1.0}, "m", "V", "output_limit"),
    ],
)
def test_a_gain_of_the_wrong_dimension_is_named(
    gains: dict[str, object], unit: str, command: str, key: str
) -> None:
    with pytest.raises(InputError) as refused:
        pid(unit=unit, command=command, **gains)
    assert refused.value.where.key == key


@pytest.mark.parametrize(
    ("gains", "unit", "command"),
    [
        ({"k_p": "0.2 A*s/rad", "k_i": "1 A/rad", "k_d": "1e-3 A*s^2/rad"}, "rad/s", "A"),
        ({"k_p": "4 A/bar", "k_i": "1 A/(MPa*s)"}, "Pa", "A"),
        ({"k_p": "4 1/deg", "output_limit": "50 %"}, "rad", ""),
        ({"k_p": 2, "k_d": "3 ms"}, "", ""),
    ],
)
def test_gains_take_the_units_of_channel_and_command(
    gains: dict[str, object], unit: str, command: str
) -> None:
    assert math.isfinite(pid(unit=unit, command=command, **gains).step(0.1, {"x": 0.0}))
