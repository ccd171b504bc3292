"""Closed forms, balances and symmetries that the knee's kernel has to keep."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def _value(knee, name, **parameters):
    return knee.model(**parameters).value(name)


def test_resting_shaft_leaks_at_the_linear_rate(knee) -> None:
    """Eq. (22): with the shaft at rest dp decays at beta L (1/Va + 1/Vb)."""
    time = np.arange(0.0, 0.2, 1e-3)
    start = {"pressure_a": 3.0e6, "pressure_b": 1.2e6}
    out = knee.run(time, 0.0, initial=start)
    assert np.all(out["motor_speed"] == 0.0)
    v = _value(knee, "volume_a")
    rate = _value(knee, "bulk_modulus") * _value(knee, "leakage") * 2 / v
    expected = 1.8e6 * np.exp(-rate * time)
    np.testing.assert_allclose(out["pressure_a"] - out["pressure_b"], expected, rtol=1e-6)


@pytest.mark.parametrize("current", [5.0, -11.0, 24.0])
def test_holding_shaft_is_within_static_friction(knee, current) -> None:
    time = np.arange(0.0, 1.0, 1e-3)
    out = knee.run(time, current, leakage=2.0084e-15)
    held = out["motor_speed"] == 0.0
    assert np.count_nonzero(held) >= 10
    dp = out["pressure_a"] - out["pressure_b"]
    torque = _value(knee, "torque_constant") * current
    torque = torque - _value(knee, "pump_displacement") * dp
    # at the instant of stopping friction may still be the sliding one; one tick later it holds
    settled = held[1:] & held[:-1]
    assert np.all(np.abs(torque[1:][settled]) <= _value(knee, "static_torque") * (1 + 1e-9))


def test_load_on_the_oil_spring_has_the_hydraulic_frequency(bare_knee) -> None:
    time = np.arange(0.0, 0.2, 2e-4)
    out = bare_knee.run(
        time, {"motor_speed": np.zeros(time.size)}, locked=False,
        initial={"piston_velocity": 1e-3, "motor_speed": 0.0}, step=5e-6,
    )  # fmt: skip
    area, mass = _value(bare_knee, "piston_area_a"), _value(bare_knee, "load_mass")
    stiffness = area**2 * _value(bare_knee, "bulk_modulus") * 2 / _value(bare_knee, "volume_a")
    omega = np.sqrt(stiffness / mass)
    np.testing.assert_allclose(
        out["piston_velocity"], 1e-3 * np.cos(omega * time), atol=5e-4 * 1e-3
    )


def test_locked_rotor_on_the_oil_spring_keeps_its_energy(bare_knee) -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    out = bare_knee.run(time, 0.0, initial={"motor_speed": 20.0})
    kinetic = 0.5 * _value(bare_knee, "rotor_inertia") * out["motor_speed"] ** 2
    oil = _oil_energy(bare_knee, out)
    total = kinetic + oil
    np.testing.assert_allclose(total, total[0], rtol=1e-5)
    frequency = np.sqrt(
        2 * _value(bare_knee, "bulk_modulus") * _value(bare_knee, "pump_displacement") ** 2
        / (_value(bare_knee, "volume_a") * _value(bare_knee, "rotor_inertia"))
    )  # fmt: skip
    np.testing.assert_allclose(
        out["motor_speed"], 20.0 * np.cos(frequency * time), atol=20.0 * 1e-4
    )


def _oil_energy(knee, out):
    """Energy in the oil of both chambers above the rest pressure, of a locked piston."""
    rest = _value(knee, "initial_pressure")
    squares = (out["pressure_a"] - rest) ** 2 + (out["pressure_b"] - rest) ** 2
    return _value(knee, "volume_a") * squares / (2 * _value(knee, "bulk_modulus"))


@given(
    speed=st.floats(-100.0, 100.0),
    difference=st.floats(-5e6, 5e6),
    bypass=st.booleans(),
)
@settings(max_examples=25)
def test_friction_leakage_and_bypass_only_take_energy(knee, speed, difference, bypass) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    start = {"motor_speed": speed, "pressure_a": 6e6 + difference, "pressure_b": 6e6 - difference}
    out = knee.run(
        time, 0.0, initial=start, bypass=bypass, initial_pressure=6e6, viscous_torque=0.005,
        step=10e-6,
    )  # fmt: skip
    squares = (out["pressure_a"] - 6e6) ** 2 + (out["pressure_b"] - 6e6) ** 2
    energy = 0.5 * _value(knee, "rotor_inertia") * out["motor_speed"] ** 2
    energy = energy + _value(knee, "volume_a") * squares / (2 * _value(knee, "bulk_modulus"))
    assert np.all(np.diff(energy) <= 1e-6 * energy[0] + 1e-12)


@pytest.mark.parametrize("locked", [True, False])
def test_mirrored_command_gives_the_mirrored_motion(knee, locked) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    command = 12.0 * np.sin(2 * np.pi * 5 * time) + 4.0 * np.sin(2 * np.pi * 13 * time)
    there = knee.run(time, command, locked=locked, external_force=80.0)
    back = knee.run(time, -command, locked=locked, external_force=-80.0)
    for one, other, sign in (
        ("motor_speed", "motor_speed", -1), ("pressure_a", "pressure_b", 1),
        ("pressure_b", "pressure_a", 1), ("piston_position", "piston_position", -1),
        ("piston_velocity", "piston_velocity", -1),
    ):  # fmt: skip
        np.testing.assert_allclose(
            there[one], sign * back[other], rtol=0, atol=1e-9 * np.ptp(there[one]) + 1e-18
        )


def test_stiff_oil_moves_the_rod_with_the_pump(knee) -> None:
    """With the bulk modulus going up the pump's flow is the piston's, D w = A v."""
    time = np.arange(0.0, 0.2, 1e-3)
    command = 5.0 * np.sin(2 * np.pi * 4 * time)
    slip = []
    for modulus in (9e8, 9e10):
        out = knee.run(
            time, command, locked=False, bulk_modulus=modulus, leakage=0.0, step=5e-6,
            rod_viscous=2e4,
        )  # fmt: skip
        pump = _value(knee, "pump_displacement") * out["motor_speed"]
        piston = _value(knee, "piston_area_a") * out["piston_velocity"]
        slip.append(np.sqrt(np.mean((pump - piston) ** 2)) / np.sqrt(np.mean(pump**2)))
    assert slip[1] < 0.05 * slip[0]
    assert slip[1] < 5e-3


def test_soft_oil_takes_the_flow_without_pressure(knee) -> None:
    time = np.arange(0.0, 0.05, 1e-3)
    hard = knee.run(time, 10.0)
    soft = knee.run(time, 10.0, bulk_modulus=9e5)
    rise = np.max(soft["pressure_a"]) - 0.6e6
    assert 0 < rise < 5e-3 * (np.max(hard["pressure_a"]) - 0.6e6)


def test_oil_is_kept_where_nothing_lets_it_out(knee) -> None:
    """Internal flows only move oil: p_a + p_b stays where the check valves are shut."""
    time = np.arange(0.0, 0.2, 1e-3)
    command = 6.0 * np.sin(2 * np.pi * 5 * time)
    out = knee.run(time, command, initial={"pressure_a": 15e6, "pressure_b": 15e6})
    total = out["pressure_a"] + out["pressure_b"]
    assert np.min(out["pressure_b"]) > 1e6
    np.testing.assert_allclose(total, 30e6, rtol=1e-9)


def test_rod_sticks_until_the_force_exceeds_its_friction(knee) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    below = knee.run(time, 0.0, locked=False, external_force=59.9)
    above = knee.run(time, 0.0, locked=False, external_force=61.0)
    assert np.all(below["piston_velocity"] == 0.0)
    assert above["piston_velocity"].min() < 0.0


@pytest.mark.parametrize("creep", [1e-5, 1e-4])
def test_creeping_rod_follows_the_inverse_tanh(knee, creep) -> None:
    """Below its friction a creeping rod settles at v_0 atanh(F / f_a), pump turning along."""
    time = np.arange(0.0, 0.05, 1e-3)
    # the bypass keeps the pressures level, so the rod sees the external force alone
    out = knee.run(
        time, 0.0, locked=False, bypass=True, external_force=30.0, rod_creep_speed=creep,
        bypass_conductance=1e-8, rod_viscous=0.0,
    )  # fmt: skip
    assert out["piston_velocity"][-1] == pytest.approx(-creep * np.arctanh(0.5), rel=2e-2)


def test_narrow_creep_is_close_to_sticking(knee) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    command = 4.0 * np.sin(2 * np.pi * 5 * time)
    sticks = knee.run(time, command, locked=True)
    creeps = knee.run(time, command, locked=True, pump_creep_speed=1e-4)
    for name in ("motor_speed", "pressure_a"):
        worst = np.max(np.abs(sticks[name] - creeps[name])) / np.ptp(sticks[name])
        assert worst < 2e-3, name


def test_piston_stops_at_the_end_of_the_stroke(knee) -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    out = knee.run(time, 20.0, locked=False)
    end = 0.98 * _value(knee, "volume_a") / _value(knee, "piston_area_a")
    assert out["piston_position"].max() == pytest.approx(end, rel=1e-9)
    assert out["piston_velocity"][-1] == 0.0
    assert np.all(np.isfinite(out["pressure_a"]))


def test_current_is_what_flowed_before_the_tick_and_is_limited(knee) -> None:
    time = np.arange(0.0, 0.01, 1e-3)
    command = np.linspace(-50.0, 50.0, time.size)
    out = knee.run(time, command)
    assert out["current"][0] == 0.0
    np.testing.assert_allclose(out["current"][1:], np.clip(command, -36, 36)[:-1], rtol=1e-12)


def test_measured_speed_may_stand_in_for_the_current(knee) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    truth = knee.run(time, 14.0 * np.sin(2 * np.pi * 5 * time))
    imposed = knee.run(time, {"motor_speed": truth["motor_speed"]})
    for name in ("pressure_a", "pressure_b"):
        worst = np.max(np.abs(imposed[name] - truth[name])) / np.ptp(truth[name])
        assert worst < 2e-3, name


def test_measured_current_may_stand_in_for_the_command(knee) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    truth = knee.run(time, 14.0 * np.sin(2 * np.pi * 5 * time))
    imposed = knee.run(time, {"current": truth["current"]})
    for name in ("motor_speed", "pressure_a", "current"):
        np.testing.assert_allclose(imposed[name], truth[name], rtol=1e-9, atol=1e-9)


def test_logged_force_acts_as_the_external_force(knee) -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    one = knee.run(time, 0.0, locked=False, external_force=200.0)
    inputs = {"current_command": np.zeros(time.size), "force": np.full(time.size, 200.0)}
    other = knee.run(time, inputs, locked=False)
    np.testing.assert_allclose(one["piston_position"], other["piston_position"], rtol=1e-12)
