"""The learned curve: in every equation, of every variable, and as good as the law it replaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.plants.effects.learned import KNOTS, curve
from eha_bench.plants.registry import get_plant

_curve = curve.py_func
_LEARNED = get_plant("eha_knee").layout.effect("learned")
VARIABLES = _LEARNED.parameter("variable").choices
SENSORS = tuple(place for place in _LEARNED.places if place.endswith(".sensor"))


@given(u=st.floats(-3, 3))
def test_curve_is_the_broken_line_held_outside(u) -> None:
    values = np.cos(np.arange(float(KNOTS)))
    expected = np.interp(u, np.linspace(-1, 2, KNOTS), values)
    assert _curve(u, 0.0, -1.0, 2.0, values) == pytest.approx(expected, abs=1e-12)


@given(u=st.floats(-30, 30), turns=st.integers(-3, 3))
def test_periodic_curve_repeats_and_closes(u, turns) -> None:
    values = np.cos(np.arange(float(KNOTS)))
    knots = np.arange(KNOTS + 1) / KNOTS * 0.7
    expected = np.interp(u % 0.7, knots, np.append(values, values[0]))
    assert _curve(u, 0.7, 0.0, 0.0, values) == pytest.approx(expected, abs=1e-9)
    assert _curve(u + turns * 0.7, 0.7, 0.0, 0.0, values) == pytest.approx(expected, abs=1e-9)


def test_unknown_variable_changes_nothing() -> None:
    assert _curve(float("nan"), 0.0, 0.0, 1.0, np.ones(KNOTS)) == 0.0


def _worst(one, other):
    return max(
        np.max(np.abs(one[name] - values)) / max(np.ptp(values), 1e-12)
        for name, values in other.items()
    )


TIME = np.arange(0.0, 0.25, 1e-3)
COMMAND = 14.0 * np.sin(2 * np.pi * 6 * TIME) + 4.0


def _constant(value):
    return [float(value)] * KNOTS


def test_constant_torque_is_a_current_of_its_size(knee, effect) -> None:
    got = knee.run(TIME, COMMAND, effect("learned", at="shaft", values=_constant(0.13)))
    expected = knee.run(TIME, COMMAND + 1.0)
    for name in ("motor_speed", "pressure_a", "pressure_b"):
        np.testing.assert_allclose(got[name], expected[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("place", ["motor.drive", "motor"])
def test_constant_actuation_is_a_current_of_its_size(knee, effect, place) -> None:
    curve = effect("learned", at=place, values=_constant(1.0))
    got = knee.run(TIME, COMMAND, curve)
    expected = knee.run(TIME, COMMAND + 1.0)
    np.testing.assert_allclose(got["motor_speed"], expected["motor_speed"], rtol=1e-9)
    seen = got["current"][1:] - COMMAND[:-1]
    np.testing.assert_allclose(seen, 1.0 if place == "motor.drive" else 0.0, atol=1e-9)


@pytest.mark.parametrize("place", ["motor.drive", "motor"])
def test_gain_of_the_actuation_is_a_torque_constant(knee, effect, place) -> None:
    curve = effect("learned", form="gain", at=place, values=_constant(-0.1))
    got = knee.run(TIME, COMMAND, curve)
    expected = knee.run(TIME, COMMAND, torque_constant=0.117)
    np.testing.assert_allclose(got["motor_speed"], expected["motor_speed"], rtol=1e-9)


def test_linear_flow_from_a_to_b_is_leakage(knee, effect) -> None:
    dp = 4e7
    values = list(np.linspace(-dp, dp, KNOTS) * 5e-14)
    curve = effect(
        "learned", at="pump", variable="pressure_difference", low=-dp,
        high=dp, values=values,
    )  # fmt: skip
    got = knee.run(TIME, COMMAND, curve, leakage=1e-13)
    assert _worst(got, knee.run(TIME, COMMAND, leakage=1.5e-13)) < 1e-5


@pytest.mark.parametrize(("place", "chamber"), [("chamber_a", "a"), ("chamber_b", "b")])
def test_linear_flow_out_of_a_chamber_is_external_leakage(knee, effect, place, chamber) -> None:
    values = list(-np.linspace(0, 4e7, KNOTS) * 3e-14)
    curve = effect(
        "learned", variable=f"pressure_{chamber}", at=place, low=0.0,
        high=4e7, values=values,
    )  # fmt: skip
    drain = effect("external_leakage", leakage_coefficient=3e-14, at=place)
    assert _worst(knee.run(TIME, COMMAND, curve), knee.run(TIME, COMMAND, drain)) < 1e-5


def test_force_of_velocity_is_viscous_friction(knee, effect) -> None:
    values = list(-np.linspace(-1, 1, KNOTS) * 200.0)
    curve = effect(
        "learned", at="rod", variable="piston_velocity", low=-1.0, high=1.0, values=values
    )
    got = knee.run(TIME, COMMAND, curve, locked=False)
    assert _worst(got, knee.run(TIME, COMMAND, locked=False, rod_viscous=1000.0)) < 1e-4


def test_constant_friction_curve_is_coulomb_friction(knee, effect) -> None:
    for place, size in (("shaft", 0.05), ("rod", 5.0)):
        other = effect("coulomb_friction", friction_force=size, at=place)
        curve = effect("learned", at=place, form="friction", values=_constant(size))
        got = knee.run(TIME, COMMAND, curve, locked=False)
        assert _worst(got, knee.run(TIME, COMMAND, other, locked=False)) < 1e-9


def test_friction_of_a_negative_curve_vanishes_and_never_drives(knee, effect) -> None:
    curve = effect("learned", at="shaft", form="friction", values=_constant(-10.0))
    got = knee.run(TIME, COMMAND, curve)
    assert _worst(got, knee.run(TIME, COMMAND, coulomb_torque=0.0, static_torque=0.0)) < 1e-9


@pytest.mark.parametrize("place", [*SENSORS, "pressures"])
@pytest.mark.parametrize("form", ["additive", "gain"])
def test_measurement_curve_changes_its_channels_alone(knee, effect, place, form) -> None:
    curve = effect("learned", at=place, form=form, values=_constant(0.25))
    plain = knee.run(TIME, COMMAND, locked=False)
    got = knee.run(TIME, COMMAND, curve, locked=False)
    channel = place.removesuffix(".sensor")
    channels = ("pressure_a", "pressure_b") if place == "pressures" else (channel,)
    for name, values in plain.items():
        expected = values
        if name in channels:
            expected = values * 1.25 if form == "gain" else values + 0.25
        np.testing.assert_allclose(got[name], expected, rtol=1e-12)


def test_sagging_supply_is_a_periodic_gain_of_time(knee, effect) -> None:
    """A sine in time is learned by 24 knots to a few thousandths of its size."""
    time = np.arange(0.0, 1.0, 1e-3)
    period, sag = 0.4, 0.12
    knots = np.arange(KNOTS) / KNOTS * period
    values = list(-sag * (1 + np.sin(2 * np.pi * knots / period)) / 2)
    curve = effect(
        "learned", form="gain", at="motor", variable="time",
        period=period, values=values,
    )  # fmt: skip
    command = 10.0 + 4.0 * np.sin(2 * np.pi * 3 * time)
    got = knee.run(time, command, curve)
    weaker = command * (1 - sag * (1 + np.sin(2 * np.pi * (time + 5e-4) / period)) / 2)
    expected = knee.run(time, weaker)
    for name in ("motor_speed", "pressure_a"):
        worst = np.max(np.abs(got[name] - expected[name])) / np.ptp(expected[name])
        assert worst < 5e-3, name
    np.testing.assert_allclose(got["current"][1:], command[:-1])


@pytest.mark.parametrize("variable", VARIABLES)
@pytest.mark.parametrize("place", ["shaft", "pump", "rod", "motor", "pressure_a.sensor"])
def test_every_variable_reaches_every_equation(knee, effect, place, variable) -> None:
    """A step in the middle of the variable's range is felt; a curve of another is not."""
    size = {"shaft": 0.05, "pump": 1e-7, "rod": 50.0, "motor": 1.0, "pressure_a.sensor": 1e4}
    inputs = {
        "current_command": COMMAND,
        "force": 20.0 * np.sin(2 * np.pi * 8 * TIME),
        "oil_temperature": 300.0 + 50.0 * TIME,
    }
    plain = knee.run(TIME, inputs, locked=False)
    seen = {
        "time": TIME, "shaft_angle": np.cumsum(plain["motor_speed"]) * 1e-3,
        "pressure_difference": plain["pressure_a"] - plain["pressure_b"],
        "pressure_sum": plain["pressure_a"] + plain["pressure_b"], **plain, **inputs,
    }[variable]  # fmt: skip
    low, high = float(np.min(seen)), float(np.max(seen))
    curve = effect(
        "learned", variable=variable, at=place, low=low, high=high,
        values=list(size[place] * np.linspace(-1, 1, KNOTS)),
    )  # fmt: skip
    got = knee.run(TIME, inputs, curve, locked=False)
    assert _worst(got, plain) > 1e-4
