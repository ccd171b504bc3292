"""Every cause over the nights, the oil taken out, and what explains a change.

A night's evidence is (A, g), steps of the causes about the healthy machine (`evidence`). Two things
move a healthy machine from night to night: its oil, and what nobody knows. Both act on the
parameters that are calibrated. Where the oil's temperature is logged, their estimates on healthy
nights give the line over it (with a normal prior of 3 % of a parameter a kelvin, so that few nights
do not invent one). Where it is not, the machine is its own thermometer: what is viscous grows with
the oil's viscosity and laminar leakage falls with it, all together, by a factor of the night that
nobody knows (`thinning`). The covariance of what is left comes from their estimates as well. So,
for one cause c with all else as it varies,

    y = y_P - healthy - b (T - T_healthy),    cov y = A_PP^-1 + C + s^2 v v',
    z = g_E - A_EP y_P - z_healthy,           cov z = A_EE - A_EP A_PP^-1 A_PE,

with y_P the calibrated parameters as the night's fit has them, and z the slope of the likelihood by
effects that they leave; both are independent of each other. A parameter that changes shows in y
alone, an effect by A_PP^-1 A_Pc in y and by its column of cov z in z. Its change is the one of
generalised least squares; its gain, the square of that over its variance, is what it explains of a
night. The gains of a cause over the nights since a change say which it is.

A night on which a run failed is compared with the same runs of the healthy nights only.
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
from eha_bench.causes.thinning import Thinning, exponents_of, thinning_of
from eha_bench.core.arrays import FloatArray

_OF_OIL: Final = 0.03
"""Standard deviation of what a kelvin does to a parameter beforehand, as a share of it."""
_RANK: Final = 1e-10
"""Eigenvalue of A_PP, scaled to a diagonal of ones, below which a direction says nothing."""
_OWN: Final = 0.3
"""Standard deviation of z on top of its noise, of that: slopes differ from night to night, and the
difference of two effects that look alike is known no better than that."""
_APART: Final = 1e-4
"""Part of an effect's slope that no parameter imitates, below which all of it is theirs."""
_OF_MEDIAN: Final = 1.57
"""Variance of a median over that of a mean."""
_OF_FEW: Final = 3.0
"""Nights' worth of belief that parameters vary independently of each other."""
_FEWEST: Final = 3
"""Healthy nights with the same runs that a night can be compared with."""


@dataclass(frozen=True)
class Estimates:
    """Causes over the nights, in steps of each from the healthy machine.

    Attributes:
        changes: (nights, causes) if it alone changed; NaN where the night is blind to it.
        deviations: (nights, causes) standard. gains: (nights, causes) chi square that it explains.
        totals: (nights,) that all causes together explain. ranks: (nights,) with how many numbers.
        oil: whether oil temperature was taken out. thinning: whether the oil's viscosity was, as
            the machine shows it.
    """

    changes: FloatArray
    deviations: FloatArray
    gains: FloatArray
    totals: FloatArray
    ranks: FloatArray
    oil: bool
    thinning: bool


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
    exponents = exponents_of(causes)
    varying: dict[frozenset[str], _Varying | None] = {}
    found = []
    for item in evidence:
        runs = item.runs
        if runs not in varying:
            alike = [known.of(runs) for known in evidence[:healthy] if known.runs >= runs]
            varying[runs] = (
                _Varying.of(alike, parameters, sizes, exponents) if len(alike) >= _FEWEST else None
            )
        known = varying[runs]
        found.append(known.night(item) if known is not None else _blind(len(causes)))
    changes, deviations, gains = (np.array([item[k] for item in found]) for k in range(3))
    for item, gain in zip(evidence, gains, strict=True):
        _as_fitted(item, gain)
    totals, ranks = (np.array([item[k] for item in found]) for k in (3, 4))
    oil = any(item is not None and item.oil for item in varying.values())
    thinning = not oil and bool(exponents.any())
    return Estimates(changes, deviations, gains, totals, ranks, oil, thinning)


def _as_fitted(item: NightEvidence, gains: FloatArray) -> None:
    """Set gains of effects that were fitted by what each left of a night more than the best one.

    A fit goes where slopes only point to: it knows better what an effect explains.
    """
    if not item.fitted:
        return
    best = min(item.fitted, key=lambda name: item.fitted[name])
    most = float(gains[item.names.index(best)])
    for name, cost in item.fitted.items():
        gains[item.names.index(name)] = max(0.0, most - (cost - item.fitted[best]))


_Told = tuple[FloatArray, FloatArray, FloatArray, float, float]


def _blind(count: int) -> _Told:
    nothing = np.full(count, np.nan)
    return nothing, nothing, np.zeros(count), 0.0, 0.0


@dataclass(frozen=True)
class _Varying:
    """How a healthy machine varies from night to night.

    Attributes:
        parameters: (q,) places of the calibrated causes. others: (p - q,) of the rest.
        usual: (q,) of the calibrated ones on healthy nights. left: (p - q,) z of a healthy night.
        line: (q,) change a kelvin. line_covariance: (q, q). middle: K.
        scatter: (q, q) covariance of the rest. doubt: variance of a night's noise less the
            healthy nights', over its own. oil: whether temperatures are known.
    """

    parameters: NDArray[np.intp]
    others: NDArray[np.intp]
    usual: FloatArray
    left: FloatArray
    line: FloatArray
    line_covariance: FloatArray
    middle: float
    scatter: FloatArray
    doubt: float
    oil: bool

    @staticmethod
    def of(
        nights: Sequence[NightEvidence],
        parameters: NDArray[np.intp],
        sizes: FloatArray,
        exponents: FloatArray,
    ) -> _Varying:
        """Return it as healthy nights, all with the same runs, show it."""
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
        thinning = (
            Thinning.none(q)
            if oil
            else thinning_of(own, noise, exponents[parameters], sizes[parameters])
        )
        # by differences: a wear that has begun unseen does not pass for how nights vary
        known = own - np.outer(away, line) - thinning.on(own)
        rest = np.diff(known, axis=0) / math.sqrt(2.0)
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
        covariance += thinning.covariance
        others = np.setdiff1d(np.arange(sizes.size), parameters)
        left = [
            (item.slope - item.curvature[:, parameters] @ estimate)[others]
            for item, estimate in zip(nights, own, strict=True)
        ]
        usual = np.median(own - np.outer(away, line), axis=0)
        doubt = 1.0 + _OF_MEDIAN / len(nights)
        return _Varying(
            parameters, others, usual, np.median(left, axis=0), line, line_covariance, middle,
            covariance, doubt, oil,
        )  # fmt: skip

    def night(self, item: NightEvidence) -> _Told:
        """Return changes, deviations and gains of the causes, what all explain, and the rank."""
        parts = self._seen(item)
        information, score = np.zeros(len(item.names)), np.zeros(len(item.names))
        total = rank = 0.0
        for part in parts:
            solved = np.linalg.solve(
                part.covariance, np.column_stack([part.values, part.signs, part.noise])
            )
            width = part.signs.shape[1]
            information += np.einsum("ik,ik->k", solved[:, 1 : 1 + width], part.signs)
            score += part.signs.T @ solved[:, 0]
            total += float(part.values @ solved[:, 0])
            rank += float(np.trace(solved[:, 1 + width :]))
        blind = ~(np.diag(item.curvature) > 0.0) | ~(information > 0.0)
        information = np.where(blind, 1.0, information)
        change, gain = score / information, score**2 / information
        change, deviation = (
            np.where(blind, np.nan, change),
            np.where(blind, np.nan, information**-0.5),
        )
        return change, deviation, np.where(blind, 0.0, gain), total, rank

    def _seen(self, item: NightEvidence) -> tuple[_Seen, _Seen]:
        """Return the calibrated parameters, whitened, and the slopes that they leave."""
        away = item.oil_temperature - self.middle if self.oil else 0.0
        away = away if math.isfinite(away) else 0.0
        size = np.sqrt(np.diag(item.curvature))
        scale = np.where(size > 0.0, size, 1.0)
        scaled = item.curvature / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled[np.ix_(self.parameters, self.parameters)])
        keep = values > _RANK * max(float(values.max(initial=0.0)), 1e-300)
        root, vectors = np.sqrt(values[keep]), vectors[:, keep]
        signs = (vectors.T @ scaled[self.parameters]) / root[:, None] * scale
        own = (vectors.T @ (item.slope / scale)[self.parameters]) / root
        calibrated = signs[:, self.parameters]
        varied = calibrated @ (self.scatter + away**2 * self.line_covariance) @ calibrated.T
        noise = self.doubt * np.eye(root.size)
        usual = calibrated @ (self.usual + self.line * away)
        parameters = _Seen(own - usual, signs, noise + varied, noise + varied)
        rest = item.curvature[self.others] - signs[:, self.others].T @ signs
        deviation = np.sqrt(np.maximum(np.diag(rest[:, self.others]), 0.0))
        apart = deviation > _APART * size[self.others]
        deviation = np.where(apart, deviation, 1.0)
        slopes = item.slope[self.others] - signs[:, self.others].T @ own - self.left
        rest = rest / deviation[:, None] * apart[:, None]
        noise = self.doubt * rest[:, self.others] / deviation
        covariance = noise + _OWN**2 * np.eye(deviation.size)
        return parameters, _Seen(slopes / deviation * apart, rest, covariance, noise)


@dataclass(frozen=True)
class _Seen:
    """Numbers of a night that are independent of its others.

    Attributes:
        values: (m,). signs: (m, p) what a step of each cause does to them. covariance: (m, m).
        noise: (m, m) the part of it that healthy nights have.
    """

    values: FloatArray
    signs: FloatArray
    covariance: FloatArray
    noise: FloatArray


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
