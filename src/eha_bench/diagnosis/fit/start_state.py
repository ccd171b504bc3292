"""The state of the plant at which its sensors read what was measured first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eha_bench.plants.plant import Drive, Parametrised


def start_of(at: Parametrised, drive: Drive, measured: Mapping[str, float]) -> dict[str, float]:
    """Return the start state at which the plant's sensors would read what was measured.

    A sensor with an offset reads another value than the state has: one tick is simulated, and the
    state is moved by what the sensor adds.
    """
    plant = at.plant
    implied = plant.through_cells(at.vector, {**drive.first_values, **measured})
    measured = {name: value for name, value in measured.items() if name in plant.states}
    initial = {**implied, **plant.at_rest(measured), **measured}
    if at.sensors_are_ideal:
        return initial
    reads = at.simulate(drive.first_tick, initial, 1.0)[drive.first]
    for place, name in enumerate(plant.outputs):
        if name in measured and name not in plant.roles.acting and np.isfinite(reads[place]):
            initial[name] += measured[name] - reads[place]
    return initial
