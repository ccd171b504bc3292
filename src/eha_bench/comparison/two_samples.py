"""The difference of two means, whatever the ratio of their scatters and however alike neighbours.

Behrens' and Fisher's problem with a prior: the ratio of the scatters is as likely anywhere up to a
widest one (flat in its logarithm), e.g. between 1 : 12 and 12 : 1, unless other metrics say more
of it (`scatters`). Given the ratio and the correlation of neighbouring repeats the difference
has Student's distribution, so that both are averaged out on a grid (Jeffreys 1940; Box and Tiao
1973, section 2.5). Welch's t supposes that the ratio seen is the true one, which three repeats do
not tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.comparison.scatters import RATIOS
from eha_bench.comparison.student_mixture import StudentMixture
from eha_bench.core.arrays import FloatArray

_FEWEST_RATIOS: Final = 21
_MOST_RATIOS: Final = 401


def widest_ratio(first: int, second: int) -> float:
    """Return up to which ratio of the scatters is thought of, for so many repeats on the sides.

    By simulation (`benchmarks.comparison`): so that scatters of 4 : 1 either way mislead in at most
    5 % of comparisons. Of equally many repeats a wrong ratio does least harm.
    """
    if min(first, second) == 1:
        return 15.0
    if first == second:
        return 12.0
    return 100.0 if min(first, second) == 2 else 20.0


@dataclass(frozen=True)
class TwoSamples:
    """Two samples under every correlation of neighbours and every ratio of scatters.

    Attributes:
        ratios: (r,) logarithms of the first side's scatter over the second's.
        likelihood: (c, r), in any scale.
        centres, errors: (c, r) of the difference of means, SI.
        degrees: of freedom.
    """

    ratios: FloatArray
    likelihood: FloatArray
    centres: FloatArray
    errors: FloatArray
    degrees: float

    @property
    def of_coefficients(self) -> FloatArray:
        """Likelihood of each correlation of neighbours, (c,), in any scale."""
        total: FloatArray = self.likelihood.sum(axis=1)
        return total

    def of_ratios(self, prior: FloatArray) -> FloatArray:
        """Return the likelihood of each of `RATIOS`, (k,), in any scale; `prior` as below."""
        return np.asarray(np.interp(RATIOS, self.ratios, prior @ self.likelihood, 0.0, 0.0))

    def chances(self, prior: FloatArray) -> FloatArray:
        """Return the posterior of the correlation of neighbours, (c,)."""
        weights = prior * self.of_coefficients
        posterior: FloatArray = weights / weights.sum()
        return posterior

    def shown_ratio(
        self, prior: FloatArray, *, scatters: FloatArray | None = None, share: float
    ) -> float:
        """Return the ratio of scatters, either way, that a share of the posterior lies beyond.

        Args:
            prior, scatters: as for `difference`.
            share: of the posterior.
        """
        weights = prior @ self.likelihood
        if scatters is not None:
            weights = weights * np.interp(self.ratios, RATIOS, scatters)
        either = np.abs(self.ratios)
        order = np.argsort(either)
        below = np.cumsum(weights[order])
        place = int(np.searchsorted(below, (1.0 - share) * below[-1]))
        return math.exp(float(either[order][place]))

    def difference(
        self, prior: FloatArray, *, scatters: FloatArray | None = None, wider: float = 1.0
    ) -> StudentMixture:
        """Return what is believed of the difference.

        Args:
            prior: (c,) of the correlation of neighbours.
            scatters: (k,) prior of each of `RATIOS`; flat if None.
            wider: what errors are multiplied by.
        """
        weights = prior[:, None] * self.likelihood
        if scatters is not None:
            weights = weights * np.interp(self.ratios, RATIOS, scatters)
        kept = weights > 1e-15 * weights.max()
        chosen = weights[kept]
        return StudentMixture(
            chosen / chosen.sum(), self.centres[kept], wider * self.errors[kept], self.degrees
        )


def two_samples(
    first: FloatArray, second: FloatArray, coefficients: FloatArray, *, floor: float = 0.0
) -> TwoSamples:
    """Return two samples, at least three values in all of which two on one side differ.

    Args:
        first, second: (n,) and (m,), in the order of their runs.
        coefficients: (c,) correlations of neighbouring repeats that are thought of.
        floor: standard error that the difference has at least, SI.
    """
    one, other = _side(first, coefficients), _side(second, coefficients)
    degrees = first.size + second.size - 2.0
    furthest = math.log(widest_ratio(first.size, second.size))
    # closer than the ratio's own uncertainty, so that none is stepped over
    spread = math.sqrt(0.5 / first.size + 0.5 / second.size)
    wanted = math.ceil(4.0 * furthest / spread)
    ratios = np.linspace(-furthest, furthest, min(max(wanted, _FEWEST_RATIOS), _MOST_RATIOS))
    squares = np.exp(2.0 * ratios)
    total = one.squares[:, None] / squares + other.squares[:, None]
    logarithm = (
        -(first.size - 1.0) * ratios
        - 0.5 * degrees * np.log(np.maximum(total, np.finfo(float).tiny))
        + 0.5 * (np.log(one.share * other.share) - one.volume - other.volume)[:, None]
    )
    variance = total / degrees * (squares * one.share[:, None] + other.share[:, None])
    centres = np.broadcast_to((other.mean - one.mean)[:, None], total.shape)
    errors = np.sqrt(variance + max(floor, np.finfo(float).tiny) ** 2)
    return TwoSamples(ratios, np.exp(logarithm - logarithm.max()), centres, errors, degrees)


@dataclass(frozen=True)
class _Side:
    """A sample under each correlation of neighbours, (c,) each.

    Attributes:
        mean: by generalised least squares.
        share: of a repeat's variance that is the mean's.
        squares: sum of squares about the mean, without the correlation.
        volume: logarithm of the determinant of the correlations.
    """

    mean: FloatArray
    share: FloatArray
    squares: FloatArray
    volume: FloatArray


def _side(values: FloatArray, coefficients: FloatArray) -> _Side:
    middle = float(values.mean())  # about it: no digits are lost
    white = _whitened(values - middle, coefficients)
    ones = _whitened(np.ones(values.size), coefficients)
    share = 1.0 / np.sum(ones**2, axis=1)
    mean = share * np.sum(ones * white, axis=1)
    squares = np.sum((white - mean[:, None] * ones) ** 2, axis=1)
    volume = (values.size - 1.0) * np.log1p(-(coefficients**2))
    return _Side(middle + mean, share, squares, volume)


def _whitened(values: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the values without the correlation of neighbours, shape (c, n)."""
    white = np.tile(values, (coefficients.size, 1))
    past = coefficients[:, None]
    white[:, 1:] = (white[:, 1:] - past * white[:, :-1].copy()) / np.sqrt(1.0 - past**2)
    return white
