"""Positions beyond the model's ends: a wrong unit is named, not fitted away."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eha_bench.diagnosis.data.beyond_ends import beyond_ends
from eha_bench.diagnosis.data.measured import Measured

ENDS = {"piston_position": (-0.15, 0.15), "angle": (-np.inf, np.inf)}
UNITS = {"piston_position": "m", "angle": "rad"}


class Run:
    """A run's name."""

    name = "steps"


def measured(values: np.ndarray) -> Measured:
    run: Any = Run()
    time = 1e-3 * np.arange(values.size)
    both = np.column_stack([values, 1e3 * values])
    return Measured(run, time, {}, ("piston_position", "angle"), both, np.isfinite(both))


@pytest.mark.parametrize(
    ("scale", "offset", "noted"),
    [
        (0.1, 0.0, False),
        # ends give way, and a cushion is no wrong unit
        (0.157, 0.0, False),
        # millimetres read as metres, and a zero at the end of the stroke
        (100.0, 0.0, True),
        (0.1, 0.15, True),
    ],
)
def test_a_wrong_unit_and_a_wrong_zero_are_named(scale: float, offset: float, noted: bool) -> None:
    values = offset + scale * np.sin(np.linspace(0.0, 20.0, 2000))
    notes = list(beyond_ends([measured(values)], ENDS, UNITS))
    assert len(notes) == noted
    if noted:
        assert notes[0].startswith("CAUTION: steps: 'piston_position' goes from ")
        assert "beyond the ends that the model has, -0.15 to 0.15" in notes[0]


def test_outliers_are_no_wrong_unit() -> None:
    values = 0.1 * np.sin(np.linspace(0.0, 20.0, 2000))
    values[::400] = 7.0
    assert list(beyond_ends([measured(values)], ENDS, UNITS)) == []
