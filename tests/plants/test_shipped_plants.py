"""The shipped plants against SciPy's implicit solver, and against cases worked by hand.

The equations here are written from the literature that the elements name, apart from the product's
code: one function of rates a plant, solved by Radau at tight tolerance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

Rates = Callable[[float, FloatArray], list[float]]

STEP = 1e-4


def simulated(
    name: str, time: FloatArray, inputs: Mapping[str, FloatArray], initial: Mapping[str, float],
    step: float = STEP, **parameters: float,
) -> dict[str, FloatArray]:  # fmt: skip
    plant = get_plant(name)
    values = {key.replace("__", "."): value for key, value in parameters.items()}
    vector = Model(name, values, (), ()).vector()
    out = plant.simulate(vector, Drive(time, inputs, initial), step)
    return dict(zip(plant.outputs, out.T, strict=True))


def solved(rates: Rates, time: FloatArray, start: list[float], scale: list[float]) -> FloatArray:
    """Return the states at the times, (states, n); inputs are held from sample to sample."""
    y = np.array(start)
    rows = [y]
    for begin, end in itertools.pairwise(time):
        done = solve_ivp(rates, (begin, end), y, "Radau", rtol=1e-9, atol=np.array(scale))
        assert done.success
        y = done.y[:, -1]
        rows.append(y)
    return np.array(rows).T


def nrmse(found: FloatArray, known: FloatArray) -> float:
    return float(np.sqrt(np.mean((found - known) ** 2)) / np.ptp(known))


@pytest.mark.slow
def test_valve_cylinder_agrees_with_an_implicit_solver() -> None:
    """Servo valve of second order, square-root lands, compressible chambers and inlet."""
    time = np.arange(0.0, 0.2, 2e-3)
    command = 2.0 + 1.5 * np.sin(2 * np.pi * 8.0 * time)
    supply, tank, beta, area, dead, half = 14e6, 3e5, 1.2e9, 12e-4, 60e-6, 0.125

    def root(d: float) -> float:
        return d / (d * d + 2e4**2) ** 0.25

    def rates(t: float, y: FloatArray) -> list[float]:
        s, ds, inlet, a, b, x, v = y
        # the small share keeps a sample's own moment on its side of the edge
        u = command[min(int(t / 2e-3 + 1e-9), time.size - 1)] / 10.0
        gain = 9e-8
        to_a = gain * (max(s, 0) * root(inlet - a) - max(-s, 0) * root(a - tank))
        to_b = gain * (max(-s, 0) * root(inlet - b) - max(s, 0) * root(b - tank))
        drawn = gain * (max(s, 0) * root(inlet - a) + max(-s, 0) * root(inlet - b))
        leak = 1e-12 * (a - b)
        force = area * (a - b) - 1800.0 * v - 160.0 * np.sign(v)
        return [
            ds,
            440.0**2 * (u - s) - 2 * 0.75 * 440.0 * ds,
            beta / 600e-6 * (8.3e-10 * (supply - inlet) - drawn),
            beta / (dead + area * (x + half)) * (to_a - area * v - leak),
            beta / (dead + area * (half - x)) * (to_b + area * v + leak),
            v,
            force / 120.0,
        ]

    known = solved(
        rates, time, [0.2, 0.0, 13.5e6, 7.5e6, 6.5e6, 0.0, 0.05],
        [1e-9, 1e-6, 1.0, 1.0, 1.0, 1e-10, 1e-9],
    )  # fmt: skip
    names = ("spool_position", "", "supply_pressure", "pressure_a", "pressure_b",
             "piston_position", "piston_velocity")  # fmt: skip
    first = {name: known[k, 0] for k, name in enumerate(names) if name}
    found = simulated("valve_cylinder", time, {"valve_command": command}, first, 2.5e-5)
    assert (known[6] > 0).all(), "no reversal: the friction's sign is smooth"
    for k, name in enumerate(names):
        if name:
            assert nrmse(found[name], known[k]) < 2e-3, name


def test_single_rod_eha_agrees_with_an_implicit_solver() -> None:
    """Pump between the chambers; checks, pilot checks and gas make up for the rod's volume."""
    time = np.arange(0.0, 0.2, 2e-3)
    current = 6.0 + 4.0 * np.sin(2 * np.pi * 5.0 * time)
    beta, displacement, dead, half = 1.1e9, 8e-6 / (2 * math.pi), 80e-6, 0.15
    area_a, area_b, charge, gas = 19.6e-4, 13.5e-4, 4e5, 1e-3

    def check(p_from: float, p_to: float) -> float:
        return 1.2e-9 * max(0.0, p_from - p_to - 2e4)

    def pilot(p_from: float, p_to: float, p_pilot: float) -> float:
        s = (3.0 * (p_pilot - p_to) - (p_from - p_to) - 5e4) / 3e5
        s = min(1.0, max(0.0, s))
        return (3 * s * s - 2 * s**3) * 1.2e-9 * (p_from - p_to)

    def rates(t: float, y: FloatArray) -> list[float]:
        w, a, b, r, x, v = y
        i = current[min(int(t / 2e-3 + 1e-9), time.size - 1)]
        pumped = displacement * w
        leak = 1.5e-12 * (a - b)
        in_a = check(r, a) - pilot(a, r, b)
        in_b = check(r, b) - pilot(b, r, a)
        torque = 0.6 * i - displacement * (a - b) - 0.3 * np.sign(w) - 0.004 * w
        force = area_a * a - area_b * b - 3000.0 * v - 250.0 * np.sign(v)
        # isothermal gas: V p = const, so dV/dp = V_0 p_0 / p^2 (absolute)
        give = gas * charge / (r + 1e5) ** 2
        return [
            torque / 9e-4,
            beta / (dead + area_a * (x + half)) * (pumped - area_a * v - leak + in_a),
            beta / (dead + area_b * (half - x)) * (-pumped + area_b * v + leak + in_b),
            -(in_a + in_b) / give,
            v,
            force / 250.0,
        ]

    known = solved(
        rates, time, [20.0, 9e5, 4e5, 3e5, 0.0, 0.01], [1e-6, 1.0, 1.0, 1e-2, 1e-10, 1e-9]
    )
    names = ("motor_speed", "pressure_a", "pressure_b", "reservoir_pressure", "piston_position",
             "piston_velocity")  # fmt: skip
    first = {name: known[k, 0] for k, name in enumerate(names)}
    found = simulated("single_rod_eha", time, {"current_command": current}, first, 2.5e-5)
    assert (known[[0, 5]] > 0).all(), "no reversal"
    for k, name in enumerate(names):
        if name in found:
            assert nrmse(found[name], known[k]) < 2e-3, name


@pytest.mark.slow
def test_geared_servo_agrees_with_an_implicit_solver() -> None:
    """Duty times supply against back-EMF, through a rigid gear, on a pendulum."""
    time = np.arange(0.0, 0.4, 2e-3)
    duty = 0.6 + 0.3 * np.sin(2 * np.pi * 3.0 * time)
    supply = 12.0
    ratio, constant, resistance, mass, length = 193.0, 0.0083, 2.3, 0.8, 0.18

    def rates(t: float, y: FloatArray) -> list[float]:
        angle, speed = y
        u = duty[min(int(t / 2e-3 + 1e-9), time.size - 1)] * supply
        i = (u - constant * ratio * speed) / resistance
        torque = ratio * constant * i - mass * 9.80665 * length * math.sin(angle)
        torque -= 0.1 * speed + 0.1 * np.sign(speed)
        return [speed, torque / (0.03 + mass * length**2)]

    known = solved(rates, time, [0.1, 0.5], [1e-10, 1e-10])
    inputs = {"duty": duty, "supply_voltage": np.full(time.size, supply)}
    first = {"angle": 0.1, "velocity": 0.5}
    found = simulated("geared_servo", time, inputs, first, 2.5e-5)
    assert (known[1] > 0).all(), "no reversal"
    assert nrmse(found["angle"], known[0]) < 1e-5
    assert nrmse(found["velocity"], known[1]) < 1e-4


# --- by hand ------------------------------------------------------------------------------------


def test_held_servo_balances_weight_and_motor() -> None:
    """At rest n K_T u / R = m g l sin(angle): 0.83 V hold 25 degrees (without friction)."""
    weight = 0.8 * 9.80665 * 0.18
    angle = math.radians(25.0)
    voltage = weight * math.sin(angle) * 2.3 / (193 * 0.0083)
    time = np.arange(0.0, 1.0, 1e-2)
    inputs = {
        "duty": np.full(time.size, voltage / 12.0),
        "supply_voltage": np.full(time.size, 12.0),
    }
    found = simulated("geared_servo", time, inputs, {"angle": angle, "velocity": 0.0},
                      gear_friction__coulomb=0.0)  # fmt: skip
    np.testing.assert_allclose(found["angle"], angle, atol=1e-9)
    np.testing.assert_allclose(found["current"], voltage / 2.3, rtol=1e-9)


def test_valve_cylinder_runs_as_fast_as_both_lands_let_it() -> None:
    """Both lands share what viscous friction leaves: 2 (A v / K s)^2 = p_P - p_T - B v / A."""
    time = np.arange(0.0, 1.0, 2e-3)
    inputs = {"valve_command": np.full(time.size, 1.0)}
    found = simulated(
        "valve_cylinder", time, inputs, {"piston_position": -0.05},
        rod_friction__coulomb=0.0, rod_friction__viscous=18e3, piston_leakage__conductance=0.0,
        supply_line__conductance=1e-6,
    )  # fmt: skip
    area, gain, drag = 12e-4, 9e-8 * 0.1, 18e3
    square, linear, constant = 2 * (area / gain) ** 2, drag / area, -(14e6 - 3e5)
    speed = (-linear + math.sqrt(linear**2 - 4 * square * constant)) / (2 * square)
    assert found["piston_velocity"][-1] == pytest.approx(speed, rel=1e-3)
    force = area * (found["pressure_a"][-1] - found["pressure_b"][-1])
    assert force == pytest.approx(drag * speed, rel=1e-3)
    assert found["spool_position"][-1] == pytest.approx(0.1, rel=1e-9)


def test_single_rod_gas_gives_the_oil_that_the_rod_leaves() -> None:
    """Isothermal gas at 4 bar absolute, 1 l; the rod 50 mm out takes (A_a - A_b) x of oil."""
    plant = get_plant("single_rod_eha")
    vector = Model("single_rod_eha", {}, (), ()).vector()
    place = plant.state_places["reservoir_pressure"]
    state, _ = plant.start(vector, {"piston_position": 0.05})
    taken = (19.6e-4 - 13.5e-4) * 0.05
    assert state[place] == pytest.approx(4e5 * 1e-3 / (1e-3 + taken) - 1e5, rel=1e-9)
