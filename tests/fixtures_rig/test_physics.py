"""The rig's equations against hand-worked cases: energy, equilibria, limits, frequencies."""

import math

import numpy as np
import pytest
from fixtures.rig import kernel as k
from fixtures.rig.commands import Run
from fixtures.rig.parameters import DECLARED, record
from fixtures.rig.plant import Plant
from hypothesis import given
from hypothesis import strategies as st

FRICTIONLESS = {
    "coulomb_torque": 0.0, "static_torque": 0.0, "viscous_torque": 0.0, "leakage": 0.0,
    "rod_viscous": 0.0, "rod_coulomb": 0.0, "external_force": 0.0, "valve_conductance": 0.0,
    "rod_creep_speed": 0.0,
}  # fmt: skip


def driven(current: np.ndarray, locked: bool = True, bypass: bool = False) -> Run:
    return Run("test", locked, bypass, False, k.OPEN_LOOP, 0, current, np.zeros_like(current))


def started(plant: Plant, **at: float) -> np.ndarray:
    state = k.start_state(at.pop("POSITION", 0.0), plant.parameters)
    for name, value in at.items():
        state[getattr(k, name)] = value
    return k.state_from(state, plant.parameters)


def test_rotor_and_oil_swing_at_their_natural_frequency() -> None:
    plant = Plant(FRICTIONLESS)
    state = started(plant, PRESSURE_A=6e6, PRESSURE_B=4e6)
    y = plant.replay(driven(np.zeros(2000)), np.zeros(2000), state)
    stiffness = DECLARED["pump_displacement"] ** 2 * 2.0 * 900e6 / DECLARED["volume_a"]
    rate = math.sqrt(stiffness / DECLARED["rotor_inertia"])
    t = np.arange(2000) * k.TICK
    np.testing.assert_allclose(y[:, 2] - y[:, 3], 2e6 * np.cos(rate * t), atol=2e3)
    amplitude = 2e6 * DECLARED["pump_displacement"] / (DECLARED["rotor_inertia"] * rate)
    np.testing.assert_allclose(y[:, 1], -amplitude * np.sin(rate * t), atol=1e-3 * amplitude)


def energy(y: np.ndarray) -> np.ndarray:
    """Kinetic and elastic energy, J, about mid-stroke with little piston travel."""
    elastic = DECLARED["volume_a"] / (2.0 * 900e6) * ((y[:, 2] - 5e6) ** 2 + (y[:, 3] - 5e6) ** 2)
    kinetic = 0.5 * DECLARED["rotor_inertia"] * y[:, 1] ** 2 + 0.5 * 60.0 * y[:, 5] ** 2
    return np.asarray(elastic + kinetic)


def test_without_friction_energy_is_kept() -> None:
    plant = Plant(FRICTIONLESS)
    state = started(plant, PRESSURE_A=5.2e6, PRESSURE_B=4.8e6, SPEED=2.0, ROTOR_SPEED=2.0)
    y = plant.replay(driven(np.zeros(3000), locked=False), np.zeros(3000), state)
    e = energy(y)
    # The chambers' stiffness varies a little over the stroke: not exact energy.
    assert np.ptp(e) < 0.03 * e[0]


@pytest.mark.parametrize(
    "effect",
    [
        {},
        {"pressure_friction": 0.1},
        {"turbulent_leakage": 1e-10},
        {"external_leakage": 0.0},
        {"bristle_stiffness": 30.0, "bristle_damping": 0.01},
        {"seal_friction": 0.05},
        {"churning": 1e-5},
        {"ripple": 0.1, "ripple_phase": 1.0},
        {"pump_creep_speed": 0.01},
        {"friction_asymmetry": 0.2},
        {"burst_leakage": 1e-12},
        {"shaft_stiffness": 30.0, "shaft_damping": 0.005},
    ],
)
def test_losses_never_make_energy(effect: dict[str, float]) -> None:
    plant = Plant({"external_force": 0.0, "valve_conductance": 0.0, **effect})
    state = started(plant, PRESSURE_A=9e6, PRESSURE_B=1e6, SPEED=30.0, ROTOR_SPEED=30.0)
    y = plant.replay(driven(np.zeros(1500)), np.zeros(1500), state)
    e = energy(y)
    if "shaft_stiffness" in effect or "bristle_stiffness" in effect:
        # The soft shaft and the bristles store some themselves, uncounted here.
        assert np.all(e <= e[0] * 1.1)
        assert e[-1] < 0.01 * e[0]
    else:
        assert np.all(np.diff(e) <= 1e-6 * e[0])


def test_below_break_away_the_pump_does_not_move() -> None:
    held = 0.99 * DECLARED["static_torque"] / DECLARED["torque_constant"]
    plant = Plant({})
    y, _, _ = plant.run(driven(np.full(300, held), bypass=True))
    assert np.all(y[:, 1] == 0.0)
    y, _, _ = plant.run(driven(np.full(300, 1.02 * held / 0.99), bypass=True))
    assert y[-1, 1] > 0.5


def test_steady_speed_with_the_bypass_open_solves_equation_23() -> None:
    plant = Plant({})
    current = 5.0
    y, _, _ = plant.run(driven(np.full(4000, current), bypass=True))
    w = y[-1, 1]
    dp = y[-1, 2] - y[-1, 3]
    friction = 0.16 + (0.2537 - 0.16) * math.exp(-((w / 18.0) ** 2)) + 0.00498 * w
    assert 0.13 * current == pytest.approx(friction + DECLARED["pump_displacement"] * dp, rel=1e-3)
    # What the pump moves returns through the bypass.
    assert dp * (6e-10 + 1e-13) == pytest.approx(DECLARED["pump_displacement"] * w, rel=1e-3)


def test_a_locked_pump_holds_between_the_two_friction_limits() -> None:
    plant = Plant({"leakage": 0.0})
    y, _, _ = plant.run(driven(np.full(4000, 15.0)))
    assert y[-1, 1] == 0.0
    held = abs(0.13 * 15.0 - DECLARED["pump_displacement"] * (y[-1, 2] - y[-1, 3]))
    assert held <= 0.2537


def test_oil_is_neither_made_nor_lost() -> None:
    plant = Plant({"valve_conductance": 0.0, "turbulent_leakage": 1e-11, "air_fraction": 0.0})
    state = started(plant, PRESSURE_A=9e6, PRESSURE_B=8e6)
    y = plant.replay(driven(np.full(2000, 4.0)), np.full(2000, 4.0), state)
    np.testing.assert_allclose(y[:, 2] + y[:, 3], 17e6, atol=100.0)


def test_check_valves_hold_the_low_chamber_near_charge_pressure() -> None:
    y, _, _ = Plant({}).run(driven(np.full(1500, 18.0)))
    assert y[:, 3].min() > 0.5e6
    y, _, _ = Plant({"valve_conductance": 0.0}).run(driven(np.full(1500, 18.0)))
    assert y[:, 3].min() < -1e6


POLYTROPIC = st.sampled_from([0.0, 1.0, 1.4])


@given(
    st.floats(5e3, 4e7),
    st.floats(0.0, 0.06),
    st.floats(6e8, 1.4e9),
    st.floats(0.3, 3.0),
    POLYTROPIC,
)
def test_content_and_pressure_are_inverse(
    p: float, air: float, beta: float, off: float, index: float
) -> None:
    values = record({"bulk_modulus": beta, "air_index": index})[0]
    held = k.content(p, air, values)
    assert k.pressure(held, p * off, air, values) == pytest.approx(p, rel=1e-6)


@given(st.floats(5e4, 4e7), st.floats(1e-4, 0.06), POLYTROPIC)
def test_modulus_is_the_slope_of_content(p: float, air: float, index: float) -> None:
    values = record({"air_index": index})[0]
    step = 1e-4 * p
    slope = (k.content(p + step, air, values) - k.content(p - step, air, values)) / (2.0 * step)
    assert 1.0 / slope == pytest.approx(k.modulus(p, air, values), rel=1e-5)


def test_air_softens_and_vanishes_at_high_pressure() -> None:
    values = record()[0]
    assert k.modulus(0.6e6, 0.02, values) == pytest.approx(148e6, rel=1e-2)
    assert k.modulus(4e8, 0.02, values) == pytest.approx(900e6, rel=1e-3)
    assert k.modulus(1e6, 0.0, values) == 900e6


def test_current_lag_and_delay_reach_the_sensor() -> None:
    u = np.zeros(60)
    u[10:] = 8.0
    lag, _, _ = Plant({"current_lag": 0.003}).run(driven(u))
    t = np.arange(50) * k.TICK
    np.testing.assert_allclose(lag[10:, 0], 8.0 * (1.0 - np.exp(-t / 0.003)), atol=1e-9)
    late, _, _ = Plant({"command_delay": 0.004}).run(driven(u))
    np.testing.assert_allclose(late[14:16, 0], [0.0, 8.0], atol=1e-9)


def test_a_delay_between_two_sub_steps_is_not_rounded() -> None:
    """The impulse of the torque is late by the delay, though the sub-steps are 50 us long."""
    u = np.zeros(200)
    u[10:] = 12.0
    speeds = []
    for delay in (0.004, 0.00402):
        late, _, _ = Plant({"command_delay": delay}).run(driven(u))
        speeds.append(late[20, 1])
    on_time = Plant({"command_delay": 0.00405}).run(driven(u))[0][20, 1]
    assert speeds[1] - speeds[0] == pytest.approx(0.4 * (on_time - speeds[0]), rel=0.3)


def test_the_sample_is_taken_before_its_tick() -> None:
    u = np.full(5, 3.0)
    y, _, _ = Plant({}).run(driven(u))
    assert y[0, 0] == 0.0
    assert np.all(y[1:, 0] == 3.0)


def test_backlash_is_a_play() -> None:
    run = Run("t", False, False, False, k.POSITION_LOOP, 2, np.zeros(1), np.zeros(1))
    t = np.arange(1500) * k.TICK
    reference = 0.01 * np.sin(2.0 * np.pi * t)
    run = Run(
        "t", False, False, False, k.POSITION_LOOP, 2, reference, np.gradient(reference, k.TICK)
    )
    y, states, _ = Plant({"backlash": 4e-4}).run(run)
    gap = y[:, 4] - states[:, k.POSITION]
    assert np.abs(gap).max() == pytest.approx(2e-4, rel=1e-6)
    assert np.all(y[np.abs(gap) < 1.9e-4, 5] == 0.0)


def test_external_force_sign() -> None:
    """Positive is against extension: held back, chamber a must carry it."""
    plant = Plant({"external_force": 300.0, "leakage": 0.0})
    y, _, _ = plant.run(driven(np.zeros(400), locked=False))
    push = DECLARED["piston_area_a"] * (y[-1, 2] - y[-1, 3])
    assert push == pytest.approx(300.0, abs=61.0)
    assert y[-1, 4] < 0.0


@pytest.mark.parametrize("locked", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_halving_the_step_changes_nothing_that_could_be_seen(locked: bool) -> None:
    from fixtures.rig.commands import build_runs
    from fixtures.rig.plant import SUBSTEPS_FREE, SUBSTEPS_LOCKED
    from fixtures.rig.sensors import SIGMA

    plant = Plant({"air_fraction": 0.02, "ripple": 0.02, "cogging_torque": 0.02})
    for run in build_runs(np.random.default_rng(3)):
        if run.locked is not locked:
            continue
        _, _, commands = plant.run(run)
        steps = SUBSTEPS_LOCKED if locked else SUBSTEPS_FREE
        coarse = plant.replay(run, commands, substeps=steps)
        fine = plant.replay(run, commands, substeps=4 * steps)
        assert np.sqrt(np.mean(((coarse - fine) / SIGMA) ** 2, axis=0)).max() < 0.1, run.name


def test_bristles_on_the_rod_build_friction_up_over_their_distance() -> None:
    plant = Plant({**FRICTIONLESS, "rod_coulomb": 60.0, "rod_bristle_distance": 1e-3})
    state = started(plant, VELOCITY=1e-4)
    plant.parameters["load_mass"] = 1e9  # keeps its speed
    _, states, _ = k.simulate(
        plant.parameters, 0, np.zeros(3000), np.zeros(3000), np.zeros(3000), np.zeros(4),
        False, False, state, 20, np.zeros(0),
    )  # fmt: skip
    slid = states[:, k.POSITION]
    np.testing.assert_allclose(states[:, k.ROD_BRISTLE], 1.0 - np.exp(-slid / 1e-3), atol=1e-3)


def test_across_a_gap_the_load_is_moved_only_once_touched() -> None:
    plant = Plant({"load_gap": 1e-3, "external_force": 0.0, "rod_coulomb": 0.0, "rod_viscous": 0.0})
    _, states, _ = k.simulate(
        plant.parameters, 0, np.full(60, 12.0), np.zeros(60), np.zeros(60), np.zeros(4),
        False, False, k.start_state(0.0, plant.parameters), 40, np.zeros(0),
    )  # fmt: skip
    apart = states[:, k.POSITION] - states[:, k.LOAD_POSITION]
    touched = int(np.argmax(apart > 5e-4))
    assert touched > 3
    assert np.all(states[:touched, k.LOAD_VELOCITY] == 0.0)
    assert states[-1, k.LOAD_VELOCITY] > 0.0
    assert apart.max() < 7e-4


def test_a_run_goes_on_from_a_state_with_the_commands_before_it() -> None:
    plant = Plant({"command_delay": 0.0033})
    rng = np.random.default_rng(2)
    commands, start = rng.uniform(-8.0, 8.0, 80), k.start_state(0.0, plant.parameters)

    def simulated(given, state, before):
        nothing = np.zeros(given.size)
        readings, states, _ = k.simulate(
            plant.parameters, k.OPEN_LOOP, given, nothing, nothing, np.zeros(4), True, False,
            state, 20, before,
        )  # fmt: skip
        return readings, states

    whole, states = simulated(commands, start, np.zeros(0))
    later, _ = simulated(commands[50:], states[50], commands[:50])
    np.testing.assert_array_equal(later, whole[50:])
