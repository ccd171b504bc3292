"""How fast a run moves where its log begins, where only the position is read.

A log that was cut from a motion begins in it: an arm that falls, a coast-down, `from:` within a
run. Taken for at rest, its first window is off by the whole speed, and a whole replay from end to
end. The first readings tell the rate: the slope at the first sample of

    q(t) = q_0 + w t + a t^2 / 2 + j t^3 / 6

by least squares over as many of them as it describes to within the noise,

    sum over k of (q_k - q(t_k))^2 / sigma^2 <= n - 4 + 4 sqrt(2 (n - 4)),

four standard deviations of a chi-square. Its standard deviation is that of the covariance
sigma^2 (X^T X)^-1, with the change that a term in t^4 makes. A rate that is not clear of rest is
none, nor is one that this term makes half as large, nor one of which the first two readings show
less than half, where it would stand out of their noise: what begins at rest with a jolt has a slope
by a polynomial of too few terms. Then a run begins at rest.

Source: Savitzky, Golay, Anal. Chem. 36 (1964) 1627, doi:10.1021/ac60214a047.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.noise import noise_of

_DEGREE = 3
_FEWEST, _MOST = 7, 40
"""Readings through which the polynomial is laid: two more than one more term needs."""
_FITS = 4.0
"""Standard deviations of a chi-square up to which it describes them."""
_CLEAR = 5.0
"""Standard deviations from rest of a rate that is one."""
_SHOWS = 3.0
"""Standard deviations of the difference of two readings from which they show a rate."""
_AGREES = 0.5
"""Share of the slope that one more term has to leave, and that the first readings have to show."""


class Rate(NamedTuple):
    """The rate of a position at the first sample.

    Attributes:
        value: SI/s. spread: its standard deviation.
    """

    value: float
    spread: float


def first_rates(measured: Measured) -> dict[str, Rate]:
    """Return the rates at which a run begins, of states without a sensor whose position is read.

    State -> its rate; without those that begin at rest, and without any where a lock holds them.
    """
    roles = measured.roles
    known = {
        *measured.inputs,
        *(roles.locked if measured.run.locked else ()),
        *(name for name in roles.rates if measured.column(name) is not None),
        *(state for name, (state, _) in roles.geared.items() if measured.column(name) is not None),
    }
    found = {}
    for position, rate in roles.rate_of.items():
        column = measured.column(position)
        if column is None or {position, rate} & known:
            continue
        begins = _rate(measured.time, column)
        if begins is not None and abs(begins.value) > _CLEAR * begins.spread:
            found[rate] = begins
    return found


def _rate(time: FloatArray, values: FloatArray) -> Rate | None:
    """Return the slope of values (n,) at the first time; None where too few tell it."""
    read = np.flatnonzero(np.isfinite(values))[:_MOST]
    noise = noise_of(values)
    if read.size < _FEWEST or not noise > 0.0:
        return None
    found = None
    for count in range(_FEWEST, read.size + 1):
        since, told = time[read[:count]] - time[0], values[read[:count]]
        terms, numbers = _polynomial(since, told, _DEGREE)
        left = terms @ numbers - told
        spare = count - _DEGREE - 1
        if left @ left > (spare + _FITS * (2.0 * spare) ** 0.5) * noise**2:
            break
        slope = float(numbers[1])
        further = float(_polynomial(since, told, _DEGREE + 1)[1][1])
        chance = noise * float(np.sqrt(np.linalg.inv(terms.T @ terms)[1, 1]))
        spread = float(np.hypot(chance, further - slope)) / since[-1]
        if further * slope > _AGREES * slope**2 and _is_shown(
            since, told, slope / since[-1], noise
        ):
            # the most readings: the least spread of several is a lucky one
            found = Rate(slope / since[-1], spread)
    return found


def _is_shown(since: FloatArray, values: FloatArray, rate: float, noise: float) -> bool:
    """Whether the first two readings move as a rate lets them, or hide it in their noise."""
    foreseen = rate * float(since[1] - since[0])
    moved = float(values[1] - values[0])
    return abs(foreseen) < _SHOWS * 2.0**0.5 * noise or moved * foreseen > _AGREES * foreseen**2


def _polynomial(
    since: FloatArray, values: FloatArray, degree: int
) -> tuple[FloatArray, FloatArray]:
    """Return terms (n, degree + 1), of times in the last one's, and their numbers (degree + 1,)."""
    terms = np.asarray(np.vander(since / since[-1], degree + 1, increasing=True), dtype=np.float64)
    return terms, np.asarray(np.linalg.lstsq(terms, values)[0], dtype=np.float64)
