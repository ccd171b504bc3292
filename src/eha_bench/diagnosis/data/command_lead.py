"""Commands that were given more often than they were logged.

A command is held from one logged sample to the next. Where it was computed m times as often, the
next value begins to act before it is logged. The mean of those m values over a sample period T is

    u_k + s (u_k+1 - u_k) - s (1 - s) / 3 T^2 u'',  s = (m - 1) / (2 m),

to second order: s is a quarter for a log of every second value, a half for a command that goes on
between samples, and s T the time by which it leads what was logged. A jump leads nothing: what asks
for it is computed as seldom as it is logged, as a step of a suite is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.diagnosis.data.measured import GAP, Measured

_FEWEST = 3
"""Fewest samples between which something may lead."""
_JUMP = 4.0
"""Change from one sample to the next that is a jump, in the larger one of its neighbours."""
MOST = 0.5
"""Largest share of a sample period: of a command that goes straight from sample to sample."""


def led(measured: Measured, periods: Mapping[str, float]) -> Measured:
    """Return a run whose commands lead what was logged, from a run as it was logged.

    Args:
        measured: the run. periods: input -> s from one value that was given to the next.
    """
    own = {name: period for name, period in periods.items() if name in measured.inputs}
    if not own or measured.time.size < _FEWEST:
        return measured
    inputs = {
        name: _led(measured, values, share_of(own[name], measured.tick)) if name in own else values
        for name, values in measured.inputs.items()
    }
    return replace(measured, inputs=inputs, given_every=own)


def led_like(measured: Measured, others: Sequence[Measured]) -> Measured:
    """Return a run whose commands lead what was logged as they do in runs that were fitted."""
    return led(measured, others[0].given_every) if others else measured


def share_of(period: float, tick: float) -> float:
    """Return the share of a tick by which a command leads that is given every `period`, in s."""
    return min(max(0.5 * (1.0 - period / tick), 0.0), MOST)


def period_of(share: float, tick: float) -> float:
    """Return s from one value to the next of a command that leads by a share of a tick, in s."""
    return tick * (1.0 - 2.0 * share)


def _led(measured: Measured, values: FloatArray, share: float) -> FloatArray:
    steps = np.diff(measured.time)
    # over a gap nobody knows what was commanded
    near = steps < GAP * float(np.median(steps))
    change = np.diff(values)
    smooth = near & ~_jumps(change)
    out = values.copy()
    out[:-1] += np.where(smooth, share * change, 0.0)
    # how it bends, where it does so smoothly on both sides
    bend = 0.5 * (change[2:] - change[:-2])
    around = smooth[:-2] & smooth[1:-1] & smooth[2:]
    out[1:-2] -= np.where(around, share * (1.0 - share) / 3.0 * bend, 0.0)
    return out


def _jumps(change: FloatArray) -> BoolArray:
    """Return where a command changes far more than before and after, (n - 1,)."""
    size = np.abs(change)
    beside = np.zeros(size.size)
    beside[1:] = size[:-1]
    beside[:-1] = np.maximum(beside[:-1], size[1:])
    return np.asarray(size > _JUMP * beside)
