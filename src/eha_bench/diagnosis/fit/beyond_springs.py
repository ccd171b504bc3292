"""Where a part beyond a spring begins whose force is read: a load cell's other end.

    x' = x + F / k,  v' = v + (dF/dt) / k

A millimetre off, or 0.1 m/s, and a load cell would ring at thousands of newtons.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.windows import Window, half_fit
from eha_bench.plants.plant import Plant

_FEWEST = 7
"""Least readings from which a rate is told."""


def beyond_springs(
    plant: Plant, vector: FloatArray, window: Window
) -> dict[str, tuple[float, float]]:
    """Return states beyond springs whose force is read: value, and how far it may be off, SI.

    Args:
        plant: the plant. vector: its parameters. window: with what its sensors read at its start.
    """
    found: dict[str, tuple[float, float]] = {}
    read = window.initial
    for pair in plant.elastic_pairs:
        if pair.force not in read:
            continue
        for here, there in ((0, 1), (1, 0)):
            known, other = pair.positions[here], pair.positions[there]
            if known not in read or other in read:
                continue
            bent = [
                plant.through_parts(vector, {known: 0.0, pair.force: force}).get(other, 0.0)
                for force in (read[pair.force], 1.0, 2.0)
            ]
            compliance = bent[2] - bent[1]
            off = window.spread.get(pair.force, 0.0) * abs(compliance)
            found[other] = read[known] + bent[0], off
            slope, unsure = _slope(window, pair.force)
            rate = read.get(pair.rates[here], 0.0) + slope * compliance
            found[pair.rates[there]] = rate, unsure * abs(compliance)
    return found


def _slope(window: Window, channel: str) -> tuple[float, float]:
    """Return the rate of a channel at a window's start, and how far it may be off, SI/s."""
    measured = window.measured
    column = measured.column(channel)
    half = half_fit(measured, channel)
    first = max(0, window.first - half)
    span = slice(first, first + 2 * half + 1)
    if column is None or np.count_nonzero(good := np.isfinite(column[span])) < _FEWEST:
        return 0.0, 0.0
    time, values = measured.time[span][good] - measured.time[window.first], column[span][good]
    slope, further = (float(np.polyfit(time, values, degree)[-2]) for degree in (2, 4))
    noise = window.noise.get(channel, 0.0) / float(np.std(time) * np.sqrt(time.size))
    return slope, abs(further - slope) + 3.0 * noise
