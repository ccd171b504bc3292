"""What a measured speed does between its samples.

A speed that was measured and drives a model does not go straight between its samples: where it
bends, a pump moves more or less oil than a straight line says, and a small chamber shows that. By
the Hermite cubic whose slopes are central differences (Catmull and Rom) it is beside the straight
line, after tick k,

    s (1 - s) b,  b = -(y''[k] + y''[k + 1]) / 4 * span^2,

with s from 0 to 1. Another part is odd about the middle, adds up to nothing, and is left out. What
is moved in a span is off by its fifth power, by a straight line by its third. All is linear in the
readings, so their noise stays what it was; and where they jump, what is added before is taken away
behind.

Source: Catmull, Rom, A class of local interpolating splines, Computer Aided Geometric Design (1974)
317, doi:10.1016/B978-0-12-079050-0.50020-5; of the straight line's error de Boor, A Practical Guide
to Splines (2001), chapter III.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray

_USUAL: Final = 1.5
"""Factor by which a step of the clock may differ from the usual one to tell how a series bends.

Across a gap nobody knows, and what is remembered of long before stands at one moment."""


def bows(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return how far a series is beside the straight line after each tick, b, (n,).

    The last one is 0, and so is one beside steps of the clock that are not usual.

    Args:
        time: (n,) s. values: (n,) at these.
    """
    found = np.zeros(values.size)
    span = np.diff(time)
    if span.size < 2:
        return found
    usual = float(np.median(span))
    usable = (span < _USUAL * usual) & (span > usual / _USUAL)
    slope = np.diff(values) / np.where(usable, span, 1.0)
    known = usable[1:] & usable[:-1]
    bend = np.zeros(values.size)
    bend[1:-1] = np.where(known, 2.0 * np.diff(slope) / (span[1:] + span[:-1]), 0.0)
    told = np.zeros(values.size)
    told[1:-1] = known
    # at an end one of both tells
    both = (bend[1:] + bend[:-1]) / np.maximum(told[1:] + told[:-1], 1.0)
    found[:-1] = np.where(usable, -0.5 * both * span**2, 0.0)
    return found
