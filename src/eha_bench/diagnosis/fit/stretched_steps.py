"""How much longer than usual the steps of an integration may be.

The usual steps are those of a stiff hydraulic drive that is logged every millisecond. A boom that
is logged at 20 Hz, or a servo, does nothing within one of them: its simulation is as right at steps
of two milliseconds, in a quarter of the time. How long a step may be is measured, by what it
changes of the readings in their noise.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.problem import Problem

STRETCHES: Final = (12.0, 6.0, 3.0, 1.5)
"""Steps that are tried, in usual ones, longest first: they fit into ticks of 1 to 5 ms."""
_LITTLE: Final = 0.03
"""Largest change of a reading, in its noise, that a longer step may make: of 99.9 % of them."""
_MOST: Final = 0.999


def with_stretched_steps(problem: Problem, vector: FloatArray, most: float = 12.0) -> Problem:
    """Return a problem with steps as long as its readings allow.

    Args:
        problem: at its usual steps. vector: where it is simulated. most: stretch that is tried.
    """
    usual = problem.raw(vector)
    for stretch in STRETCHES:
        if stretch > most:
            continue
        longer = problem.stretched(stretch)
        change = np.abs(longer.raw(vector) - usual)
        if not change.size or np.quantile(change, _MOST) < _LITTLE:
            return longer
    return problem
