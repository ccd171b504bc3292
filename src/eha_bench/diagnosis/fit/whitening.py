"""What is new in each reading of a window, where noise remembers from sample to sample.

A reading less what those before it say of its noise is independent of them, and as large as the
noise when divided by what stays unknown: the innovations form of a Gaussian likelihood (Brockwell,
Davis, Time Series: Theory and Methods, 2nd ed. 1991, section 8.6). It is linear in the readings, so
residuals, their slopes and their sensitivities all go through the same filter. After a gap, and
where a window begins, less is known of what was before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.measured import GAP

_FURTHER = 16
"""Readings further back than noise remembers that tell of it where a part of it is new."""


def whitening(
    time: FloatArray,
    valid: BoolArray,
    colours: Sequence[Colour | None],
    remembered: FloatArray | None = None,
) -> csr_array | None:
    """Return the matrix that makes a window's noise white, None where it is white already.

    Args:
        time: (n,) s. valid: (n, m) which readings are there: the rows, tick by tick.
        colours: of the m channels.
        remembered: (n, m) part of a reading's noise that remembers, of a deviation of 1; the rest
            is new with each reading (stamps that scatter). None: all of it.
    """
    if not any(colours):
        return None
    number = np.full(valid.shape, -1)
    number[valid] = np.arange(np.count_nonzero(valid))
    steps = np.diff(time)
    follows = np.concatenate([[False], steps < GAP * np.median(steps)])
    rows, columns, values = [], [], []
    for channel, colour in enumerate(colours):
        own = number[:, channel]
        if colour and remembered is not None and (remembered[:, channel] < 1.0).any():
            found = _beside_white(own, follows, colour, remembered[:, channel])
            rows += found[0]
            columns += found[1]
            values += found[2]
            continue
        predictors = colour.predictors if colour else ((np.zeros(0), 1.0),)
        known = _known_before(own >= 0, follows, len(predictors) - 1)
        for count, (factors, left) in enumerate(predictors):
            ticks = np.flatnonzero((known == count) & (own >= 0))
            for lag, factor in enumerate((-1.0, *factors)):
                rows.append(own[ticks])
                columns.append(own[ticks - lag])
                values.append(np.full(ticks.size, -factor / left))
    size = int(np.count_nonzero(valid))
    places = (np.concatenate(rows), np.concatenate(columns))
    return csr_array((np.concatenate(values), places), shape=(size, size))


def _beside_white(
    own: IndexArray, follows: BoolArray, colour: Colour, remembered: FloatArray
) -> tuple[list[IndexArray], list[IndexArray], list[FloatArray]]:
    """Return rows, columns and factors of a channel with noise that is partly new each time.

    Such a sum is of no order: as many readings before tell nearly all that all of them do.

    Args:
        own: (n,) row of each reading, -1 where there is none. follows: (n,) on the tick before.
        colour: of what remembers. remembered: (n,) part of each reading's noise that does.
    """
    most = len(colour.partial) + _FURTHER
    known = _known_before(own >= 0, follows, most)
    ties = colour.correlations(most + 1)
    rows, columns, values = [], [], []
    for count in range(most + 1):
        ticks = np.flatnonzero((known == count) & (own >= 0))
        before = ticks[:, None] - np.arange(count + 1)
        part = remembered[before]
        lags = np.abs(np.subtract.outer(np.arange(count + 1), np.arange(count + 1)))
        matrix = part[:, :, None] * part[:, None, :] * ties[lags]
        matrix[:, np.arange(count + 1), np.arange(count + 1)] = 1.0
        across = matrix[:, 1:, 0]
        factors = np.linalg.solve(matrix[:, 1:, 1:], across[:, :, None])[:, :, 0]
        left = np.sqrt(1.0 - np.einsum("ij,ij->i", factors, across))
        for lag, factor in enumerate((-np.ones(ticks.size), *factors.T)):
            rows.append(own[ticks])
            columns.append(own[before[:, lag]])
            values.append(-factor / left)
    return rows, columns, values


def _known_before(there: BoolArray, follows: BoolArray, most: int) -> IndexArray:
    """Return how many samples in a row stand before each, (n,), at most so many."""
    known = np.zeros(there.size, dtype=np.intp)
    for lag in range(1, most + 1):
        # one more than before, where the sample that far back hangs together with this one
        unbroken = known == lag - 1
        unbroken[:lag] = False
        at = np.flatnonzero(unbroken)
        known[at[there[at - lag] & follows[at - lag + 1]]] = lag
    return known
