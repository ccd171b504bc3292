"""Which candidates explain as much as the chosen one, so that data do not distinguish them."""

from __future__ import annotations

from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, compare
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.search.state import Search

_AT_NOISE = 1.01
"""Cost over the noise's up to which a likelihood ratio holds."""
_FAR = 2.0
"""Cost over the noise's from which no form is right, and which is nearer says little."""
_TIED, _TIED_AT_NOISE = 0.03, 0.003
"""Share of the best one's gain by which a tie may be behind, and of the rows: what is left of the
noise's size is left to be explained by something else."""
CHANCE = 4.0
"""Fall of the cost that is two standard deviations: a tie of two causes, however few the rows."""


def tie(gain: float, rows: int) -> float:
    """Return by how much less than the best one a tie may lower the cost.

    Args:
        gain: of the best one. rows: of the residual.
    """
    return min(_TIED * gain, _TIED_AT_NOISE * rows)


def is_far_above_noise(fit: Fit) -> bool:
    """Whether a fit leaves so much that no form in it is right."""
    return fit.cost > _FAR * SOFT_MEAN * fit.residual.size


def is_as_good(search: Search, other: Fit, chosen: Fit, gain: float) -> bool:
    """Return whether a fit is not worse than the chosen one beyond resampling noise.

    A likelihood ratio of two models holds where one of them is right; where declared forms are off
    by less than the noise, neither is, and one that is no better on runs left out is not better.
    Far above the noise, as of measured machines, something else is missing in both: there they are
    as good where they explain the same to a few per cent (`behind_share`), however sure that is, or
    where chance may have made the difference on runs left out.

    Args:
        search: its rows are resampled and left out. other: with another candidate.
        chosen: with the one that was chosen, which gained `gain`.
    """
    limits = search.thresholds
    behind = compare(other, chosen, search.groups, 1.0)
    if behind.gain < limits.behind:
        return True
    far = is_far_above_noise(chosen)
    if behind.gain >= limits.behind_share * gain:
        return far and behind.p_value > limits.p_value
    if far:
        return True
    # down at the noise the likelihood ratio holds; above it only resampling does
    at_noise = chosen.cost < _AT_NOISE * SOFT_MEAN * chosen.residual.size
    return behind.gain_out <= 0.0 if at_noise else behind.p_value > limits.chance
