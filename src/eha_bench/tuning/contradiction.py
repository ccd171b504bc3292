"""Why nothing passes: limits that no candidate keeps, and limits that no candidate keeps all of."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from eha_bench.core.arrays import FloatArray


@dataclass(frozen=True)
class Contradiction:
    """What stands against each other.

    Attributes:
        never: places of limits that no candidate keeps. together: smallest sets of limits of which
            each is kept by some candidate, and all by none.
        tried: candidates that this rests on.
    """

    never: tuple[int, ...]
    together: tuple[tuple[int, ...], ...]
    tried: int


def contradiction(margins: FloatArray) -> Contradiction:
    """Return what keeps all candidates from passing, by their margins, (candidates, limits).

    Sets of two are looked for first, then of three; beyond that all limits that can be kept stand
    for one set. It speaks of the candidates that were tried.
    """
    kept = margins >= 0.0
    count = margins.shape[1]
    never = tuple(int(k) for k in range(count) if not kept[:, k].any())
    possible = [k for k in range(count) if k not in never]
    for size in (2, 3):
        found = tuple(
            chosen
            for chosen in combinations(possible, size)
            if not kept[:, list(chosen)].all(axis=1).any()
        )
        if found:
            return Contradiction(never, found, len(margins))
    whole = tuple(possible)
    clash = bool(whole) and not kept[:, list(whole)].all(axis=1).any()
    return Contradiction(never, (whole,) if clash else (), len(margins))
