"""A dead zone: what is small passes nothing, of either direction its own share.

    y = u - d_+ where u > d_+,   u + d_- where u < -d_-,   0 between
    d_+ = d (1 + a),  d_- = d (1 - a)

With rounded corners,

    y = w ln[(1 + e^((u - d_+) / w)) / (1 + e^(-(u + d_-) / w))],   w = d / 3

which is the same a few w away from its corners.

Source: Tao, Kokotovic, IEEE Trans. Automatic Control 39 (1994) 59, doi:10.1109/9.273339.
"""

from __future__ import annotations

import math

from eha_bench.plants.compiled import njit

FORMS = ("sharp", "smooth")
"""Words of its corners, in the order of their numbers."""
_SHARP = 0.0


@njit()
def _soft(u: float) -> float:
    """Return ln(1 + e^u), also for large |u|."""
    return max(u, 0.0) + math.log1p(math.exp(-abs(u)))


@njit()
def dead_zone(u: float, size: float, asymmetry: float, form: float) -> float:
    """Return what a dead zone passes.

    Args:
        u: what comes in. size: d >= 0, in its unit. asymmetry: a of its edges, -1 to 1.
        form: number of the corners' word.
    """
    up, down = size * (1.0 + asymmetry), size * (1.0 - asymmetry)
    if form == _SHARP or size <= 0.0:
        if u > up:
            return u - up
        return min(0.0, u + down)
    width = size / 3.0
    return width * (_soft((u - up) / width) - _soft(-(u + down) / width))
