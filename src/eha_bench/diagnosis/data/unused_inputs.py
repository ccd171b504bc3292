"""What drives a machine, and is in its log, but not under `inputs`.

A supply pressure that sags stands at its declared value then, and nothing else says so.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

import numpy as np

from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.plants.plant import Plant

_OFF = 0.02
"""Share of the declared value that a logged one has to be off by, at some time."""


def unused_inputs(
    run: Run, topics: Iterable[Recording], inputs: Collection[str], plant: Plant
) -> list[Note]:
    """Return a note for every logged channel that would drive the plant, and does not.

    Only of those that the plant declares a value for, and where the log has another one.

    Args:
        run: the run. topics: of its log. inputs: channels that drive the model. plant: driven.
    """
    notes = []
    for topic in topics:
        for name in topic:
            declared = plant.resting_inputs.get(name, math.nan)
            if name in inputs or not math.isfinite(declared):
                continue
            values = topic[name][np.isfinite(topic[name])]
            if values.size and np.max(np.abs(values - declared)) > _OFF * abs(declared):
                notes.append(
                    Note(
                        "{run}: '{channel}' is in the log and drives {plant}, but it is not under "
                        "`inputs`: it is taken to stand at the declared {value:.4g} {unit}",
                        run=run.name,
                        channel=name,
                        plant=plant.id,
                        value=declared,
                        unit=plant.units.get(name, ""),
                    )
                )
    return notes
