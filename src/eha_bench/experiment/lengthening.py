"""How long an experiment takes, and how it is made longer."""

from __future__ import annotations

from collections.abc import Sequence

from eha_bench.experiment.candidates import Experiment

SHORTEST = 1.0
"""Least length of a proposal, s: fewer than ten blocks bear out nothing by resampling, and of a
shorter run a diagnosis learns how parameters scatter between runs, and not their size."""
LONGEST = 4.0
"""Length at which experiments are compared, s; longer ones are made of several."""
TOGETHER = 3
"""Most trials of a proposal."""
_LONGER = 1.6
_AS_LONG = 0.95
"""Share of the longest from which an experiment is as long as it gets."""


def longer(chosen: Sequence[Experiment], budget: float) -> list[Experiment] | None:
    """Return trials of which the last takes half as long again, or comes once more.

    None beyond the budget, s, or where that would be more than `TOGETHER` trials.
    """
    *first, last = chosen
    gone = sum(item.seconds for item in first)
    most = min(LONGEST, budget - gone)
    if last.seconds < _AS_LONG * most:
        return [*first, last.lasting(min(_LONGER * last.seconds, most))]
    if len(chosen) < TOGETHER and gone + 2.0 * last.seconds <= budget:
        return [*chosen, last]
    return None
