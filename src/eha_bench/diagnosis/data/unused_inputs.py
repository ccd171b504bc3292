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
from eha_bench.diagnosis.data.noise import noise_of
from eha_bench.plants.model import Model

_OFF, _NOISY = 0.02, 4.0
"""By how much a logged value has to be off, in the declared one and in its own noise."""
_OFTEN = 0.95
"""Quantile of what it is off by that counts: the rest may be outliers."""


def unused_inputs(
    run: Run, topics: Iterable[Recording], inputs: Collection[str], model: Model
) -> list[Note]:
    """Return a note for every logged channel that would drive the plant, and does not.

    Only of those that the plant declares a value for, and where the log has another one.

    Args:
        run: the run. topics: of its log. inputs: channels that drive the model. model: driven.
    """
    notes, plant = [], model.plant
    resting = plant.resting_values(run.vector(plant.layout, model.vector()))
    for topic in topics:
        for name in topic:
            declared = resting.get(name, math.nan)
            if name in inputs or not math.isfinite(declared):
                continue
            values = topic[name][np.isfinite(topic[name])]
            if not values.size:
                continue
            off = float(np.quantile(np.abs(values - declared), _OFTEN))
            if off > max(_OFF * abs(declared), _NOISY * noise_of(values)):
                notes.append(
                    Note(
                        "{run}: '{channel}' is in the log and drives {plant}, but it is not under "
                        "`inputs`: it is taken to stand at the declared {value}",
                        run=run.name,
                        channel=name,
                        plant=plant.id,
                        value=f"{declared:.4g} {plant.units.get(name, '')}".rstrip(),
                    )
                )
    return notes
