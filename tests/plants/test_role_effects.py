"""Effects that a plant's valve, supply or gear has, each against a case worked by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.effects import supply_sag, valve_deadband, valve_lag
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

compiles = pytest.mark.slow(15)
"""What runs on the kernel of the valve and cylinder with all effects, which is compiled for it."""

# a quick spool and a stiff supply line: what is left to see is the effect
QUICK = {"valve.natural_frequency": 3e4, "valve.damping_ratio": 1.0}


def run(
    plant: str, time: FloatArray, inputs: Mapping[str, FloatArray], effect: str = "",
    parameters: Mapping[str, float] | None = None, initial: Mapping[str, float] | None = None,
    **values: Any,
) -> dict[str, FloatArray]:  # fmt: skip
    effects = (DeclaredEffect(effect, values),) if effect else ()
    vector = Model(plant, dict(parameters or {}), (), effects).vector()
    drive = Drive(time, inputs, initial or {})
    found = get_plant(plant)
    return dict(zip(found.outputs, found.simulate(vector, drive, 1e-4).T, strict=True))


# --- load_dependent_friction: level + mu |load| -------------------------------------------------

SERVO_WEIGHT = 0.8 * 9.80665 * 0.18  # m g l, N*m


def held(angle: float, torque: float, **values: Any) -> bool:
    """Whether a servo without friction of its own stays where its motor gives a torque."""
    time = np.arange(0.0, 0.1, 1e-3)
    voltage = torque * 2.3 / (193 * 0.0083)
    inputs = {"duty": np.full(time.size, voltage / 12.0), "supply_voltage": np.full(100, 12.0)}
    free = {"gear_friction.coulomb": 0.0, "gear_friction.viscous": 0.0}
    start = {"angle": angle, "velocity": 0.0}
    found = run("geared_servo", time, inputs, "load_dependent_friction", free, start, **values)
    return bool(np.ptp(found["angle"]) == 0.0)


@pytest.mark.parametrize("degrees", [30.0, 90.0, -60.0])
def test_friction_under_load_holds_its_share_of_the_weight(degrees: float) -> None:
    """It sticks while |drive - weight| <= mu |weight|, either way."""
    angle = math.radians(degrees)
    weight = SERVO_WEIGHT * math.sin(angle)
    for sign in (-1.0, 1.0):
        assert held(angle, weight * (1 + sign * 0.19), friction_coefficient=0.2, by="load")
        assert not held(angle, weight * (1 + sign * 0.21), friction_coefficient=0.2, by="load")


def test_friction_by_drive_lets_the_weight_back_drive_sooner() -> None:
    """By the motor's torque T: it sticks while |T - W| <= mu |T|, so T >= W / (1 + mu)."""
    angle = math.radians(60.0)
    weight = SERVO_WEIGHT * math.sin(angle)
    assert held(angle, weight / 1.2 * 1.01, friction_coefficient=0.2, by="drive")
    assert not held(angle, weight / 1.2 * 0.99, friction_coefficient=0.2, by="drive")
    # by what passes, (T + W) / 2: T >= W (1 - mu / 2) / (1 + mu / 2)
    least = weight * 0.9 / 1.1
    assert held(angle, least * 1.01, friction_coefficient=0.2, by="passed")
    assert not held(angle, least * 0.99, friction_coefficient=0.2, by="passed")


# --- cogging_torque of the shaft that a gear turns ----------------------------------------------


def test_teeth_of_a_gear_pull_its_output() -> None:
    """Twelve a turn, c = 0.1 N*m, a quarter of a period past zero: 0.1 N*m more holds it back."""
    teeth = {"amplitude": 0.1, "count": 12.0, "phase": math.pi / 2, "at": "output"}
    time = np.arange(0.0, 0.02, 1e-3)
    free = {"gear_friction.coulomb": 0.0, "gear_friction.viscous": 0.0}
    inputs = {"duty": np.zeros(time.size), "supply_voltage": np.full(time.size, 12.0)}
    start = {"angle": 0.0, "velocity": 0.0}
    plain = run("geared_servo", time, inputs, "", free, start)
    pulled = run("geared_servo", time, inputs, "cogging_torque", free, start, **teeth)
    # from rest: J a = 0.1 N*m, less the motor's damping, which is small in the first milliseconds
    inertia = 0.03 + 0.8 * 0.18**2
    first = (pulled["velocity"] - plain["velocity"])[1]
    assert first == pytest.approx(0.1 / inertia * 1e-3, rel=0.05)


# --- gravity_load along a slide -----------------------------------------------------------------


@compiles
def test_weight_along_a_slide_acts_as_a_constant_force() -> None:
    """Both chambers shut and F_g against extension: p_a A - p_b A = F_g once it is at rest."""
    time = np.arange(0.0, 2.0, 1e-3)
    found = run(
        "valve_cylinder", time, {"valve_command": np.zeros(time.size)}, "gravity_load",
        {"rod_friction.coulomb": 0.0, "piston_leakage.conductance": 0.0},
        gravity_force=240.0,
    )  # fmt: skip
    held = (found["pressure_a"] - found["pressure_b"])[-1] * 12e-4
    assert held == pytest.approx(240.0, rel=0.01)


# --- valve_deadband -----------------------------------------------------------------------------


def final_speed(volts: float, effect: str = "", **values: Any) -> float:
    time = np.arange(0.0, 0.5, 1e-3)
    found = run(
        "valve_cylinder", time, {"valve_command": np.full(time.size, volts)}, effect,
        {**QUICK, "rod_friction.coulomb": 0.0, "rod_friction.viscous": 18e3}, **values,
    )  # fmt: skip
    return float(found["piston_velocity"][-1])


@compiles
def test_dead_band_takes_its_width_off_the_opening() -> None:
    """2 % of 10 V: nothing below 0.2 V; above, the speed of 0.2 V less."""
    assert abs(final_speed(0.19, "valve_deadband", deadband=0.02)) < 1e-9
    assert final_speed(1.0, "valve_deadband", deadband=0.02) == pytest.approx(
        final_speed(0.8), rel=1e-6
    )
    # with asymmetry 0.5 the edges lie at +3 % and -1 %
    lopsided = {"deadband": 0.02, "asymmetry": 0.5}
    assert final_speed(1.0, "valve_deadband", **lopsided) == pytest.approx(
        final_speed(0.7), rel=1e-6
    )
    assert final_speed(-1.0, "valve_deadband", **lopsided) == pytest.approx(
        final_speed(-0.9), rel=1e-6
    )


def test_smooth_dead_band_meets_the_sharp_one_far_out_and_is_odd() -> None:
    openings = np.linspace(-0.3, 0.3, 61)
    smooth = np.array([valve_deadband.effective_opening(s, 0.02, 0.0, 1.0) for s in openings])
    sharp = np.array([valve_deadband.effective_opening(s, 0.02, 0.0, 0.0) for s in openings])
    np.testing.assert_allclose(smooth, -smooth[::-1], atol=1e-15)
    far = np.abs(openings) > 0.15
    np.testing.assert_allclose(smooth[far], sharp[far], atol=1e-10)
    assert (np.diff(smooth) > 0).all()
    # at the edge: w ln[2 / (1 + e^-6)], w = d / 3
    edge = 0.02 / 3 * math.log(2 / (1 + math.exp(-6)))
    assert valve_deadband.effective_opening(0.02, 0.02, 0.0, 1.0) == pytest.approx(edge, rel=1e-12)


# --- valve_lag ----------------------------------------------------------------------------------


@compiles
def test_lagging_valve_has_63_percent_after_its_time_constant() -> None:
    """A spool that follows at once shows the lag alone: 1 - exp(-t / tau) of the step."""
    time = np.arange(0.0, 0.05, 1e-3)
    command = np.where(time >= 9.5e-3, 5.0, 0.0)
    found = run("valve_cylinder", time, {"valve_command": command}, "valve_lag", QUICK,
                {"spool_position": 0.0}, time_constant=5e-3)  # fmt: skip
    spool = found["spool_position"]
    since = time[11:] - time[10]
    # the spool's own lag is 2 / w = 0.07 ms
    np.testing.assert_allclose(spool[11:], 0.5 * (1 - np.exp(-since / 5e-3)), atol=0.01)


def test_late_valve_goes_on_as_its_equations_solved_finely() -> None:
    """Each form beside explicit Euler at a hundred thousandth of the time constant."""
    tau, damping, lag, h = 4e-3, 0.6, 2e-3, 3e-3
    frequency = 2.0 * damping / tau
    count = 100_000
    for number in range(3):
        u, speed = 0.2, 0.0
        for _ in range(count):
            if number == 1:
                pull = frequency**2 * (1.0 - u) - 2.0 * damping * frequency * speed
                speed += pull * h / count
            else:
                speed = min((1.0 - u) / lag, 1.0 / tau) if number == 2 else (1.0 - u) / tau
            u += speed * h / count
        found = valve_lag.follow(0.2, 0.0, 1.0, 1.0, h, tau, damping, lag, float(number))
        assert found == pytest.approx(u, abs=2e-5)
        if number == 1:
            found = valve_lag.speed_after(0.0, 0.2, 1.0, h, tau, damping, 1.0)
            assert found == pytest.approx(speed, rel=1e-4)


def test_limited_valve_travels_at_its_limit_and_then_fades() -> None:
    """A stroke of 10 V in 0.1 s: for 0.09 s, to where the lag is as fast, 1 V off; then exp(-1)."""
    for h, found in ((0.05, 5.0), (0.10, 10.0 - math.exp(-1.0))):
        assert valve_lag.follow(0, 0, 10, 10, h, 0.1, 0.7, 0.01, 2) == pytest.approx(found)
        assert valve_lag.follow(0, 0, -10, 10, h, 0.1, 0.7, 0.01, 2) == pytest.approx(-found)


@compiles
@pytest.mark.parametrize("form", ["first_order", "second_order", "limited"])
def test_late_valve_that_hardly_lags_is_the_declared_one(form: str) -> None:
    time = np.arange(0.0, 0.05, 1e-3)
    given = {"valve_command": np.where(time >= 9.5e-3, 5.0, 0.0)}
    start = {"spool_position": 0.0}
    late = run("valve_cylinder", time, given, "valve_lag", QUICK, start,
               time_constant=1e-7, form=form, lag=1e-6)  # fmt: skip
    own = run("valve_cylinder", time, given, "valve_lag", QUICK, start, time_constant=0.0)
    np.testing.assert_allclose(late["spool_position"], own["spool_position"], atol=1e-3)


# --- valve_leakage ------------------------------------------------------------------------------


@compiles
@pytest.mark.parametrize("form", ["null", "constant"])
def test_leaking_valve_at_null_brings_both_chambers_halfway(form: str) -> None:
    """Equal clearances to supply and tank: (14 + 0.3) / 2 MPa less what the line drops."""
    time = np.arange(0.0, 2.0, 1e-2)
    start = {"pressure_a": 5e6, "pressure_b": 9e6, "supply_pressure": 14e6}
    leak = 2e-11
    found = run("valve_cylinder", time, {"valve_command": np.zeros(time.size)}, "valve_leakage",
                {"rod_friction.coulomb": 1e4}, start,
                leakage_coefficient=leak, form=form)  # fmt: skip
    # two paths of two clearances each: g (p_s - p_t) through the line of conductance G
    inlet = (8.3e-10 * 14e6 + leak * 3e5) / (8.3e-10 + leak)
    assert found["supply_pressure"][-1] == pytest.approx(inlet, rel=1e-6)
    for name in ("pressure_a", "pressure_b"):
        assert found[name][-1] == pytest.approx((inlet + 3e5) / 2, rel=1e-4)


# --- supply_sag ---------------------------------------------------------------------------------


@compiles
def test_sagging_supply_falls_by_resistance_times_flow() -> None:
    """A steady flow q: the supply falls by R q, the inlet by the line's drop more."""
    time = np.arange(0.0, 1.0, 1e-3)
    resistance, line, area = 5e9, 8.3e-10, 12e-4
    found = run(
        "valve_cylinder", time, {"valve_command": np.full(time.size, 2.0)}, "supply_sag",
        {"rod_friction.coulomb": 0.0, "rod_friction.viscous": 18e3,
         "piston_leakage.conductance": 0.0},
        {"piston_position": -0.05}, resistance=resistance, recovery_time=0.05,
    )  # fmt: skip
    drawn = area * found["piston_velocity"][-1]
    assert drawn > 1e-5
    fallen = 14e6 - found["supply_pressure"][-1]
    assert fallen == pytest.approx(drawn * (resistance + 1 / line), rel=1e-3)
    # after one recovery time 1 - 1/e of the way
    assert supply_sag.follow(0.0, 1e-4, 0.05, 5e9, 0.05) == pytest.approx(5e5 * (1 - math.exp(-1)))


# --- command_delay before a spool ---------------------------------------------------------------

WINCH = """\
plant: winch
nodes:
  supply: {kind: reservoir, pressure: 18 MPa}
  tank:   {kind: reservoir, pressure: 5 bar}
  line_a: {kind: volume, volume: 620 cm^3, bulk_modulus: 1.1 GPa, pressure: 80 bar}
  line_b: {kind: volume, volume: 580 cm^3, bulk_modulus: 1.1 GPa, pressure: 80 bar}
  shaft:  {kind: rotation}
  drum:   {kind: rotation, inertia: 94 kg*m^2}
elements:
  valve:    {kind: spool_valve, supply: supply, tank: tank, a: line_a, b: line_b, full_scale: 10 V,
             flow_gain: 4.7e-7 m^3/(s*Pa^0.5), natural_frequency: 60 rad/s, damping_ratio: 0.8}
  motor:    {kind: pump, on: shaft, from: line_a, to: line_b, displacement: 1.273e-5 m^3/rad}
  bearings: {kind: friction, on: shaft, coulomb: 10 N*m, viscous: 0.06 N*m*s/rad}
  gearbox:  {kind: gear, from: shaft, to: drum, ratio: 25}
inputs:   {valve_command: valve.command}
channels: {motor_speed: shaft.speed, drum_speed: drum.speed, pressure_a: line_a.pressure,
           pressure_b: line_b.pressure}
"""


def winch(folder: Path, effect: str) -> Model:
    """A valve with a slow spool that turns a drum through a gear."""
    (folder / "plant.yaml").write_text(WINCH, encoding="utf-8")
    (folder / "model.yaml").write_text(
        f"model: plant.yaml\neffects:\n  - {{{effect}}}\n", encoding="utf-8"
    )
    return load_model(folder / "model.yaml")


@compiles
def test_a_window_begins_with_the_spool_where_its_late_command_had_left_it(tmp_path: Path) -> None:
    """A run that is followed from its midst goes on as the whole one does."""
    model = winch(tmp_path, "effect: command_delay, delay: 9 ms")
    time = np.arange(0.0, 1.2, 2.5e-3)
    command = 3.0 * np.sign(np.sin(2.0 * np.pi * 7.0 * time)) + 1.0
    at = model.plant.at(model.vector())
    start = {"pressure_a": 8e6, "pressure_b": 8e6, "drum_speed": 0.0}
    whole = at.simulate(Drive(time, {"valve_command": command}), start, 1e-4)
    names, first = list(model.plant.outputs), 300
    there = {name: float(whole[first, names.index(name)]) for name in start}
    later = at.simulate(Drive(time, {"valve_command": command}, first=first), there, 1e-4)
    for name in start:
        column = names.index(name)
        assert later[first:, column] == pytest.approx(
            whole[first:, column], abs=2e-3 * np.ptp(whole[:, column])
        )


@compiles
def test_a_geared_pumps_friction_is_its_own_share_of_its_torque(tmp_path: Path) -> None:
    """mu D dp at the motor is 25 mu D dp at the drum, which it stops where the rest is less."""
    for coefficient, moves in ((0.5, True), (1.0, False)):
        model = winch(
            tmp_path,
            f"effect: pressure_dependent_friction, friction_coefficient: {coefficient}",
        )
        time = np.arange(0.0, 0.5, 2.5e-3)
        start = {"pressure_a": 8e6, "pressure_b": 8e6, "drum_speed": 0.0}
        command = {"valve_command": np.full(time.size, 10.0)}
        found = model.plant.at(model.vector()).simulate(Drive(time, command), start, 1e-4)
        speed = found[:, list(model.plant.outputs).index("drum_speed")]
        assert bool(np.abs(speed).max() > 1e-6) is moves


@compiles
def test_a_late_command_turns_a_hysteresis_as_it_turned_long_ago(tmp_path: Path) -> None:
    """Turns before the history have arrived, in their order: the loop is where they left it."""
    model = winch(tmp_path, "effect: command_delay, delay: 9 ms")
    text = (tmp_path / "model.yaml").read_text(encoding="utf-8")
    text += "  - {effect: valve_hysteresis, hysteresis: 0.1}\n"
    (tmp_path / "model.yaml").write_text(text, encoding="utf-8")
    model = load_model(tmp_path / "model.yaml")
    at = model.plant.at(model.vector())
    time = np.arange(0.0, 1.5, 2.5e-3)
    # large turns early, then small ones within the loop that these had left
    command = np.where(time < 0.5, 4.0 * np.sin(2.0 * np.pi * 4.0 * time + 0.4), 0.0)
    command = np.where(time >= 0.5, 1.0 + 0.3 * np.sin(2.0 * np.pi * 3.0 * time), command)
    start = {"pressure_a": 8e6, "pressure_b": 8e6, "drum_speed": 0.0}
    whole = at.simulate(Drive(time, {"valve_command": command}), start, 1e-4)
    names, first, lead = list(model.plant.outputs), 480, 380
    there = {name: float(whole[first, names.index(name)]) for name in start}
    slopes = np.diff(command)
    turns = np.flatnonzero(slopes[:-1] * slopes[1:] < 0.0) + 1
    turns = turns[turns < lead]
    rows = np.array([*turns, *range(lead, time.size)])
    stamps = time[rows]
    stamps[: turns.size] = time[lead] - 1e-9 * np.arange(turns.size, 0, -1)
    drive = Drive(
        stamps, {"valve_command": command[rows]}, first=turns.size + first - lead, turns=turns.size
    )
    later = at.simulate(drive, there, 1e-4)
    for name in start:
        column = names.index(name)
        span = np.ptp(whole[first:, column])
        assert later[drive.first :, column] == pytest.approx(whole[first:, column], abs=0.01 * span)
