"""Every cause over the nights, oil temperature taken out, and what explains a change.

A night's evidence is (A, g), steps of the causes about the healthy machine (`evidence`). Two things
move a healthy machine from night to night: its oil, which is logged or not, and what is unknown.
Both act on the parameters that are calibrated: their estimates on healthy nights give the line over
the oil's temperature (with a normal prior of 3 % of a parameter a kelvin, so that few nights do not
invent one) and the covariance of what is left. So, for one cause c with all else as it varies,

    G = g - g_healthy - A_P b (T - T_healthy),   S = A + A_P C A_P',
    d_c = (a_c' S^-1 G) / (a_c' S^-1 a_c),       var d_c = 1 / (a_c' S^-1 a_c),

generalised least squares in the whitened space of A's eigenvectors. Its gain, d_c^2 / var d_c, is
what c explains of a night; the gains of a cause over the nights since a change say which it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.causes.cause import Cause
from eha_bench.causes.evidence import NightEvidence
from eha_bench.core.arrays import FloatArray

_OF_OIL: Final = 0.03
"""Standard deviation of what a kelvin does to a parameter beforehand, as a share of it."""
_RANK: Final = 1e-11
"""Eigenvalue of A, of the largest, below which a direction says nothing."""
_OF_MEDIAN: Final = 1.57
"""Variance of a median over that of a mean."""
_OF_FEW: Final = 3.0
"""Nights' worth of belief that parameters vary independently of each other."""


@dataclass(frozen=True)
class Estimates:
    """Causes over the nights, in steps of each from the healthy machine.

    Attributes:
        changes: (nights, causes) if it alone changed; NaN where the night is blind to it.
        deviations: (nights, causes) standard. gains: (nights, causes) chi square that it explains.
        totals: (nights,) that all causes together explain. ranks: (nights,) with how many numbers.
        oil: whether oil temperature was taken out.
    """

    changes: FloatArray
    deviations: FloatArray
    gains: FloatArray
    totals: FloatArray
    ranks: FloatArray
    oil: bool


def estimates(
    evidence: Sequence[NightEvidence], causes: Sequence[Cause], sizes: FloatArray, healthy: int
) -> Estimates:
    """Return every cause on every night.

    Args:
        evidence: of nights that have some, in order. causes: what is followed.
        sizes: (p,) of the causes in their steps, where they have one: what 3 % a kelvin are of.
        healthy: how many nights, from the first on, are taken as healthy.
    """
    parameters = np.array([k for k, cause in enumerate(causes) if cause.is_calibrated], dtype=int)
    varying = _Varying.of(evidence[:healthy], parameters, sizes)
    found = [varying.night(item) for item in evidence]
    changes, deviations, gains = (np.array([item[k] for item in found]) for k in range(3))
    totals, ranks = (np.array([item[k] for item in found]) for k in (3, 4))
    return Estimates(changes, deviations, gains, totals, ranks, varying.oil)


@dataclass(frozen=True)
class _Varying:
    """How a healthy machine varies from night to night.

    Attributes:
        parameters: (q,) places of the calibrated causes. slope: (p,) mean of healthy nights.
        line: (q,) change a kelvin. line_covariance: (q, q). middle: K.
        scatter: (q, q) covariance of the rest. doubt: variance of a night's noise less the
            healthy nights', over its own. oil: whether temperatures are known.
    """

    parameters: NDArray[np.intp]
    slope: FloatArray
    line: FloatArray
    line_covariance: FloatArray
    middle: float
    scatter: FloatArray
    doubt: float
    oil: bool

    @staticmethod
    def of(
        nights: Sequence[NightEvidence], parameters: NDArray[np.intp], sizes: FloatArray
    ) -> _Varying:
        """Return it as healthy nights show it."""
        q = parameters.size
        warm = np.array([item.oil_temperature for item in nights])
        oil = bool(np.isfinite(warm).sum() >= 3 and np.nanstd(warm) > 0.0)
        middle = float(np.nanmean(warm)) if oil else math.nan
        away = np.where(np.isfinite(warm), warm - middle, 0.0) if oil else np.zeros(len(nights))
        own, noise = _joint(nights, parameters)
        prior = (_OF_OIL * sizes[parameters]) ** 2
        line, line_covariance = np.zeros(q), np.zeros((q, q))
        if oil and q:
            design = np.column_stack([np.ones(len(nights)), away])
            rest = own - design @ np.linalg.lstsq(design, own, rcond=None)[0]
            level = np.maximum(rest.var(axis=0, ddof=2), np.median(noise, axis=0))
            centred = away - away.mean()
            weight = float(centred @ centred)
            variance = 1.0 / (weight / np.maximum(level, 1e-300) + 1.0 / np.maximum(prior, 1e-300))
            line = variance * (centred @ own) / np.maximum(level, 1e-300)
            line_covariance = np.diag(variance)
        # by differences: a wear that has started unseen does not pass for how nights vary
        rest = np.diff(own - np.outer(away, line), axis=0) / math.sqrt(2.0)
        # an outlier among the healthy nights does not widen all that follows
        spread = 1.4826 * np.median(np.abs(rest), axis=0)
        rest = np.clip(rest, -4.0 * spread, 4.0 * spread)
        degrees = max(1, len(nights) - 1 - int(oil))
        covariance = rest.T @ rest / degrees
        kept = degrees / (degrees + _OF_FEW)
        covariance = kept * covariance + (1.0 - kept) * np.diag(np.diag(covariance))
        # of few nights neither the scatter nor the middle is well known; what is weighted by an
        # estimated covariance is off by more than that covariance says (Hartlap, Simon, Schneider,
        # A&A 464 (2007) 399, doi:10.1051/0004-6361:20066170)
        covariance = covariance * (1.0 + (q + 1.0) / degrees) * (1.0 + _OF_MEDIAN / len(nights))
        # what the parameters do not explain of a night scatters little: its middle is taken apart
        beside = [
            item.slope - item.curvature[:, parameters] @ estimate
            for item, estimate in zip(nights, own, strict=True)
        ]
        usual = np.median(own - np.outer(away, line), axis=0)
        columns = np.median([item.curvature[:, parameters] for item in nights], axis=0)
        slope = np.median(beside, axis=0) + columns @ usual
        doubt = 1.0 + _OF_MEDIAN / len(nights)
        return _Varying(parameters, slope, line, line_covariance, middle, covariance, doubt, oil)

    def night(self, item: NightEvidence) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
        """Return changes, deviations and gains of the causes, what all explain, and the rank."""
        away = item.oil_temperature - self.middle if self.oil else 0.0
        away = away if math.isfinite(away) else 0.0
        columns = item.curvature[:, self.parameters]
        rest = item.slope - self.slope - columns @ (self.line * away)
        values, vectors = np.linalg.eigh(item.curvature)
        keep = values > _RANK * max(float(values.max(initial=0.0)), 1e-300)
        root = np.sqrt(values[keep])
        white = (vectors[:, keep].T @ rest) / root
        signs = root[:, None] * vectors[:, keep].T
        varied = self.scatter + away**2 * self.line_covariance
        beside = signs[:, self.parameters]
        spread = self.doubt * np.eye(root.size) + beside @ varied @ beside.T
        solved = np.linalg.solve(spread, np.column_stack([white[:, None], signs]))
        told = np.einsum("ik,ik->k", signs, solved[:, 1:])
        blind = ~(np.diag(item.curvature) > 0.0) | ~(told > 0.0)
        told = np.where(blind, 1.0, told)
        change = signs.T @ solved[:, 0] / told
        gain = change**2 * told
        change, deviation = np.where(blind, np.nan, change), np.where(blind, np.nan, told**-0.5)
        total = float(white @ solved[:, 0])
        return change, deviation, np.where(blind, 0.0, gain), total, float(root.size)


def _joint(
    nights: Sequence[NightEvidence], parameters: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return the calibrated causes fitted together, (nights, q), and their variances."""
    found, noise = [], []
    for item in nights:
        normal = item.curvature[np.ix_(parameters, parameters)]
        inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
        found.append(inverse @ item.slope[parameters])
        noise.append(np.diag(inverse))
    shape = (len(nights), parameters.size)
    return np.array(found).reshape(shape), np.array(noise).reshape(shape)
