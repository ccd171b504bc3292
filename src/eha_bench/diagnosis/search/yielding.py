"""Whether a candidate, as it was fitted, describes with more numbers what another one does.

A play in a gear is the gap behind which a load hangs. A valve that is open nearly half of the time
is a leak: one whose gap widens with the pressure fits as a valve that opens at a low one.
"""

from __future__ import annotations

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.search.state import Search
from eha_bench.plants.effect import BoundEffect

_HARDLY_SHUT = 1.3
"""Setting of a valve, in what is reached half of the time, below which a leak may be meant."""


def yields_to(search: Search, candidate: str, vector: FloatArray) -> str:
    """Return the id of the effect to which one yields, as a vector has it; "" where to none.

    Args:
        search: with the plant. candidate: effect's id. vector: as it was fitted.
    """
    effect = search.problem.plant.layout.effect(candidate)
    if effect.action.opens is not None and not _is_hardly_shut(search, effect, vector):
        return ""
    return effect.effect.yields_to


def _is_hardly_shut(search: Search, effect: BoundEffect, vector: FloatArray) -> bool:
    """Whether what opens above a setting is open nearly half of the time."""
    assert effect.action.opens is not None
    key, places = f"{effect.id}.{effect.action.opens.setting}", search.problem.places
    reached, _ = places.bounds(key, vector)
    return bool(vector[places.index[key]] < _HARDLY_SHUT * reached)
