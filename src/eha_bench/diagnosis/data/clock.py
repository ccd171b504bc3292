"""Stamps off a regular clock: late by what the log's computer did, or true?

A log is often stamped when a message arrives. Where stamps are off a regular clock by a part of
a period, however long the run, something regular drove the sampling; that the readings
themselves were taken regularly shows in them: where a channel moves, a sample that was really taken
late has gone on by its slope times the delay. The third differences of the readings are held
against those of slope times delay: a slope of regression of 0 says regular, of 1 that stamps are
true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray

_BESIDE = 0.3
"""Root mean square of what stamps of a regular clock are off it at most, in periods."""
_NOTICED = 1e-3
"""And at least, in periods, to be worth it."""
_FEWEST = 50
_ROUNDS = 3
_SHARED = 1e-3
"""Share of the samples whose stamps may scatter so far that two are next to one tick."""
DECISIVE = 20.0
"""Least sum of squares that tells 0 from 1: noise is 0.4 of its unit, so the slope's error 0.1."""


@dataclass(frozen=True)
class RegularClock:
    """A regular clock that stamps are off.

    Attributes:
        tick: (n,) whole number of its tick for each stamp, from 0. period, first: s.
        late: (n,) what each stamp lies behind its tick, s.
    """

    tick: FloatArray
    period: float
    first: float
    late: FloatArray

    @property
    def times(self) -> FloatArray:
        """The clock's own times of the samples, (n,) s."""
        return self.first + self.period * self.tick

    @property
    def beside(self) -> float:
        """Root mean square of what stamps are off it, s."""
        return float(np.sqrt(np.mean(self.late**2)))

    @property
    def lost(self) -> int:
        """How many ticks have no sample."""
        return round(float(self.tick[-1])) + 1 - self.tick.size


@dataclass(frozen=True)
class ClockEvidence:
    """What readings say of stamps: a regression of 0 says regular, of 1 that stamps are true.

    Attributes:
        product, square: sums of what was seen times what is expected, and of its square.
    """

    product: float = 0.0
    square: float = 0.0

    def __add__(self, other: ClockEvidence) -> ClockEvidence:
        """What both say together."""
        return ClockEvidence(self.product + other.product, self.square + other.square)

    @property
    def is_decisive(self) -> bool:
        """Whether it decides between the two."""
        return self.square >= DECISIVE

    @property
    def for_stamps(self) -> bool:
        """Whether it is for the stamps."""
        return self.product > 0.5 * self.square


def regular_clock(time: FloatArray, channels: Sequence[FloatArray]) -> FloatArray | None:
    """Return the regular clock by which samples were taken, (n,) s, or None where stamps are true.

    Args:
        time: (n,) stamps, s from the first one. channels: (n,) readings, NaN where there are none.
    """
    clock = clock_beside(time)
    if clock is None or not _NOTICED * clock.period < clock.beside:
        return None
    evidence = clock_evidence(clock, channels)
    return None if not evidence.is_decisive or evidence.for_stamps else clock.tick * clock.period


def clock_beside(time: FloatArray) -> RegularClock | None:
    """Return the regular clock that stamps stay near, however long the run, if there is one.

    Args:
        time: (n,) stamps, s.
    """
    if time.size < _FEWEST:
        return None
    steps = np.diff(time)
    usual = float(np.median(steps))
    if usual <= 0.0:
        return None
    slope, first, count = usual, float(time[0]), 0
    while count < time.size:
        # counted from a few samples on, twice as many at a time: where stamps scatter, one step
        # that is rounded to the wrong tick would shift all that follow
        count = min(max(_FEWEST, 2 * count), time.size)
        for _ in range(_ROUNDS):
            tick = np.rint((time[:count] - first) / slope)
            if not np.ptp(tick) > 0.0:
                return None
            slope, first = np.polyfit(tick, time[:count], 1)
    if not _parted(tick):
        return None
    tick -= tick[0]
    slope, first = (float(value) for value in np.polyfit(tick, time, 1))
    clock = RegularClock(tick, slope, first, time - (first + slope * tick))
    return clock if clock.beside < _BESIDE * slope else None


def _parted(tick: FloatArray) -> bool:
    """Give samples that are next to the same tick one each, in place; return whether that can be.

    Args:
        tick: (n,) whole numbers, in the order of the stamps.
    """
    shared = np.flatnonzero(np.diff(tick) < 1.0)
    if shared.size > _SHARED * tick.size:
        return False
    for at in shared:
        if at + 2 == tick.size or tick[at + 1] + 1.0 < tick[at + 2]:
            tick[at + 1] += 1.0
        elif at == 0 or tick[at] - 1.0 > tick[at - 1]:
            tick[at] -= 1.0
    return bool(np.diff(tick).min() >= 1.0)


def clock_evidence(clock: RegularClock, channels: Sequence[FloatArray]) -> ClockEvidence:
    """Return whether readings have gone on by what their stamps are late.

    Args:
        clock: of the readings. channels: (n,) each, NaN where there are none.
    """
    tick = clock.tick
    product, square = 0.0, 0.0
    whole = tick[3:] - tick[:-3] == 3.0
    for values in channels:
        third = np.diff(values, 3)
        expected = np.diff(clock.late * np.gradient(values, tick * clock.period), 3)
        good = np.isfinite(third) & np.isfinite(expected) & whole
        if not good.any():
            continue
        # jumps of a signal are not noise: what is far off has no say
        far = 4.0 * float(np.median(np.abs(third[good])))
        if far <= 0.0:
            continue
        good &= np.abs(third) < far
        product += float(third[good] @ expected[good]) / far**2
        square += float(expected[good] @ expected[good]) / far**2
    return ClockEvidence(product, square)
