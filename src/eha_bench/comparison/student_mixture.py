"""What is believed of a difference: a mixture of Student's distributions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from eha_bench.core.arrays import FloatArray

_EXACT = 1e-15
"""Of a quantile, as a share: a few roundings."""


@dataclass(frozen=True)
class StudentMixture:
    """A mixture of Student's distributions of the same degrees of freedom.

    Attributes:
        weights: (k,) adding up to 1.
        centres, errors: (k,) of the components, SI; errors positive.
        degrees: of freedom of every component.
    """

    weights: FloatArray
    centres: FloatArray
    errors: FloatArray
    degrees: float

    @staticmethod
    def one(centre: float, error: float, degrees: float) -> StudentMixture:
        """Return a single Student's distribution."""
        return StudentMixture(np.ones(1), np.array([centre]), np.array([error]), degrees)

    def below(self, bound: float) -> float:
        """Return the probability of a value below a bound, accurate in its small tail too."""
        return float(self.weights @ stdtr(self.degrees, (bound - self.centres) / self.errors))

    def above(self, bound: float) -> float:
        """Return the probability of a value above a bound, accurate in its small tail too."""
        return float(self.weights @ stdtr(self.degrees, (self.centres - bound) / self.errors))

    def quantile(self, share: float) -> float:
        """Return the value that a share of the distribution lies below, 0 < share < 1."""
        component = self.centres + self.errors * _student_quantile(self.degrees, share)
        low, high = float(component.min()), float(component.max())
        # it lies between the components' own quantiles, but for rounding
        if self.below(low) >= share:
            return low
        if self.below(high) <= share:
            return high
        return _zero(lambda value: self.below(value) - share, low, high)


def _zero(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=_EXACT * (high - low), rtol=_EXACT))


def _student_quantile(degrees: float, share: float) -> float:
    from scipy.stats import t

    return float(t.ppf(share, degrees))
