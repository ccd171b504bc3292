"""Readings that repeat one another because what they read stands still.

A resolution rounds. While a signal moves, or its noise moves it, the roundings of its samples are
as good as independent, each of step / sqrt(12). While it stands between two steps they are one: a
hundred equal readings say where a servo has come to rest no better than one does. Counted as a
hundred, the rounding of a place would be an error ten times as certain as it is.

Source: Widrow, Kollár, Quantization Noise, Cambridge 2008, chapters 4 and 19 (when roundings are
independent; dither).
"""

from __future__ import annotations

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray

_LONG = 12
"""Equal readings in a row from which they are repeats: fewer weigh little."""
_ALIKE = 3
"""Multiple of its neighbours up to which a stretch is as long as theirs."""
_NEXT = 1.5
"""Change, in the least that comes, that leads to the next level."""


def distinct(values: FloatArray) -> BoolArray:
    """Return which samples tell something of their own, (n,): of a stretch that rests, one does.

    A signal that moves on slowly stays on each level for about as long as on the next: all of its
    samples are kept, as its roundings run through a whole step.

    Args:
        values: (n,), NaN where nothing was measured; these are none.
    """
    read = np.flatnonzero(np.isfinite(values))
    kept = np.zeros(values.size, dtype=np.bool_)
    kept[read] = True
    if read.size < _LONG:
        return kept
    change = np.flatnonzero(np.diff(values[read])) + 1
    edges = np.concatenate([[0], change, [read.size]])
    lengths, levels = np.diff(edges), values[read[edges[:-1]]]
    for number in np.flatnonzero((lengths >= _LONG) & ~_moves_on(levels, lengths)):
        first, last = int(edges[number]), int(edges[number + 1])
        kept[read[first:last]] = False
        kept[read[(first + last) // 2]] = True
    return kept


def _moves_on(levels: FloatArray, lengths: IndexArray) -> BoolArray:
    """Return which stretches lie between two as long as they are, a step below and a step above."""
    found = np.zeros(lengths.size, dtype=np.bool_)
    if lengths.size > 2:
        steps = np.diff(levels)
        before, after = steps[:-1], steps[1:]
        near = np.maximum(np.abs(before), np.abs(after)) < _NEXT * np.abs(steps).min()
        beside = _ALIKE * np.minimum(lengths[:-2], lengths[2:])
        found[1:-1] = (before * after > 0.0) & near & (lengths[1:-1] <= beside)
    return found
