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
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem

STRETCHES: Final = (1.5, 3.0, 6.0, 12.0)
"""Steps that are tried, in usual ones: they fit into ticks of 0.5 to 4 ms."""
_LITTLE: Final = 0.03
"""Largest change of a reading, in its noise, that a longer step may make: of 99.9 % of them."""
_MOST: Final = 0.999
_MARGIN: Final = 2.0
"""Step, in the chosen one, that has to be right as well: a fit may find a machine to be stiffer."""
_UNSEEN: Final = 16.0
"""How much less a step may change where no longer one fits into a tick to be tried."""
_DOWN: Final = 1.5
"""Cost over that of the noise below which a fit has nowhere further to get."""
_PROBED: Final = 2
"""Steps of a fit that show whether it gets further at usual steps of integration."""
_FURTHER: Final = 0.02
"""Share of what is unexplained by which that is."""


def with_stretched_steps(
    problem: Problem, vector: FloatArray, most: float = STRETCHES[-1]
) -> Problem:
    """Return a problem with steps as long as its readings allow.

    The error of a step grows with its square: at twice the step it may be four times as large. A
    step that fits into no tick changes nothing, and is not taken: halving it would show nothing.

    Args:
        problem: at its usual steps. vector: where it is simulated. most: stretch that is tried.
    """
    usual = problem.raw(vector)
    chosen, reached = problem, usual
    for stretch in STRETCHES:
        if stretch > most:
            break
        longer = problem.stretched(stretch)
        there = longer.raw(vector)
        if np.array_equal(there, reached) or not _change(there, usual) < _LITTLE:
            break
        beyond = problem.stretched(_MARGIN * stretch).raw(vector)
        limit = _LITTLE / _UNSEEN if np.array_equal(beyond, there) else _MARGIN**2 * _LITTLE
        if not _change(beyond, usual) < limit:
            break
        chosen, reached = longer, there
    return chosen


def _change(one: FloatArray, other: FloatArray) -> float:
    """Return what all but few readings change by at most, and no root mean square is above."""
    moved = np.abs(one - other)
    if not moved.size:
        return 0.0
    return max(float(np.quantile(moved, _MOST)), float(np.sqrt(np.mean(moved**2))))


def is_stiffer(usual: Problem, longer: Problem, fit: Fit) -> bool:
    """Whether a machine is too stiff for longer steps where a fit at them ended, or beyond.

    Longer steps that do not follow a stiff machine are a wall that the fit cannot pass.

    Args:
        usual, longer: the problem at usual steps and at longer ones. fit: at these.
    """
    if longer.stretch == usual.stretch:
        return False
    there = with_stretched_steps(usual, fit.vector, longer.stretch)
    if there.stretch < longer.stretch:
        return True
    noise = SOFT_MEAN * longer.size
    if fit.cost < _DOWN * noise:
        return False
    costs = []
    for problem in (usual.apart(), longer.apart()):
        problem.soft = fit.soft
        costs.append(levenberg_marquardt(problem, fit.vector, fit.free, iterations=_PROBED).cost)
    at_usual, at_longer = costs
    return at_usual < at_longer - _FURTHER * (fit.cost - noise)
