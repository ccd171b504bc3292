"""The colour of a sensor's noise: what it remembers from sample to sample.

Behind a sensor's own low-pass filter the errors of neighbouring samples are correlated. Differences
of neighbours then tell too little of the noise (`noise`), and all of it that is slow would pass for
something missing.

Whiteness is tested by the correlation of neighbours; its standard error of n^(-1/2) holds for any
distribution, so also for readings with a coarse step (Bartlett, J. R. Stat. Soc. Suppl. 8 (1946)
27, doi:10.2307/2983611). Noise that passes is left as it is, and so is noise of which too little
is there, or that only flickers between two steps. Only neighbours that err alike matter: where they
err apart, differences tell too much of the noise, and nothing passes for missing.

What is not white is taken as autoregressive, by restricted maximum likelihood with the parabolas as
what is not of interest (Cooper, Thompson, Biometrika 64 (1977) 625, doi:10.1093/biomet/64.3.625),
of the order that Akaike's criterion asks for. A sampled filter of second order or more has a zero
at half the sampling rate, which no short process has: what is new by it is sharper than it seems,
too little of the noise by its differences, so how sharp it is found to be belongs to a colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.optimize import minimize

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.noise import THIRD
from eha_bench.plants.compiled import njit

_DEGREE = 2
_FLICKERS = 0.5
"""Least noise in steps of the resolution."""
FEWEST = 256
"""Least number of quiet samples of a channel: a correlation of 0.3 is then seen."""
_NOT_BY_CHANCE = 4.26
"""In standard errors: one white channel in a hundred thousand is taken for coloured."""
_ORDERS = 8
_IN_VAIN = 2
"""Orders in a row that are not worth it, after which no higher one is tried."""
_LONGEST = 256
"""Most samples of a stretch in a fit: over more, what is slow is no parabola."""
_MOST = 300
"""Most stretches in a fit: correlations are then known to less than a hundredth."""
_SLOWEST = 0.99


@dataclass(frozen=True)
class Colour:
    """Noise that remembers: an autoregressive process of some order.

    Attributes:
        partial: partial autocorrelations, one for each order.
        sharpness: root mean square of what is new in the noise by its third differences, over that
            by itself; 1 where the process is exactly the noise's.
    """

    partial: tuple[float, ...]
    sharpness: float = 1.0

    @cached_property
    def predictors(self) -> tuple[tuple[FloatArray, float], ...]:
        """What no, one, two, ... samples before say of one (Levinson's recursion).

        Each is factors (of the last sample, the one before, ...) and what stays unknown, in
        standard deviations of the noise.
        """
        factors, left = np.zeros(0), 1.0
        found = [(factors, left)]
        for value in self.partial:
            factors = np.append(factors - value * factors[::-1], value)
            left *= float(np.sqrt(1.0 - value**2))
            found.append((factors, left))
        return tuple(found)

    def correlations(self, count: int) -> FloatArray:
        """Return the correlation of samples 0, 1, ..., count - 1 apart."""
        found = np.zeros(max(count, len(self.partial) + 1))
        found[0] = 1.0
        order = len(self.partial)
        for lag in range(1, found.size):
            if lag <= order:
                # the partial correlation is what the shorter ones do not say
                known, left = self.predictors[lag - 1]
                found[lag] = self.partial[lag - 1] * left**2 + known @ found[lag - 1 : 0 : -1]
            else:
                found[lag] = self.predictors[order][0] @ found[lag - 1 : lag - order - 1 : -1]
        return found[:count]

    def amplitudes(self, count: int) -> FloatArray:
        """Return the size of the first cosines over so many samples, (count,): 1 for white noise.

        Cosine k makes k / 2 turns in all of them; its size is the root of the spectral density.
        """
        factors, left = self.predictors[-1]
        angles = np.pi * np.arange(count) / count
        lags = np.arange(1, factors.size + 1)
        response = 1.0 - np.exp(-1j * np.outer(angles, lags)) @ factors
        return np.asarray(left / np.abs(response), dtype=np.float64)

    def loudness_of_mean(self, count: int) -> float:
        """Return how far a mean of so many samples is off, as a multiple of white noise's.

        The root of the spectral density at no frequency; never more than one sample is off by.
        """
        return float(min(self.amplitudes(1)[0], np.sqrt(count)))

    def whitened(self, values: FloatArray) -> FloatArray:
        """Return what is new in every sample, (n,), its noise white and of the same size.

        NaN where a sample, or one of those before that it remembers, is.
        """
        out = self.whitened_from_first(values)
        out[: len(self.partial)] = np.nan
        return out

    def whitened_from_first(self, values: FloatArray) -> FloatArray:
        """Return what is new in every sample, (n, ...), its noise white and of the same size.

        The first ones are told by as many as there are before them.
        """
        order, size = len(self.partial), values.shape[0]
        factors, left = self.predictors[-1]
        out = values[:order].copy()
        for at, (known, unknown) in enumerate(self.predictors[: out.shape[0]]):
            out[at] -= np.tensordot(known[::-1], values[:at], axes=1)
            out[at] /= unknown
        later = values[order:] / left
        for lag, factor in enumerate(factors, start=1):
            later -= (factor / left) * values[order - lag : max(size, order) - lag]
        return np.concatenate([out, later])


def colour_of(stretches: Sequence[FloatArray]) -> Colour | None:
    """Return the colour of noise, or None where it may be white or too little of it is there.

    Args:
        stretches: each (n,), of nothing but noise, a constant and a parabola.
    """
    if sum(values.size for values in stretches) < FEWEST:
        return None
    if _standard_errors(stretches) < _NOT_BY_CHANCE:
        return None
    return _fit_colour(stretches)


def beside_parabola(values: FloatArray) -> FloatArray:
    """Return what of a stretch no parabola says, (n,)."""
    basis = _parabolas(values.size)
    # an offset that is large compared with the noise is none of it, not even by rounding
    values = values - values[0]
    return np.asarray(values - basis @ (basis.T @ values), dtype=np.float64)


@lru_cache(maxsize=32)
def _parabolas(count: int) -> FloatArray:
    """Return an orthonormal basis of the parabolas, (count, 3), not to be written to."""
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), _DEGREE + 1))[0]
    basis.setflags(write=False)
    return basis


def _standard_errors(stretches: Sequence[FloatArray]) -> float:
    """Return how far neighbours' correlation is above that of white noise, in standard errors."""
    product, expected, square = 0.0, 0.0, 0.0
    count = 0
    for values in stretches:
        beside = beside_parabola(values)
        basis = _parabolas(values.size)
        freedom = values.size - basis.shape[1]
        product += float(beside[1:] @ beside[:-1])
        # parabolas that are taken out leave white noise a little correlated
        taken = -float(np.sum(basis[1:] * basis[:-1]))
        expected += taken / freedom * float(beside @ beside)
        square += float(beside @ beside)
        count += freedom
    if np.sqrt(square / count) <= _FLICKERS * _step_of(np.concatenate(stretches)):
        return 0.0
    return (product - expected) / square * float(np.sqrt(count))


def _step_of(values: FloatArray) -> float:
    """Return the step between levels, two of them included (0: none; inf: nothing but one)."""
    levels = np.unique(values)
    if levels.size > values.size / 2:
        return 0.0
    steps = np.diff(levels)
    return float(np.median(steps[steps > 1e-9 * np.ptp(levels)])) if steps.size else np.inf


def _fit_colour(stretches: Sequence[FloatArray]) -> Colour:
    """Return the colour by restricted maximum likelihood, of the order that is worth it."""
    by_size: dict[int, list[FloatArray]] = {}
    for values in _affordable_stretches(stretches):
        by_size.setdefault(values.size, []).append(values)
    tables = [np.column_stack(own) for own in by_size.values()]

    def cost_of(free: FloatArray) -> float:
        return _minus_twice_log(_colour(free), tables)

    best: tuple[float, Colour] | None = None
    start = np.zeros(0)
    in_vain = 0
    for order in range(1, _ORDERS + 1):
        start = np.append(start, 0.5 if order == 1 else 0.0)
        done = minimize(cost_of, start, method="BFGS", options={"gtol": 1e-2})
        start = np.asarray(done.x, dtype=np.float64)
        cost = float(done.fun) + 2.0 * order
        in_vain += 1
        if best is None or cost < best[0]:
            best, in_vain = (cost, _colour(start)), 0
        if in_vain == _IN_VAIN:
            break
    assert best is not None
    return replace(best[1], sharpness=_sharpness(best[1], stretches))


def _sharpness(colour: Colour, stretches: Sequence[FloatArray]) -> float:
    """Return how sharp what is new in noise is, over stretches of it."""
    order, square, sharp = len(colour.partial), [], []
    for values in stretches:
        new = colour.whitened(beside_parabola(values))[order:]
        square.append(new**2)
        sharp.append(np.diff(new, 3) ** 2 / THIRD)
    ratio = float(np.mean(np.concatenate(sharp)) / np.mean(np.concatenate(square)))
    return float(np.sqrt(min(1.0, ratio)))


def _affordable_stretches(stretches: Sequence[FloatArray]) -> list[FloatArray]:
    """Return stretches of a length and a number that a fit can afford, evenly chosen."""
    parts = [
        part for values in stretches for part in np.array_split(values, -(-values.size // _LONGEST))
    ]
    if len(parts) <= _MOST:
        return parts
    return [parts[at] for at in np.linspace(0, len(parts) - 1, _MOST).round().astype(int)]


def _colour(free: FloatArray) -> Colour:
    """Return the process of unbounded numbers: any of them is a stationary one."""
    return Colour(tuple(float(value) for value in _SLOWEST * np.tanh(free)))


def _minus_twice_log(colour: Colour, tables: Sequence[FloatArray]) -> float:
    """Return minus twice the restricted log likelihood, the noise's size at its best.

    What every sample says beyond those before it is white, and its size does not depend on them:
    the determinant of the noise's covariance is the product of these sizes squared.
    """
    volume, square, count = 0.0, 0.0, 0
    partial = np.array(colour.partial, dtype=np.float64)
    for table in tables:
        size, columns = table.shape
        basis = _parabolas(size)
        own, log = _beside_whitened(partial, table, basis)
        square += own
        volume += 2.0 * columns * log
        count += columns * (size - basis.shape[1])
    return volume + count * float(np.log(square / count))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _beside_whitened(
    partial: FloatArray, table: FloatArray, basis: FloatArray
) -> tuple[float, float]:
    """Return the squares of what is new in noise beside what is new in a basis, and a logarithm.

    The logarithm is that of the product of what stays unknown of every sample, and of the volume
    of the whitened basis. Both are asked for hundreds of times a colour, of little tables.

    Args:
        partial: (p,) partial autocorrelations. table: (n, m) noise. basis: (n, k).
    """
    order, size, columns, wide = partial.size, table.shape[0], table.shape[1], basis.shape[1]
    factors, left = np.zeros((order + 1, order)), np.ones(order + 1)
    for at in range(order):
        for lag in range(at):
            factors[at + 1, lag] = factors[at, lag] - partial[at] * factors[at, at - 1 - lag]
        factors[at + 1, at] = partial[at]
        left[at + 1] = left[at] * np.sqrt(1.0 - partial[at] ** 2)
    white, under = _new_by(factors, left, table), _new_by(factors, left, basis).T.copy()
    log = 0.0
    for row in range(size):
        log += np.log(left[min(row, order)])
    for one in range(wide):
        # twice, as rounding leaves a part of the others the first time
        for again in range(2 * one):
            other = again % one
            under[one] -= np.sum(under[one] * under[other]) * under[other]
        length = np.sqrt(np.sum(under[one] ** 2))
        log += np.log(length)
        under[one] /= length
    along, square = np.zeros((wide, columns)), 0.0
    for row in range(size):
        for column in range(columns):
            square += white[row, column] ** 2
        for one in range(wide):
            for column in range(columns):
                along[one, column] += under[one, row] * white[row, column]
    return square - np.sum(along**2), log


@njit(fastmath={"reassoc", "contract"})
def _new_by(factors: FloatArray, left: FloatArray, values: FloatArray) -> FloatArray:
    """Return what is new in every sample, (n, m), as `Colour.whitened_from_first`."""
    white, order = values.copy(), left.size - 1
    for row in range(values.shape[0]):
        known = min(row, order)
        for lag in range(known):
            for column in range(values.shape[1]):
                white[row, column] -= factors[known, lag] * values[row - 1 - lag, column]
        for column in range(values.shape[1]):
            white[row, column] /= left[known]
    return white
