"""Pressure and speed that change together from run to run are said to, where it matters."""

import numpy as np
import pytest

from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.outcome.confounded import confounding_notes
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
