"""Known answers of friction, ripple, backlash and load: torque and force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from eha_bench.core.linkage import Linkage
from eha_bench.plants.effects import (
    cogging_torque,
    coulomb_friction,
    gravity_load,
    joint_backlash,
    presliding_friction,
    pump_ripple,
    seal_friction,
)
from eha_bench.plants.elements import knee_linkage
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.plant import Drive

LONG = np.arange(0.0, 1.5, 1e-3)
# the shaft settles within 20 ms, against an open bypass
LIGHT = {"rotor_inertia": 1e-4, "bypass_conductance": 1e-8}


def _terminal_speed(knee, current, *effects, **parameters):
    """Steady speed of the shaft with the bypass wide open and no load."""
    out = knee.run(LONG, current, *effects, bypass=True, **LIGHT, **parameters)
    return out["motor_speed"][-1]


def _current_for(torque, knee, omega):
    ratio = omega / 18.0
    level = 0.16 + (0.2537 - 0.16) * np.exp(-ratio * ratio)
    # the open bypass takes D^2 w / G
    back = knee.model().value("pump_displacement") ** 2 * abs(omega) / 1e-8
    return (np.sign(omega) * level + 0.00498 * omega + np.sign(omega) * (torque + back)) / 0.13


@pytest.mark.parametrize("omega", [60.0, -60.0])
def test_steady_speed_obeys_the_friction_curve(knee, omega) -> None:
    """Eq. (23): with the ports connected K_T i is the friction at that speed."""
    assert _terminal_speed(knee, _current_for(0.0, knee, omega)) == pytest.approx(omega, rel=1e-3)


@pytest.mark.parametrize("omega", [60.0, -60.0])
@pytest.mark.parametrize("kind", ["dry", "viscous", "all"])
def test_asymmetry_of_the_pump_takes_its_share(knee, effect, omega, kind) -> None:
    dry = 0.16 + (0.2537 - 0.16) * np.exp(-((omega / 18.0) ** 2))
    share = {"dry": dry, "viscous": 0.00498 * abs(omega), "all": dry + 0.00498 * abs(omega)}[kind]
    current = _current_for(0.2 * np.sign(omega) * share, knee, omega)
    got = _terminal_speed(
        knee, current, effect("asymmetric_friction", asymmetry=0.2, at="shaft", kind=kind)
    )
    assert got == pytest.approx(omega, rel=1e-3)


def test_dry_friction_of_the_shaft_is_a_torque(knee, effect) -> None:
    current = _current_for(0.09, knee, 60.0)
    got = _terminal_speed(
        knee, current, effect("coulomb_friction", friction_force=0.09, at="shaft")
    )
    assert got == pytest.approx(60.0, rel=1e-3)


def test_pump_declared_without_friction_gets_it_back_with_the_effect(knee, effect) -> None:
    """Coulomb, static ratio and the plant's Stribeck speed: the declared law, Eq. (3)."""
    time = np.arange(0.0, 0.3, 1e-3)
    command = 12.0 * np.sin(2 * np.pi * 5 * time)
    added = effect(
        "coulomb_friction", friction_force=0.16, at="shaft", form="stribeck",
        static_ratio=0.2537 / 0.16, stribeck_velocity=18.0,
    )  # fmt: skip
    got = knee.run(time, command, added, coulomb_torque=0.0, static_torque=0.0)
    declared = knee.run(time, command)
    for name, values in declared.items():
        np.testing.assert_allclose(got[name], values, atol=1e-9 * np.ptp(values) + 1e-15)


@pytest.mark.parametrize("sign", [1, -1])
def test_loaded_pump_takes_friction_in_proportion_to_pressure(knee, effect, sign) -> None:
    """At rest the pump holds T_sf + mu D dp: a larger band of currents holds one pressure."""
    time = np.arange(0.0, 0.05, 1e-3)
    dp = 10e6
    start = {"pressure_a": 0.6e6 + dp, "pressure_b": 0.6e6}
    load = knee.model().value("pump_displacement") * dp
    edge = (load + sign * (0.2537 + 0.05 * load)) / 0.13
    friction = effect("pressure_dependent_friction", friction_coefficient=0.05)
    for shift, moves in ((-0.02, False), (0.02, True)):
        out = knee.run(time, edge + sign * shift, friction, initial=start, leakage=0.0)
        assert (np.max(np.abs(out["motor_speed"])) > 0) == moves


def test_viscosity_falls_exponentially(knee, effect) -> None:
    """Slow drift: the torque for a steady speed falls with the coefficient."""
    rate, end = 0.2, LONG[-1]
    torque = 0.00498 * 60.0 * (np.exp(-rate * end) - 1.0)
    got = _terminal_speed(
        knee, _current_for(torque, knee, 60.0), effect("viscosity_drift", rate=rate)
    )
    assert got == pytest.approx(60.0, rel=0.03)


def test_warm_oil_is_as_thin_as_the_law_says(knee, effect) -> None:
    inputs = {
        "current_command": np.full(LONG.size, _current_for(-0.5 * 0.00498 * 60.0, knee, 60.0)),
        "oil_temperature": np.full(LONG.size, 313.15 + np.log(2) / 0.02),
    }
    out = knee.run(
        LONG, inputs, effect("viscosity_temperature", temperature_coefficient=0.02), bypass=True,
        **LIGHT,
    )  # fmt: skip
    assert out["motor_speed"][-1] == pytest.approx(60.0, rel=1e-3)


def test_cogging_is_a_series_of_two_harmonics() -> None:
    """c [sin(N theta + phi) + s sin(2 N theta + psi)], by hand; s counts only if asked for."""
    own = cogging_torque.Pull(0.4, np.pi / 2, 1.0, 0.5, 0.0)
    # theta = 15 degrees: N theta = pi/2, so sin(pi) + 0.5 sin(pi) = 0
    assert cogging_torque.cogging(1.0, np.pi / 12, 3.0, 6.0, own) == pytest.approx(1.0)
    # theta = 7.5 degrees: sin(3 pi / 4) + 0.5 sin(pi / 2) = 0.7071 + 0.5
    assert cogging_torque.cogging(1.0, np.pi / 24, 3.0, 6.0, own) == pytest.approx(
        1 + 1.2 * 1.2071068
    )
    one = own._replace(harmonics=0.0)
    assert cogging_torque.cogging(0.0, np.pi / 24, 1.0, 6.0, one) == pytest.approx(0.4 * 0.7071068)


@pytest.mark.parametrize(("form", "fall"), [(0.0, 0.0), (1.0, np.exp(-0.25)), (2.0, np.exp(-0.5))])
def test_dry_friction_falls_with_the_square_or_the_speed_itself(form, fall) -> None:
    """At half the Stribeck velocity, r = 1.4: 5 + 1.2 e^(-1/4) or 5 + 1.2 e^(-1/2)."""
    for speed in (-0.05, 0.05):
        level = coulomb_friction.dry_friction(2.0, speed, 3.0, form, 1.4, 0.1)
        assert level == pytest.approx(5.0 + 1.2 * fall)


def test_cogging_repeats_with_the_angle(knee, effect) -> None:
    """The period of the speed's ripple, times the mean speed, is a full turn over the count."""
    out = knee.run(
        LONG, 8.0, effect("cogging_torque", amplitude=0.05, count=24.0), bypass=True,
        **LIGHT,
    )  # fmt: skip
    speed = out["motor_speed"][-1000:]
    spectrum = np.abs(np.fft.rfft((speed - speed.mean()) * np.hanning(1000)))
    peak = np.argmax(spectrum[3:]) + 3
    expected = 24.0 * speed.mean() / (2 * np.pi)
    # sampled at 1 kHz: the ripple may be folded
    folded = abs(expected - 1000.0 * np.round(expected / 1000.0))
    assert peak == pytest.approx(folded, abs=2.0)


def test_cogging_holds_the_shaft_in_its_valleys(bare_knee, effect) -> None:
    """Without friction the rotor swings about the angle where the cogging torque vanishes."""
    time = np.arange(0.0, 0.5, 2.5e-4)
    cogging = effect("cogging_torque", amplitude=0.05, count=12.0, phase=np.pi)
    initial = {"shaft_angle": 0.0, "motor_speed": 0.1}
    out = bare_knee.run(time, 0.0, cogging, initial=initial, bypass=True, bypass_conductance=0.0)
    oil = 2 * 9e8 * bare_knee.model().value("pump_displacement") ** 2 / 1.2535e-5
    frequency = np.sqrt((0.05 * 12.0 + oil) / 0.001)
    np.testing.assert_allclose(out["motor_speed"], 0.1 * np.cos(frequency * time), atol=2e-3)


def test_pump_ripple_moves_the_oil_of_its_angle(bare_knee, effect) -> None:
    """The oil delivered is the integral of D (1 + r cos(z theta)), in closed form."""
    time = np.arange(0.0, 0.1, 1e-3)
    omega, ripple, count = 15.0, 0.2, 7.0
    out = bare_knee.run(
        time, {"motor_speed": np.full(time.size, omega)},
        effect("pump_ripple", ripple=ripple, count=count), step=5e-6,
    )  # fmt: skip
    theta = omega * time
    oil = theta + ripple * np.sin(count * theta) / count
    displacement = bare_knee.model().value("pump_displacement")
    expected = 0.6e6 + 9e8 / 1.2535e-5 * displacement * oil
    np.testing.assert_allclose(out["pressure_a"], expected, atol=1e-4 * np.ptp(expected))


@given(theta=st.floats(-20, 20), dp=st.floats(-3e7, 3e7), omega=st.floats(-300, 300))
def test_ideal_ripple_gives_the_oil_what_it_takes_from_the_shaft(theta, dp, omega) -> None:
    for pulse in (0.0, 1.0):
        own = pump_ripple.Pulses(0.1, 0.3, pulse, 1.0, 1.0)
        flow = pump_ripple.delivery(1e-7 * omega, theta, 9.0, own)
        torque = pump_ripple.reaction(-1e-7 * dp, theta, dp, 1e-7, 1.0, 9.0, own)
        assert flow * dp == pytest.approx(-torque * omega, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("pistons", "count"), [(5, 10.0), (7, 14.0), (8, 8.0), (9, 18.0)])
def test_pulses_of_pistons_are_the_sum_of_their_strokes(pistons: int, count: float) -> None:
    """Every piston delivers its sine while it moves in; the sum of all has cusps."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    shift = 2.0 * np.pi * np.arange(pistons)[:, None] / pistons
    flow = np.maximum(np.sin(angle + shift), 0.0).sum(axis=0)
    flow /= flow[:-1].mean()
    ripple = 0.5 * np.ptp(flow)
    top = angle[np.argmax(flow)]
    own = pump_ripple.Pulses(ripple, -count * top, 1.0, 0.0, 1.0)
    got = np.array([pump_ripple.delivery(1.0, one, count, own) for one in angle])
    assert np.max(np.abs(got - flow)) < 0.03 * ripple
    assert got[:-1].mean() == pytest.approx(1.0, abs=1e-6)


def test_a_share_of_the_pulses_reaches_the_shaft(bare_knee, effect) -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    runs = {}
    both = {"acts_on": "flow_and_torque"}
    for name, own in (("flow", {}), ("none", {**both, "torque_share": 0.0}), ("all", both)):
        ripple = effect("pump_ripple", ripple=0.3, count=7.0, **own)
        runs[name] = bare_knee.run(time, 5.0, ripple)["motor_speed"]
    np.testing.assert_allclose(runs["none"], runs["flow"], rtol=0, atol=1e-9)
    assert np.max(np.abs(runs["all"] - runs["flow"])) > 0.1


def test_rod_friction_of_each_effect_holds_up_to_its_level(knee, effect) -> None:
    """The external force at which the resting rod gives way is the sum of all dry friction."""
    area = knee.model().value("piston_area_a")
    time = np.arange(0.0, 0.03, 1e-3)
    cases = (
        (effect("coulomb_friction", friction_force=40.0, at="rod"), 100.0),
        (effect("asymmetric_friction", asymmetry=-0.5, at="rod", kind="dry"), 90.0),
        (effect("seal_friction", friction_coefficient=0.05, pressure="sum"),
         60.0 + 0.05 * area * 1.2e6),
        (effect("seal_friction", friction_coefficient=0.05, pressure="higher"),
         60.0 + 0.05 * area * 0.6e6),
        (effect("seal_friction", friction_coefficient=0.05, pressure="difference"), 60.0),
        (effect("seal_friction", friction_coefficient=0.05, pressure="b"),
         60.0 + 0.05 * area * 0.6e6),
    )  # fmt: skip
    for friction, level in cases:
        for force, moves in ((level - 0.5, False), (level + 0.5, True)):
            out = knee.run(time, 0.0, friction, locked=False, external_force=force)
            assert (np.min(out["piston_velocity"]) < 0) == moves, friction


def test_asymmetry_scales_what_other_effects_add(knee, effect) -> None:
    time = np.arange(0.0, 0.03, 1e-3)
    effects = (
        effect("coulomb_friction", friction_force=40.0, at="rod"),
        effect("asymmetric_friction", asymmetry=-0.5, at="rod"),
    )
    for force, moves in ((149.5, False), (150.5, True)):
        out = knee.run(time, 0.0, *effects, locked=False, external_force=force)
        assert (np.min(out["piston_velocity"]) < 0) == moves


@given(
    p_a=st.floats(-1e6, 4e7),
    p_b=st.floats(-1e6, 4e7),
    which=st.sampled_from([0.0, 1.0, 2.0, 3.0, 4.0]),
)
def test_seal_friction_never_pushes(p_a, p_b, which) -> None:
    assert seal_friction.dry(60.0, p_a, p_b, 3e-4, 0.02, which, 0.0) >= 60.0
    assert seal_friction.viscous(800.0, p_a, p_b, 3e-4, 0.02, which, 1.0) >= 800.0


@pytest.mark.parametrize(
    ("which", "pressing"), [(0.0, 9e6), (1.0, 3e6), (2.0, 6e6), (3.0, 3e6), (4.0, 6e6)]
)
def test_seals_are_pressed_by_the_pressure_that_is_named(which, pressing) -> None:
    level = seal_friction.dry(60.0, 3e6, 6e6, 1e-3, 0.02, which, 0.0)
    assert level == pytest.approx(60.0 + 0.02 * 1e-3 * pressing)


def test_behind_a_gear_seals_have_the_rods_own_coefficient() -> None:
    """At half the speed a force of 80 N is one of 40 N where it is felt, and c v of c v / 4."""
    own = (6e6, 2e6, 1e-3, 0.02, 1.0)
    assert seal_friction.dry(60.0, *own, 0.0, 0.5) == pytest.approx(60.0 + 40.0)
    assert seal_friction.viscous(0.0, *own, 1.0, 0.5) == pytest.approx(80.0 / 0.1 / 4.0)


def test_seals_on_a_film_drag_with_speed(knee, effect) -> None:
    """Half as strong at 0.05 m/s as its share of the hydraulic force says, and none at rest."""
    force = seal_friction.viscous(0.0, 6e6, 2e6, 1e-3, 0.02, 1.0, 1.0) * 0.05
    assert force == pytest.approx(0.5 * 0.02 * 1e-3 * 4e6)
    assert seal_friction.dry(60.0, 6e6, 2e6, 1e-3, 0.02, 1.0, 1.0) == 60.0
    assert seal_friction.viscous(800.0, 6e6, 2e6, 1e-3, 0.02, 1.0, 0.0) == 800.0
    time = np.arange(0.0, 0.03, 1e-3)
    pressed = effect("seal_friction", friction_coefficient=0.05, kind="viscous")
    for force, moves in ((59.5, False), (60.5, True)):
        out = knee.run(time, 0.0, pressed, locked=False, external_force=force)
        assert (np.min(out["piston_velocity"]) < 0) == moves


@given(
    steps=st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(1e-5, 1e-2)), min_size=1, max_size=30),
    start=st.floats(-1, 1),
    softening=st.sampled_from([0.0, 1.0]),
)
def test_bristles_stay_within_their_friction_and_take_energy_from_a_closed_path(
    steps, start, softening
) -> None:
    z = start
    for v, h in steps:
        z = presliding_friction.bend(z, v, h, 1e-4, softening)
        assert -1.0 <= z <= 1.0


def test_bristles_are_a_spring_at_first_and_full_friction_later() -> None:
    s = 1e-4
    short = presliding_friction.bend(0.0, 1e-3, 1e-4, s, 0.0)  # 1e-7 m
    assert short == pytest.approx(1e-7 / s, rel=1e-3)
    assert presliding_friction.bend(0.0, 1e-2, 1.0, s, 0.0) == pytest.approx(1.0, abs=1e-9)
    assert presliding_friction.bend(1.0, -1e-2, 1.0, s, 0.0) == pytest.approx(-1.0, abs=1e-9)


@given(z=st.floats(-1, 1), v=st.floats(-1, 1))
def test_bristles_that_soften_early_follow_dahls_equation(z, v) -> None:
    """dz/dt = v (1 - sign(v) z)^2 / s, by SciPy's integrator, and as the damping takes it."""
    s, h = 1e-4, 3e-4

    def slope(_, state):
        return [v * (1.0 - np.sign(v) * state[0]) ** 2 / s]

    exact = solve_ivp(slope, (0.0, h), [z], method="LSODA", rtol=1e-10, atol=1e-12).y[0, -1]
    assert presliding_friction.bend(z, v, h, s, 1.0) == pytest.approx(exact, abs=1e-6)
    force = presliding_friction.pull(0.0, 1.0, v, z, s, 1e-3, 1.0)
    assert force == pytest.approx(-z - 1e-3 * slope(0.0, [z])[0], abs=1e-9)


@pytest.mark.parametrize("softening", [0.0, 1.0])
@given(amplitude=st.floats(1e-5, 2e-3), distance=st.floats(1e-5, 1e-3))
@settings(max_examples=30)
def test_bristles_do_work_on_nothing_over_a_cycle(softening, amplitude, distance) -> None:
    """Once round a closed path the bristles take energy (Dahl's loop turns one way)."""
    phase = np.linspace(0, 4 * np.pi, 4001)
    x = amplitude * np.sin(phase)
    z, work = 0.0, []
    for dx in np.diff(x):
        after = presliding_friction.bend(z, np.sign(dx), abs(dx), distance, softening)
        work.append(0.5 * (z + after) * dx)
        z = after
    assert sum(work[2000:]) >= -1e-12


@pytest.mark.parametrize(
    ("place", "distance", "channel"),
    [("rod", 1e-7, "piston_position"), ("shaft", 2.9e-5, "motor_speed")],
)
def test_narrow_bristles_are_stiction(knee, effect, place, distance, channel) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    command = 4.0 * np.sin(2 * np.pi * 4 * time)
    plain = knee.run(time, command, locked=False)
    bristles = effect("presliding_friction", distance=distance, at=place, damping_time=0.0)
    bent = knee.run(time, command, bristles, locked=False, step=5e-6)
    worst = np.max(np.abs(plain[channel] - bent[channel]))
    assert worst < 1e-2 * np.ptp(plain[channel])


@pytest.mark.parametrize("softening", [0.0, 1.0])
@given(z=st.floats(-1, 1), v=st.floats(-1, 1), tau=st.floats(0, 0.01))
def test_bending_bristles_only_take_energy_beyond_their_spring(softening, z, v, tau) -> None:
    """What damping adds to the spring's force opposes the motion: v dz/dt >= 0."""
    pull = presliding_friction.pull(0.0, 1.0, v, z, 1e-4, tau, softening)
    spring = presliding_friction.pull(0.0, 1.0, v, z, 1e-4, 0.0, softening)
    assert (pull - spring) * v <= 1e-12
    assert spring == -z


def test_bristles_of_the_pump_are_a_spring_under_a_small_torque(knee, effect) -> None:
    """With the bypass open a torque T turns the shaft by s A / D atanh-like: -s ln(1 - T/T_s)."""
    time = np.arange(0.0, 1.0, 1e-3)
    torque = 0.1
    ratio = knee.model().value("piston_area_a") / knee.model().value("pump_displacement")
    bristles = effect("presliding_friction", distance=1e-4 * ratio, at="shaft")
    out = knee.run(
        time, torque / 0.13, bristles, bypass=True, bypass_conductance=1e-8, coulomb_torque=0.2537,
        viscous_torque=0.1,
    )  # fmt: skip
    turned = np.sum(out["motor_speed"]) * 1e-3
    assert abs(out["motor_speed"][-1]) < 5e-3
    assert turned == pytest.approx(-1e-4 * ratio * np.log(1 - torque / 0.2537), rel=0.02)


@given(moves=st.lists(st.floats(-2e-3, 2e-3), min_size=1, max_size=50), gap=st.floats(1e-5, 1e-3))
def test_play_keeps_within_half_the_gap_and_only_moves_when_driven(moves, gap) -> None:
    x, y = 0.0, 0.0
    for move in moves:
        x += move
        later = joint_backlash.drag(y, x, gap)
        assert abs(x - later) <= gap / 2 + 1e-15
        if later != y:
            assert abs(x - later) == pytest.approx(gap / 2)
        y = later


def test_play_lags_by_half_the_gap_each_way(knee, effect) -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    command = 10.0 * np.sin(2 * np.pi * 4 * time)
    plain = knee.run(time, command, locked=False)
    for side, velocity in (("position_sensor", False), ("joint", True)):
        got = knee.run(time, command, effect("joint_backlash", gap=4e-4, side=side), locked=False)
        lag = plain["piston_position"] - got["piston_position"]
        assert np.max(np.abs(lag)) == pytest.approx(2e-4, rel=1e-6)
        fast = np.abs(plain["piston_velocity"]) > 0.9 * np.max(plain["piston_velocity"])
        expected = 2e-4 * np.sign(plain["piston_velocity"][fast])
        np.testing.assert_allclose(lag[fast], expected, atol=1e-9)
        zeros = np.sum((got["piston_velocity"] == 0) & (plain["piston_velocity"] != 0))
        assert (zeros > 0) == velocity


def test_first_reading_beyond_a_play_fixes_where_the_rod_is(knee, effect) -> None:
    time = np.arange(0.0, 0.01, 1e-3)
    gap = effect("joint_backlash", gap=4e-4)
    start = {"piston_position": 1e-3, "piston_velocity": 0.1}
    out = knee.run(time, 0.0, gap, locked=False, initial=start)
    assert out["piston_position"][0] == pytest.approx(1e-3)
    assert out["piston_position"][1] > 1e-3, "it moves on at once: the joint was driven"


def test_load_beyond_a_play_coasts_while_the_gap_is_crossed(knee, effect) -> None:
    """Reversing, the rod alone is light: it crosses the gap faster than it moves its load."""
    time = np.arange(0.0, 0.5, 1e-3)
    command = 10.0 * np.sin(2 * np.pi * 4 * time)
    plain = knee.run(time, command, locked=False)
    play = effect("joint_backlash", gap=1e-3, side="load")
    got = knee.run(time, command, play, locked=False)
    assert np.all(np.isfinite(got["piston_position"]))
    jump = np.max(np.abs(np.diff(got["piston_velocity"])))
    assert jump > 3 * np.max(np.abs(np.diff(plain["piston_velocity"])))
    # the load's coasting carries no more than the gap to the rod's reading
    worst = np.max(np.abs(got["piston_position"] - plain["piston_position"]))
    assert worst < 2e-3


@pytest.mark.parametrize("step", [2e-6, 5e-4])
def test_tight_joint_moves_as_one_mass_at_any_step(knee, effect, step) -> None:
    time = np.arange(0.0, 0.3, 1e-3)
    command = 10.0 * np.sin(2 * np.pi * 4 * time)
    plain = knee.run(time, command, locked=False, external_force=300.0)
    play = effect("joint_backlash", gap=1e-9, side="load", rod_mass=0.5, joint_stiffness=1e8)
    got = knee.run(time, command, play, locked=False, external_force=300.0, step=step)
    worst = np.max(np.abs(got["piston_position"] - plain["piston_position"]))
    assert worst < 0.02 * np.ptp(plain["piston_position"])


def test_load_may_begin_anywhere_in_its_gap(knee, effect) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    path = {}
    for rest in (1.0, 0.0, -1.0):
        play = effect("joint_backlash", gap=2e-3, side="load", rest=rest)
        out = knee.run(time, np.full(time.size, 10.0), play, locked=False, external_force=300.0)
        path[rest] = out["piston_position"]
    # the further the load falls before it meets the rod, the harder it pushes it back
    fell = [np.max(np.abs(path[rest] - path[1.0])) for rest in (0.0, -1.0)]
    assert fell[1] > 1.2 * fell[0] > 1e-4


@pytest.mark.parametrize(("posture", "share"), [(0.0, 1.0), (1.0, 0.5)])
def test_weight_needs_the_force_of_the_linkage(posture, share) -> None:
    """The virtual work of the rod's force is that of the weight about the knee."""
    linkage = Linkage(0.3208, 0.0462, 0.280, 0.04)
    for x in (-0.02, 0.0, 0.02):
        position = np.array([x - 1e-6, x + 1e-6])
        angle = linkage.angle(position)
        height = (
            25.0 / share * np.sin(share * angle - 0.7)
        )  # potential energy of G cos(alpha - alpha_0)
        expected = -(height[1] - height[0]) / 2e-6
        shape = (x, 0.3208, 0.0462, 0.280, 1.2535e-5, 1.2535e-5 / 0.04)
        turns = knee_linkage.joint_angle_per_rod(*shape)
        got = gravity_load.effort_with_gravity(
            0.0, knee_linkage.angle(*shape), turns, 25.0, 0.7, posture
        )
        assert got == pytest.approx(expected, rel=1e-6)


def test_heavier_rod_friction_only_takes_energy(bare_knee, effect) -> None:
    """A rod let go without drive comes to rest: no friction effect keeps it going."""
    time = np.arange(0.0, 0.3, 1e-3)
    start = {"piston_velocity": 0.3}
    for friction in (
        effect("coulomb_friction", friction_force=50.0, at="rod"),
        effect("presliding_friction", distance=1e-4, at="rod"),
        effect("seal_friction", friction_coefficient=0.05),
        effect("seal_friction", friction_coefficient=0.05, kind="viscous"),
        effect("asymmetric_friction", asymmetry=0.5, at="rod", kind="all"),
    ):
        out = bare_knee.run(
            time, {"motor_speed": np.zeros(time.size)}, friction, locked=False, bypass=True,
            initial=start, bypass_conductance=1e-8, rod_coulomb=30.0, rod_viscous=100.0,
            initial_pressure=5e6, step=5e-6,
        )  # fmt: skip
        speed = np.abs(out["piston_velocity"])
        assert speed.max() <= 0.3 * (1 + 1e-6), friction
        assert speed[-1] < 0.1, friction


PENDULUM = """
plant: pendulum_drive
nodes:
  motor_shaft: {kind: rotation}
  output:      {kind: rotation, inertia: 0.03 kg*m^2}
elements:
  motor:    {kind: motor, on: motor_shaft, resistance: 2.3 ohm, torque_constant: 0.0083 N*m/A}
  gear:     {kind: gear, from: motor_shaft, to: output, ratio: 193}
  pendulum: {kind: pendulum, on: output, mass: 0.8 kg, length: 180 mm}
  friction: {kind: friction, on: output, viscous: 0.1 N*m*s/rad}
inputs:   {duty: motor.duty, supply_voltage: motor.supply_voltage}
channels: {angle: output.angle, velocity: output.speed}
"""


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory) -> Model:
    file = tmp_path_factory.mktemp("pendulum") / "plant.yaml"
    file.write_text(PENDULUM)
    return load_model(file)


SWING = np.arange(0.0, 2.0, 1e-3)


def swung(model: Model, play: DeclaredEffect | None, step: float = 2e-5) -> dict[str, np.ndarray]:
    inputs = {"duty": 0.4 * np.sin(5.0 * SWING), "supply_voltage": np.full(SWING.size, 12.0)}
    model = model if play is None else model.with_effect(play)
    drive = Drive(SWING, inputs, {"angle": 0.3, "velocity": 0.0})
    out = model.plant.simulate(model.vector(), drive, step)
    return dict(zip(model.plant.outputs, out.T, strict=True))


GAP, STIFFNESS = 0.2, 3e3


@pytest.fixture(scope="module")
def two_masses() -> np.ndarray:
    """The shaft's angle by the two balances of the docstring and an implicit solver."""
    ratio, torque, resistance, own, hung = 193, 0.0083, 2.3, 0.03, 0.8 * 0.18
    damping = 2.0 * 0.5 * np.sqrt(STIFFNESS * own)

    def slope(t: float, y: np.ndarray) -> list[float]:
        x, v, x_load, v_load = y
        deep = max(abs(x - x_load) - 0.5 * GAP, 0.0)
        side = 1.0 if x > x_load else -1.0
        pushed = side * STIFFNESS * deep + (damping * (v - v_load) if deep > 0.0 else 0.0)
        pushed = side * max(side * pushed, 0.0)
        volts = 12.0 * 0.4 * math.sin(5.0 * math.floor(t * 1e3 + 1e-9) / 1e3)
        drive = torque * ratio * (volts - torque * ratio * v) / resistance
        weight = hung * 9.80665 * math.sin(x_load)
        return [v, (drive - 0.1 * v - pushed) / own, v_load, (pushed - weight) / (hung * 0.18)]

    # the weight leans on the lower end, and squeezes it
    squeezed = hung * 9.80665 * np.sin(0.3) / STIFFNESS
    first = [0.3, 0.0, 0.3 - 0.5 * GAP - squeezed, 0.0]
    found = solve_ivp(
        slope, (0.0, 2.0), first, "LSODA", SWING, rtol=1e-9, atol=1e-11, max_step=1e-4
    )
    return found.y[0]


@pytest.mark.parametrize(("step", "share"), [(1e-3, 0.01), (2e-5, 1e-3)])
def test_pendulum_behind_a_play_falls_through_it_as_two_masses_do(
    pendulum, two_masses, effect, step: float, share: float
) -> None:
    play = effect("joint_backlash", gap=GAP, side="load", joint_stiffness=STIFFNESS)
    got, plain = swung(pendulum, play, step), swung(pendulum, None)
    seen = np.max(np.abs(plain["angle"] - two_masses))
    assert seen > 0.05
    assert np.max(np.abs(got["angle"] - two_masses)) < share * seen


@pytest.mark.parametrize("step", [1e-3, 2e-5])
def test_a_pendulum_behind_no_play_hangs_on_its_shaft(pendulum, effect, step: float) -> None:
    tight = swung(pendulum, effect("joint_backlash", gap=1e-6, side="load"), step)
    plain = swung(pendulum, None)
    assert np.max(np.abs(tight["angle"] - plain["angle"])) < 0.002 * np.ptp(plain["angle"])
