"""The state of the plant at which its sensors read what was measured first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from eha_bench.plants.plant import Drive, Drives, Parametrised

_NOTHING: Mapping[str, float] = MappingProxyType({})


def start_of(
    at: Parametrised,
    drive: Drive,
    measured: Mapping[str, float],
    carried: Mapping[str, float] = _NOTHING,
) -> dict[str, float]:
    """Return the start state at which the plant's sensors would read what was measured.

    A sensor with an offset reads another value than the state has: one tick is simulated, and the
    state is moved by what the sensor adds.

    Args:
        at: the plant. drive: what drives it. measured: channel -> first reading, SI.
        carried: state -> where it is, SI, of those that nothing reads.
    """
    return starts_of(at, Drives((drive,)), [measured], [carried])[0]


def starts_of(
    at: Parametrised,
    drives: Drives,
    measured: Sequence[Mapping[str, float]],
    carried: Sequence[Mapping[str, float]],
) -> list[dict[str, float]]:
    """Return the start states of several drives, each as `start_of` does."""
    plant = at.plant
    tells = plant.tells_through_parts
    starts, readings = [], []
    for drive, first, own in zip(drives.items, measured, carried, strict=True):
        implied: Mapping[str, float] = _NOTHING
        if tells:
            implied = plant.through_parts(at.vector, {**drive.first_values, **first})
        read = {name: value for name, value in first.items() if name in plant.states}
        starts.append({**implied, **plant.at_rest(read), **read, **own})
        readings.append(read)
    if at.sensors_are_ideal:
        return starts
    ticks = drives.first_ticks
    simulated = at.simulate_each(ticks, range(len(starts)), starts, 1.0)
    geared = plant.roles.geared
    for start, first, read, own, tick, values in zip(
        starts, measured, readings, carried, ticks.items, simulated, strict=True
    ):
        beyond: dict[str, float] = {}
        for place, name in enumerate(plant.outputs):
            off = first.get(name, np.nan) - values[tick.first][place]
            if not np.isfinite(off) or name in plant.roles.acting:
                continue
            if name in read:
                start[name] += off
            elif name in geared and geared[name][0] not in read:
                beyond[name] = first[name] + off
        if beyond:
            # what moves behind a gear tells the state that it moves with
            told = plant.through_parts(at.vector, {**tick.first_values, **first, **beyond})
            start.update({name: value for name, value in told.items() if name not in own})
    return starts
