"""States of effects that no reading tells, where a simulation begins in the midst of a motion.

A supply that gives way has fallen by what was drawn from it before. At rest it begins at none, and
an effect says how far it may be off elsewhere (`Action.unread`).
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import NamedTuple

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.layout import Layout


class UnreadState(NamedTuple):
    """One of them: its place in a kernel's memory, and how far it may be off, SI."""

    place: int
    reach: float


def unread_states(
    layout: Layout, vector: FloatArray, places: Mapping[str, int]
) -> dict[str, UnreadState]:
    """Return such states of the effects that are on, by name.

    Args:
        layout: of the plant. vector: its parameters.
        places: state -> place in the memory of the kernel.
    """
    found: dict[str, UnreadState] = {}
    for effect in layout.effects:
        if not effect.action.unread:
            continue
        if vector[layout.index[f"{effect.id}.{effect.strength.name}"]] == effect.neutral:
            continue
        own = {
            item.name: float(vector[layout.index[f"{effect.id}.{item.name}"]])
            for item in effect.parameters
            if item.size == 1
        }
        for spot in effect.spots_at(own):
            known = {**spot.usual, **own}
            for state, function in effect.action.unread.items():
                name = f"{effect.id}.{state}@{spot.name}"
                wanted = inspect.signature(function).parameters
                reach = function(**{key: known[key] for key in wanted})
                if reach > 0.0:
                    found[name] = UnreadState(places[name], reach)
    return found
