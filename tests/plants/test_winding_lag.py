"""The lag of the current in a winding that a voltage drives, against its two equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive

RESISTANCE, CONSTANT, INERTIA, VISCOUS, LAG = 2.0, 0.1, 1e-3, 1e-3, 5e-3
VOLTAGE = 10.0


def motor(place: str, *, inertia: float = INERTIA) -> Model:
    """A DC motor on a voltage, whose current lags."""
    return load_model({
        "plant": "dc_motor",
        "nodes": {"shaft": {"kind": "rotation", "inertia": inertia}},
        "elements": {
            "motor": {"kind": "motor", "on": "shaft", "resistance": RESISTANCE,
                      "torque_constant": CONSTANT},
            "drag": {"kind": "friction", "on": "shaft", "viscous": VISCOUS},
        },
        "inputs": {"voltage": "motor.voltage"},
        "channels": {"speed": "shaft.speed", "current": "motor.current"},
        "effects": [{"effect": "current_lag", "time_constant": LAG, "place": place}],
    })  # fmt: skip


def stepped(model: Model, at: float = 0.01) -> tuple[FloatArray, FloatArray]:
    """Return times and outputs (n, 2) of a step of the voltage."""
    time = np.arange(0.0, 0.15, 1e-3)
    drive = Drive(time, {"voltage": np.where(time >= at, VOLTAGE, 0.0)}, {})
    return time, model.plant.simulate(model.vector(), drive, 1e-5)


def test_both_equations_of_the_machine_are_met():
    time, found = stepped(motor("winding"))

    def slopes(_t: float, x: FloatArray) -> list[float]:
        current = ((VOLTAGE - CONSTANT * x[1]) / RESISTANCE - x[0]) / LAG
        return [current, (CONSTANT * x[0] - VISCOUS * x[1]) / INERTIA]

    after = time[time >= 0.01]
    exact = solve_ivp(slopes, (after[0], after[-1]), [0.0, 0.0], t_eval=after,
                      method="Radau", rtol=1e-10, atol=1e-12).y  # fmt: skip
    rows = found[time >= 0.01]
    assert rows[:, 0] == pytest.approx(exact[1], abs=1e-3 * exact[1].max())
    # the sensor reads the current that flows, not the one that the voltage asks for
    assert rows[:, 1] == pytest.approx(exact[0], abs=2e-3 * exact[0].max())


def test_a_shaft_that_hardly_turns_sees_the_time_constant_alone():
    time, found = stepped(motor("winding", inertia=1e3))
    after = time >= 0.01
    wanted = VOLTAGE / RESISTANCE * (1.0 - np.exp(-(time[after] - 0.01) / LAG))
    assert found[after, 1] == pytest.approx(wanted, abs=1e-3 * VOLTAGE / RESISTANCE)


def test_at_speed_the_two_places_differ_and_at_rest_they_do_not():
    _, drive = stepped(motor("drive"))
    _, winding = stepped(motor("winding"))
    assert np.abs(drive[:, 0] - winding[:, 0]).max() > 0.01 * np.abs(drive[:, 0]).max()
    _, slow_drive = stepped(motor("drive", inertia=10.0))
    _, slow_winding = stepped(motor("winding", inertia=10.0))
    gap = np.abs(slow_drive[:, 0] - slow_winding[:, 0]).max()
    assert gap < 1e-3 * np.abs(slow_drive[:, 0]).max()


def test_only_a_motor_that_a_voltage_drives_has_both_places():
    by_current = load_model("paper").plant.layout.effect("current_lag")
    assert "place" not in [parameter.name for parameter in by_current.parameters]
    by_voltage = motor("winding").plant.layout.effect("current_lag")
    assert by_voltage.words(by_voltage.parameter("place")) == ("drive", "winding")
