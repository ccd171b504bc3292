"""Finding a known signal in a sampled one, by normalised correlation over every overlap."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar

from eha_bench.core.arrays import FloatArray


def best_lag(
    time: FloatArray,
    sampled: FloatArray,
    signal: Callable[[FloatArray], FloatArray],
    duration: float,
    period: float,
) -> tuple[float, float]:
    """Return (time at which `signal` starts, correlation coefficient there).

    Every overlap of at least half of the shorter one counts, weighted by its length, so that a
    recording may begin late or end early. `time` (n,) s must be nearly equidistant.
    """
    from scipy.signal import fftconvolve  # slow to import

    count = max(round(duration / period), 2)
    wanted = signal(np.arange(count, dtype=np.float64) * period)
    if not np.all(np.isfinite(wanted)) or np.ptp(wanted) == 0.0:
        return float(time[0]), 0.0
    x = (sampled - sampled.mean()) / np.std(sampled)
    y = (wanted - wanted.mean()) / np.std(wanted)
    ones_x, ones_y = np.ones_like(x), np.ones_like(y)
    overlap = np.maximum(fftconvolve(ones_x, ones_y[::-1]), 1.0)
    product = fftconvolve(x, y[::-1])
    sum_x, sum_y = fftconvolve(x, ones_y[::-1]), fftconvolve(ones_x, y[::-1])
    power_x = fftconvolve(x * x, ones_y[::-1]) - sum_x * sum_x / overlap
    power_y = fftconvolve(ones_x, (y * y)[::-1]) - sum_y * sum_y / overlap
    floor = 1e-6 * overlap
    likeness = (product - sum_x * sum_y / overlap) / np.sqrt(
        np.maximum(power_x, floor) * np.maximum(power_y, floor)
    )
    shortest = min(x.size, y.size)
    allowed = overlap >= 0.5 * shortest
    # a longer overlap wins over a slightly better fit: a sine fits itself a period later as well
    weight = np.where(allowed, likeness * np.sqrt(overlap / shortest), -np.inf)
    index = int(np.argmax(weight))
    start = float(time[0]) + (index - (y.size - 1)) * period
    return _refine(time, sampled, signal, duration, start, period), float(likeness[index])


def _refine(
    time: FloatArray,
    sampled: FloatArray,
    signal: Callable[[FloatArray], FloatArray],
    duration: float,
    start: float,
    period: float,
) -> float:
    """Move the start by up to a sample, to where the correlation is best."""
    inside = (time >= start + period) & (time < start + duration - period)
    if np.count_nonzero(inside) < 8:
        return start
    stamps, values = time[inside], sampled[inside]
    centred = values - values.mean()

    def mismatch(shift: float) -> float:
        wanted = signal(stamps - start - shift)
        wanted = wanted - wanted.mean()
        power = float(wanted @ wanted)
        return -float(centred @ wanted) / power**0.5 if power > 0.0 else 0.0

    best = minimize_scalar(mismatch, bounds=(-period, period), method="bounded")
    return start + float(best.x) if best.fun < mismatch(0.0) else start
