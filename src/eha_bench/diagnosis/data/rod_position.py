"""The position of a rod whose joint's angle is logged instead, by the linkage between them.

A leg has an encoder at the joint, and a model has the rod's position as its state: readings of
the angle are as many readings of the position, through lengths that are declared. Without them
nothing says where the rod is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from eha_bench.core.recording import Recording
from eha_bench.plants.model import Model


def with_rod_positions(topics: Sequence[Recording], model: Model) -> tuple[Recording, ...]:
    """Return the topics of a log with rod positions behind joint angles, where none is logged.

    Args:
        topics: of one log. model: whose plant has the linkage, with its lengths.
    """
    linkage = model.plant.linkage(model.vector())
    if linkage is None:
        return tuple(topics)
    logged = {name for item in topics for name in item}
    behind = {
        joint: rod for joint, rod in model.plant.rods_behind.items()
        if joint in logged and rod not in logged
    }  # fmt: skip
    found = []
    for item in topics:
        for joint, rod in behind.items():
            if joint in item:
                note = f"'{rod}' is worked out from '{joint}' by the declared linkage"
                item = replace(  # noqa: PLW2901
                    item,
                    values={**item.values, rod: linkage.position(item[joint])},
                    units={**item.units, rod: model.plant.units[rod]},
                    notes=(*item.notes, note),
                )
        found.append(item)
    return tuple(found)


def reading_rods(read: Callable[[], Recording], model: Model) -> Callable[[], Recording]:
    """Return what reads a recording with its rod positions."""
    return lambda: with_rod_positions((read(),), model)[0]


def reading_rods_by_topic(
    read: Callable[[], tuple[Recording, ...]], model: Model
) -> Callable[[], tuple[Recording, ...]]:
    """Return what reads a recording for each topic, with the rod positions."""
    return lambda: with_rod_positions(read(), model)
