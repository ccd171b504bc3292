"""Which candidates explain as much as the chosen one, so that data do not distinguish them."""

from __future__ import annotations

from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, Groups, compare
from eha_bench.diagnosis.fit.least_squares import Fit

_AT_NOISE = 1.01
"""Cost over the noise's up to which a likelihood ratio holds."""
_BEHIND = 12.0
"""Fall of the cost from which one is behind another there: 3.5 standard deviations."""
_LITTLE = 0.05
"""Share of the chosen one's gain by which another may be behind above the noise."""
_CHANCE = 0.02
"""Probability from which resampling takes what it is behind by for chance."""

_TIED, _TIED_AT_NOISE = 0.03, 0.003
"""Share of the best one's gain by which a tie may be behind, and of the rows: what is left of the
noise's size is left to be explained by something else."""


def tie(gain: float, rows: int) -> float:
    """Return by how much less than the best one a tie may lower the cost.

    Args:
        gain: of the best one. rows: of the residual.
    """
    return min(_TIED * gain, _TIED_AT_NOISE * rows)


def is_as_good(other: Fit, chosen: Fit, gain: float, groups: Groups) -> bool:
    """Return whether a fit is not worse than the chosen one beyond resampling noise.

    A likelihood ratio of two models holds where one of them is right; where declared forms are off
    by less than the noise, neither is, and one that is no better on runs left out is not better.

    Args:
        other: with another candidate. chosen: with the one that was chosen, which gained `gain`.
        groups: of rows, to resample and to leave out.
    """
    behind = compare(other, chosen, groups, 1.0)
    if behind.gain < _BEHIND:
        return True
    if behind.gain >= _LITTLE * gain:
        return False
    # down at the noise the likelihood ratio holds; above it only resampling does
    at_noise = chosen.cost < _AT_NOISE * SOFT_MEAN * chosen.residual.size
    return behind.gain_out <= 0.0 if at_noise else behind.p_value > _CHANCE
