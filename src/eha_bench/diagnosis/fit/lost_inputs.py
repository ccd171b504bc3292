"""What inputs that were not logged make a simulation do.

The value of a lost message is a guess that may be off by its spread (`data.lost_inputs`), and held
until the next message it acts all that while. What that does to a window's residual is one more
direction in which it may be off by one standard deviation, as its start state is. Messages that
were lost far apart are simulated together, as each one's response has died away where the next
begins. Those whose guesses together make less than the noise are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.data.lost_inputs import Unsure
from eha_bench.diagnosis.fit.input_noise import SHOWS, Shaken
from eha_bench.plants.plant import Drive

FloatArray = NDArray[np.float64]

_APART = 0.4
"""Time between lost messages that are simulated together, s: masses on oil have come to rest."""
_FEWER = 4
"""Factor by which the number of messages grows while what is left still shows."""


def lost(
    drive: Drive,
    unsure: Mapping[str, Unsure],
    begin: int,
    times: FloatArray,
    vector: FloatArray,
    residual: Callable[[Drive], FloatArray],
) -> Shaken:
    """Return what messages of inputs that were lost do to a window's residual.

    Args:
        drive: of the window. unsure: input -> its values that were not logged.
        begin: tick of the run at which the drive begins. times: (N,) s of the residual's rows.
        vector: of the plant. residual: (N,) weighted by its own noise, of the window under a drive.
    """
    items = [
        (name, max(int(tick) - begin, 0), min(int(stop) - begin, drive.time.size), float(spread))
        for name, own in unsure.items()
        for tick, stop, spread in zip(own.ticks, own.stops, own.spread, strict=True)
        if stop > begin and tick - begin < drive.time.size
    ]
    items.sort(key=lambda item: -item[3])
    if not items:
        return Shaken(np.zeros((times.size, 0)), vector, 0)
    base = residual(drive)
    simulations = 1

    def change(chosen: list[tuple[str, int, int, float]], signs: FloatArray) -> FloatArray:
        inputs = {name: values.copy() for name, values in drive.inputs.items()}
        for (name, tick, stop, spread), sign in zip(chosen, signs, strict=True):
            inputs[name][tick:stop] += sign * spread
        return residual(replace(drive, inputs=inputs)) - base

    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(items))
    count = 0
    while count < len(items):
        left = change(items[count:], signs[count:])
        simulations += 1
        if float(left @ left) < SHOWS * drive.time.size:
            break
        count = min(max(_FEWER * count, _FEWER), len(items))
    columns = []
    for batch in _apart(items[:count], drive.time):
        moved = change(batch, np.ones(len(batch)))
        simulations += 1
        begins = [float(drive.time[tick]) for _, tick, _, _ in batch]
        for start, stop in zip(begins, [*begins[1:], np.inf], strict=True):
            columns.append(np.where((times >= start) & (times < stop), moved, 0.0))
    return Shaken(np.array(columns).reshape(-1, times.size).T, vector, simulations)


def _apart(
    items: list[tuple[str, int, int, float]], time: FloatArray
) -> list[list[tuple[str, int, int, float]]]:
    """Return lost messages in batches of which each is far from the one before it."""
    batches: list[list[tuple[str, int, int, float]]] = []
    for item in sorted(items, key=lambda item: item[1]):
        for batch in batches:
            if time[item[1]] - time[batch[-1][1]] >= _APART:
                batch.append(item)
                break
        else:
            batches.append([item])
    return batches
