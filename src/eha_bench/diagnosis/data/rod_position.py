"""The position of a rod whose joint's angle is logged instead, by the linkage between them.

A leg has an encoder at the joint, and a model has the rod's position as its state: readings of
the angle are as many readings of the position, through lengths that are declared. Without them
nothing says where the rod is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from eha_bench.core.linkage import Linkage
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
    return tuple(_with_rods(item, behind, linkage, model.plant.units) for item in topics)


def _with_rods(
    topic: Recording, behind: Mapping[str, str], linkage: Linkage, units: Mapping[str, str]
) -> Recording:
    own = {joint: rod for joint, rod in behind.items() if joint in topic}
    if not own:
        return topic
    found = {rod: linkage.position(topic[joint]) for joint, rod in own.items()}
    notes = [
        f"'{rod}' is worked out from '{joint}' by the declared linkage"
        for joint, rod in own.items()
    ]
    return replace(
        topic,
        values={**topic.values, **found},
        units={**topic.units, **{rod: units[rod] for rod in found}},
        notes=(*topic.notes, *notes),
    )
