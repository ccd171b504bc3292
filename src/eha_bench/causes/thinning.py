"""The oil's viscosity as the machine itself shows it, where no temperature was logged.

Viscous friction goes with the viscosity, laminar leakage with its inverse (Merritt, Hydraulic
Control Systems, Wiley 1967), so a warm night moves them all by one factor:

    y = v f + rest,   v = exponent * size beforehand,   f ~ N(0, s^2) in the logarithm.

How far each parameter follows (bearings hold grease, seals hold rubber, stiffness falls with warmth
too) is learned on healthy nights, beginning from the physical exponent: one factor, its loadings by
regression on its scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.causes.cause import Cause
from eha_bench.core.arrays import FloatArray

EXPONENTS: Final = {"N*m*s/rad": 1.0, "N*s/m": 1.0, "m^3/(s*Pa)": -1.0}
"""Unit of a parameter -> power of the oil's viscosity that it goes with."""

_SPREAD: Final = (0.01, 0.15)
"""Standard deviation of the viscosity's logarithm at least and at most: a season of some kelvin."""
_SEASON: Final = 2.0
"""The same, of how it varied on healthy nights: a cause that asks for less weather is likelier."""
_LOOSE: Final = 0.5
"""Standard deviation of an exponent beforehand, of what goes with the viscosity."""
_BESIDE: Final = 0.1
"""The same of what does not."""
_FURTHER: Final = 3.0
"""How much further than on healthy nights a season may go where loadings are in doubt."""
_ROUNDS: Final = 3


def exponents_of(causes: Sequence[Cause]) -> FloatArray:
    """Return the powers of the oil's viscosity that causes go with, (causes,)."""
    return np.array([
        EXPONENTS.get(cause.unit, 0.0) if cause.is_calibrated else 0.0 for cause in causes
    ])  # fmt: skip


@dataclass(frozen=True)
class Thinning:
    """How calibrated parameters move together with a viscosity that nobody logged.

    Attributes:
        loadings: (q,) steps a unit of the viscosity's logarithm. doubt: (q,) standard deviations.
        weights: (q,) that give the night's factor from its parameters.
        spread: standard deviation of the factor. reach: how far it may go where loadings are in
            doubt.
    """

    loadings: FloatArray
    doubt: FloatArray
    weights: FloatArray
    spread: float
    reach: float

    @staticmethod
    def none(count: int) -> Thinning:
        """Return no viscosity: it is known otherwise, or nothing goes with it."""
        return Thinning(np.zeros(count), np.zeros(count), np.zeros(count), 0.0, 0.0)

    @property
    def covariance(self) -> FloatArray:
        """What it adds to the covariance of the parameters, (q, q)."""
        together = self.spread**2 * np.outer(self.loadings, self.loadings)
        return np.asarray(together + self.reach**2 * np.diag(self.doubt**2))

    def on(self, nights: FloatArray) -> FloatArray:
        """Return what it did to parameters, (nights, q), about their median."""
        away = nights - np.median(nights, axis=0)
        return np.outer(away @ self.weights, self.loadings)


def thinning_of(
    nights: FloatArray, noise: FloatArray, exponents: FloatArray, sizes: FloatArray
) -> Thinning:
    """Return the viscosity's part in how parameters varied.

    Args:
        nights: (n, q) parameters on healthy nights, in steps. noise: (n, q) their variances.
        exponents: (q,) powers of the viscosity that they go with. sizes: (q,) of them, in steps.
    """
    count, width = nights.shape
    if not (exponents * sizes).any():
        return Thinning.none(width)
    away = nights - np.median(nights, axis=0)
    own = np.maximum(np.median(noise, axis=0), (1e-6 * sizes) ** 2 + 1e-300)
    loadings, level = exponents * sizes, own
    prior = np.maximum((np.where(exponents != 0.0, _LOOSE, _BESIDE) * sizes) ** 2, 1e-300)
    doubt = np.sqrt(prior)
    found = Thinning.none(width)
    for _ in range(_ROUNDS):
        trust = loadings / level
        weights = trust / (float(loadings @ trust) + _SPREAD[1] ** -2)
        scores = away @ weights
        usual = float(np.sqrt(np.mean(scores**2)))
        spread = min(max(_SEASON * usual, _SPREAD[0]), _SPREAD[1])
        found = Thinning(loadings, doubt, weights, spread, min(_FURTHER * usual, _SPREAD[1]))
        # differences: a wear that has begun unseen does not pass for how nights vary
        rest = np.diff(away - np.outer(scores, loadings), axis=0)
        level = np.maximum((rest**2).sum(axis=0) / (2.0 * max(1, count - 2)), own)
        variance = 1.0 / (float(scores @ scores) / level + 1.0 / prior)
        loadings = variance * ((scores @ away) / level + exponents * sizes / prior)
        doubt = np.sqrt(variance)
    return found
