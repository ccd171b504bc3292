"""Elements by themselves against cases worked by hand, and the power balance of a whole circuit.

Laws are called as they are written; what a node makes of them is simulated.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.elements import elastic_stop, orifice, relief_valve, spring
from eha_bench.plants.network.file import plant_of
from eha_bench.plants.plant import Drive


def simulated(
    content: dict[str, Any], time: FloatArray, initial: dict[str, float], step: float
) -> dict[str, FloatArray]:
    plant = plant_of(content)
    out = plant.simulate(plant.layout.defaults(), Drive(time, {}, initial), step)
    return dict(zip(plant.outputs, out.T, strict=True))


# --- laws ----------------------------------------------------------------------------------------


def test_relief_valve_lets_out_what_is_above_its_setting() -> None:
    # 21 MPa against 0.5 MPa, set to 20 MPa: 0.5 MPa too many, times 1e-9 m^3/(s*Pa)
    assert relief_valve.flow(21e6, 0.5e6, 1e-9, 20e6) == pytest.approx(5e-4)
    assert relief_valve.slope(21e6, 0.5e6, 1e-9, 20e6) == 1e-9
    assert relief_valve.flow(20.4e6, 0.5e6, 1e-9, 20e6) == 0.0
    assert relief_valve.slope(20.4e6, 0.5e6, 1e-9, 20e6) == 0.0
    # it is not a way back
    assert relief_valve.flow(0.0, 30e6, 1e-9, 20e6) == 0.0


def test_orifice_passes_the_root_of_the_pressure() -> None:
    # 0.61 * 1 mm^2 * sqrt(2 * 4 MPa / 860 kg/m^3) = 0.61e-6 * 96.449 = 5.8834e-5 m^3/s
    flow = orifice.flow(5e6, 1e6, 1e-6, 0.61, 860.0, 1e4)
    assert flow == pytest.approx(5.8834e-5, rel=1e-4)
    assert orifice.flow(1e6, 5e6, 1e-6, 0.61, 860.0, 1e4) == -flow
    # a sixteenth of the pressure, a quarter of the flow
    assert orifice.flow(0.25e6, 0.0, 1e-6, 0.61, 860.0, 1e3) == pytest.approx(flow / 4, rel=1e-4)


@pytest.mark.parametrize("difference", [0.0, 1e2, -1e4, 1e5, -2e6])
def test_slope_of_an_orifice_is_never_less_than_the_true_one(difference: float) -> None:
    rest = (1e-6, 0.61, 860.0, 1e4)
    step = 1e-4 * max(abs(difference), 1e2)
    ends = (orifice.flow(difference + d, 0.0, *rest) for d in (step, -step))
    true = (next(ends) - next(ends)) / (2 * step)
    assert orifice.slope(difference, 0.0, *rest) >= true * (1 - 1e-6)
    if difference == 0.0:
        assert orifice.slope(0.0, 0.0, *rest) == pytest.approx(true, rel=1e-6)


def test_spring_pulls_towards_its_rest_and_damps() -> None:
    # 30 mm out at 2 N/mm, and 0.1 m/s at 50 N*s/m
    assert spring.pull(0.05, 0.1, 2000.0, 0.02, 50.0) == pytest.approx(-65.0)
    assert spring.pull(0.02, 0.0, 2000.0, 0.02, 50.0) == 0.0


def test_elastic_stop_pushes_and_never_pulls() -> None:
    rest = (-0.1, 0.1, 1e6, 2e4)
    assert elastic_stop.push(0.1, 1.0, *rest) == 0.0
    # 1 mm in at 1e6 N/m, going on inwards with 10 mm/s at 2e4 N*s/m
    assert elastic_stop.push(0.101, 0.01, *rest) == pytest.approx(-1200.0)
    assert elastic_stop.push(-0.101, -0.01, *rest) == pytest.approx(1200.0)
    # leaving fast: the damper alone would hold it back
    assert elastic_stop.push(0.101, -1.0, *rest) == 0.0
    assert elastic_stop.push(-0.101, 1.0, *rest) == 0.0


# --- what nodes make of them ---------------------------------------------------------------------

CARRIAGE: dict[str, Any] = {
    "plant": "carriage_between_springs",
    "nodes": {"rod": {"kind": "translation", "mass": "2 kg"}},
    "elements": {
        "spring": {"kind": "spring", "on": "rod", "stiffness": "800 N/m", "rest": "10 mm"},
        "stop": {"kind": "elastic_stop", "on": "rod", "low": "-80 mm", "high": "40 mm",
                 "stiffness": "2e5 N/m"},
    },
    "channels": {"piston_position": "rod.position", "piston_velocity": "rod.velocity"},
}  # fmt: skip


def test_spring_and_stop_keep_the_energy_and_swing_as_worked_by_hand() -> None:
    time = np.arange(0.0, 1.0, 1e-3)
    free = simulated(CARRIAGE, time, {"piston_position": 0.03}, 1e-4)["piston_position"]
    # sqrt(800 / 2) = 20 rad/s about 10 mm
    np.testing.assert_allclose(free, 0.01 + 0.02 * np.cos(20.0 * time), atol=2e-6)

    # from -40 mm: 50 mm of amplitude, so it meets the stop at 40 mm with 0.8 m/s
    found = simulated(CARRIAGE, time, {"piston_position": -0.04}, 2e-5)
    x, v = found["piston_position"], found["piston_velocity"]
    # k A^2 = k (x - x_0)^2 + k_s (x - h)^2
    a, b, c = 800.0 + 2e5, -2 * (800.0 * 0.01 + 2e5 * 0.04), 800.0 * 0.01**2 + 2e5 * 0.04**2 - 2.0
    assert x.max() == pytest.approx((-b + math.sqrt(b * b - 4 * a * c)) / (2 * a), abs=2e-5)
    energy = v**2 + 400.0 * (x - 0.01) ** 2 + 1e5 * np.maximum(x - 0.04, 0.0) ** 2
    np.testing.assert_allclose(energy, 1.0, rtol=2e-3)


CIRCUIT: dict[str, Any] = {
    "plant": "passive_circuit",
    "nodes": {
        "rod": {"kind": "translation", "mass": "50 kg", "stroke": ["-100 mm", "100 mm"]},
        "chamber_a": {"kind": "volume", "bulk_modulus": "1 GPa"},
        "chamber_b": {"kind": "volume", "bulk_modulus": "1 GPa"},
        "tank": {"kind": "reservoir", "pressure": "0 bar"},
    },
    "elements": {
        "cylinder": {"kind": "cylinder", "on": "rod", "a": "chamber_a", "b": "chamber_b",
                     "area_a": "10 cm^2", "area_b": "6 cm^2", "dead_volume_a": "50 cm^3",
                     "dead_volume_b": "50 cm^3"},
        "spring": {"kind": "spring", "on": "rod", "stiffness": "2e5 N/m", "damping": "300 N*s/m"},
        "seals": {"kind": "friction", "on": "rod", "coulomb": "80 N", "viscous": "400 N*s/m"},
        "leak": {"kind": "laminar_leakage", "between": ["chamber_a", "chamber_b"],
                 "conductance": "5e-13 m^3/(s*Pa)"},
        "orifice": {"kind": "orifice", "between": ["chamber_a", "chamber_b"], "area": "0.2 mm^2"},
        "relief": {"kind": "relief_valve", "from": "chamber_a", "to": "tank", "setting": "6 MPa",
                   "conductance": "2e-11 m^3/(s*Pa)"},
        "suction": {"kind": "check_valve", "from": "tank", "to": "chamber_b",
                    "conductance": "1e-9 m^3/(s*Pa)"},
    },
    "channels": {"pressure_a": "chamber_a.pressure", "pressure_b": "chamber_b.pressure",
                 "piston_position": "rod.position", "piston_velocity": "rod.velocity"},
}  # fmt: skip


def test_passive_circuit_loses_the_power_that_its_elements_take() -> None:
    """Energy of mass, spring and oil falls by what friction, damper and valves turn into heat.

    Of oil in a volume V that moves: V/beta p dp/dt = p (q - dV/dt), so what it holds is the
    integral of p V / beta dp.
    """
    time = np.arange(0.0, 0.3, 5e-5)
    initial = {"pressure_a": 9e6, "pressure_b": 1e6, "piston_position": 0.03}
    found = simulated(CIRCUIT, time, initial, 1e-5)
    a, b = found["pressure_a"], found["pressure_b"]
    x, v = found["piston_position"], found["piston_velocity"]

    def summed(rate: FloatArray, over: FloatArray) -> FloatArray:
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(over)
        return np.concatenate([[0.0], np.cumsum(steps)])

    volume_a, volume_b = 50e-6 + 10e-4 * (x + 0.1), 50e-6 + 6e-4 * (0.1 - x)
    held = 25.0 * v**2 + 1e5 * x**2 + summed(a * volume_a / 1e9, a) + summed(b * volume_b / 1e9, b)
    d = a - b
    lost = (
        80.0 * np.abs(v)
        + (400.0 + 300.0) * v**2
        + 5e-13 * d**2
        + 0.61 * 0.2e-6 * math.sqrt(2 / 860.0) * d**2 / (d**2 + 1e8) ** 0.25
        + 2e-11 * np.maximum(a - 6e6, 0.0) * a
        + 1e-9 * np.maximum(-b, 0.0) * -b
    )
    assert np.ptp(x) > 5e-3
    assert a.max() > 6e6
    used = summed(lost, time)
    turned_over = np.ptp(held)
    np.testing.assert_allclose(held - held[0], -used, atol=2e-3 * turned_over)
    assert (np.diff(held) < 1e-6 * turned_over).all()
