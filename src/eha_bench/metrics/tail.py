"""The level that a decaying tail is heading for.

A window's mean is the best estimate of a level in noise. Where the noise is small against a tail
that still decays, the mean lags behind: linear prediction (Prony's method; Kumaresan and Tufts,
IEEE Trans. ASSP 30, 1982, doi:10.1109/TASSP.1982.1163974) then gives the level that the tail decays
to, provided that it really predicts the tail.
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import FloatArray

_POINTS = 48
_QUIET = 0.02  # noise against the tail's movement, below which the tail is worth predicting
_PREDICTED = 1e-3  # what prediction may leave of the movement


def asymptote(window: FloatArray, noise: float) -> float | None:
    """Return the level that (n,) samples decay to, or None where it is not determined.

    `noise` is the standard deviation of the samples' white part.
    """
    spread = float(np.std(window))
    if window.size < 2 * _POINTS or not noise < _QUIET * spread:
        return None
    stride = window.size // _POINTS
    points = window[window.size % stride :: stride]
    centred = (points - points.mean()) / spread
    for order in (1, 2, 3, 4):
        level = _predicted_level(centred, order, noise / spread)
        if level is not None:
            return float(points.mean()) + level * spread
    return None


def _predicted_level(points: FloatArray, order: int, noise: float) -> float | None:
    rows = points.size - order
    design = np.ones((rows, order + 1))
    for lag in range(1, order + 1):
        design[:, lag] = points[order - lag : points.size - lag]
    target = points[order:]
    solution = np.linalg.lstsq(design, target, rcond=1e-9)[0]
    rest = float(np.sqrt(np.mean((target - design @ solution) ** 2)))
    if rest > _PREDICTED + 3.0 * noise:
        return None
    gain = 1.0 - float(np.sum(solution[1:]))
    poles = np.roots(np.concatenate([[1.0], -solution[1:]]))
    # a pole at 1 is a ramp, one outside of the unit circle grows: no level is approached
    if abs(gain) < 1e-6 or np.any(np.abs(poles) > 1.0 + 1e-6):
        return None
    level = float(solution[0]) / gain
    reach = float(np.ptp(points))
    return level if points.min() - 2.0 * reach <= level <= points.max() + 2.0 * reach else None
