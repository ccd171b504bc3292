"""Pressure and speed that change together from run to run are said to, where it matters."""

import numpy as np
import pytest

from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.confounded import (
    confounding_notes,
    constant_load_notes,
    one_way_notes,
    shared_offset_notes,
)
from eha_bench.diagnosis.outcome.diagnosis import FoundEffect
from eha_bench.plants.channel_roles import KNOWN
from eha_bench.plants.registry import get_plant

LAYOUT = get_plant("eha_knee").layout
TIME = np.arange(0.0, 5.0, 0.01)


def _run(pressure: float, speed: float) -> Measured:
    """Return strokes back and forth at a speed in m/s, under a pressure in Pa."""
    position = speed * np.abs((TIME % 2.0) - 1.0)
    values = np.column_stack([np.full(TIME.size, pressure), position])
    names = ("pressure_a", "piston_position")
    return Measured(None, TIME, {}, names, values, np.ones(values.shape, dtype=bool), roles=KNOWN)


SLOWER = [_run(1e5, 0.012), _run(3e5, 0.009), _run(7e5, 0.006)]


@pytest.mark.parametrize(
    ("runs", "effect", "said"),
    [
        (SLOWER, "seal_friction", True),
        (SLOWER, "pressure_dependent_friction", True),
        # it does not ask for the pressure
        (SLOWER, "asymmetric_friction", False),
        (SLOWER[:2], "seal_friction", False),
        ([_run(p, 0.01) for p in (1e5, 3e5, 7e5)], "seal_friction", False),
        ([_run(1e5, 0.012), _run(3e5, 0.006), _run(7e5, 0.009)], "seal_friction", False),
    ],
)
def test_it_is_said_where_no_run_tells_them_apart(runs, effect, said) -> None:
    notes = confounding_notes(runs, [LAYOUT.effect(effect)])
    assert bool(notes) == said
    if said:
        assert "speed and pressure are confounded" in notes[0]
        assert "lower where pressure_a is higher" in notes[0]
        assert effect in notes[0]


@pytest.mark.parametrize(
    ("sign", "calibrated", "said"),
    [
        (1.0, ["drag.coulomb", "drag.viscous"], True),
        (1.0, ["drag.viscous"], False),
        # one run there, and one back
        (-1.0, ["drag.coulomb"], False),
    ],
)
def test_a_dry_friction_of_one_way_may_hold_a_load(sign, calibrated, said) -> None:
    def run(rate: float) -> Measured:
        values = np.column_stack([np.full(TIME.size, 5e6), rate * TIME])
        names = ("pressure_a", "piston_position")
        valid = np.ones(values.shape, dtype=bool)
        return Measured(None, TIME, {}, names, values, valid, roles=KNOWN)

    noise = {"pressure_a": 1e3, "piston_position": 1e-5}
    notes = one_way_notes([run(0.01), run(sign * 0.01)], noise, calibrated)
    assert bool(notes) == said
    if said:
        assert (
            "goes one way (piston_position), so drag.coulomb may hold a constant load" in notes[0]
        )


@pytest.mark.parametrize(("at", "said"), [("shaft", True), ("joint", False)])
def test_a_load_that_could_not_be_tried_is_named(at, said) -> None:
    found = FoundEffect("asymmetric_friction", "torque", {}, {}, 0.9, 1e-9, at)
    notes = constant_load_notes(get_plant("eha_knee"), [found])
    assert bool(notes) == said
    if said:
        assert "a constant load at 'shaft'" in notes[0]


@pytest.mark.parametrize(
    ("at", "offset", "calibrated", "said"),
    [
        ("all", 2e4, [], "supply.pressure and tank.pressure are not calibrated: 20 kPa higher"),
        ("all", -3e4, ["supply.pressure"], "tank.pressure is not calibrated: 30 kPa lower"),
        ("all", 2e4, ["supply.pressure", "tank.pressure"], ""),
        ("pressure_a", 2e4, [], ""),
    ],
)
def test_one_offset_of_all_sensors_is_what_reservoirs_look_like(at, offset, calibrated, said):
    value = Estimate(offset, offset, offset, "Pa")
    found = FoundEffect(
        "pressure_sensor_offset", "measurement", {"offset": value}, {}, 0.9, 1e-9, at
    )
    notes = shared_offset_notes(get_plant("valve_cylinder"), calibrated, [found])
    assert bool(notes) is bool(said)
    assert said in " ".join(notes)
