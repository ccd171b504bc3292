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

What a kelvin does, b, is the same on all nights, so that its error is as well: in a course of a
cause it is an influence with a strength of its own (`trends.influence`), and is fitted again with
the changes of that course, on all nights and from what was believed before any of them.

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
from eha_bench.trends.influence import Influence

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
_SHOWS: Final = 0.1
"""Of a night's scatter: an influence that is less than that on all nights together is none."""
_LEAST_OWN: Final = 0.01
"""Part of a variance that is a night's own at least."""
_FEWEST: Final = 3
"""Healthy nights with the same runs that a night can be compared with."""


@dataclass(frozen=True)
class Estimates:
    """Causes over the nights, in steps of each from the healthy machine.

    Attributes:
        changes: (nights, causes) if it alone changed; NaN where the night is blind to it.
        deviations: (nights, causes) standard. scatters: (nights, causes) the part of it that is
            the night's own, and no other's. gains: (nights, causes) chi square that it explains.
        totals: (nights,) that all causes together explain. ranks: (nights,) with how many numbers.
        oil: whether oil temperature was taken out. thinning: whether the oil's viscosity was, as
            the machine shows it.
        kelvins: (nights, causes, q) what the oil's warmth adds to a change, by the slope of each
            calibrated parameter, in units of the standard deviation of that slope beforehand.
        slopes: (q,) those that were taken out, in these units.
    """

    changes: FloatArray
    deviations: FloatArray
    scatters: FloatArray
    gains: FloatArray
    totals: FloatArray
    ranks: FloatArray
    oil: bool
    thinning: bool
    kelvins: FloatArray
    slopes: FloatArray

    def influence(self, cause: int, nights: NDArray[np.intp]) -> Influence:
        """Return what an error of the oil's slopes did to a cause on some nights."""
        columns = self.kelvins[nights, cause]
        least = _SHOWS * float(np.median(self.scatters[nights, cause])) if nights.size else 0.0
        return Influence(columns, -self.slopes).summed(least)


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
        like = varying[runs]
        found.append(
            like.night(item) if like is not None else _Told.blind(len(causes), parameters.size)
        )
    gains = np.array([item.gains for item in found])
    for item, gain in zip(evidence, gains, strict=True):
        _as_fitted(item, gain)
    known = [item for item in varying.values() if item is not None and item.oil]
    fullest = max(known, key=lambda item: item.healthy, default=None)
    return Estimates(
        np.array([item.changes for item in found]),
        np.array([item.deviations for item in found]),
        np.array([item.scatters for item in found]),
        gains,
        np.array([item.total for item in found]),
        np.array([item.rank for item in found]),
        bool(known),
        not known and bool(exponents.any()),
        np.array([item.kelvins for item in found]),
        np.zeros(parameters.size) if fullest is None else fullest.slopes,
    )


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


@dataclass(frozen=True)
class _Told:
    """What a night says of every cause; see `Estimates`."""

    changes: FloatArray
    deviations: FloatArray
    scatters: FloatArray
    gains: FloatArray
    total: float
    rank: float
    kelvins: FloatArray

    @staticmethod
    def blind(count: int, width: int) -> _Told:
        """Return what a night says that says nothing."""
        nothing = np.full(count, np.nan)
        return _Told(nothing, nothing, nothing, np.zeros(count), 0.0, 0.0, np.zeros((count, width)))


@dataclass(frozen=True)
class _Varying:
    """How a healthy machine varies from night to night.

    Attributes:
        parameters: (q,) places of the calibrated causes. others: (p - q,) of the rest.
        usual: (q,) of the calibrated ones on healthy nights. left: (p - q,) z of a healthy night.
        line: (q,) change a kelvin. line_covariance: (q, q). before: (q,) standard deviation of the
            line before any night. middle: K. healthy: how many nights say so.
        scatter: (q, q) covariance of the rest. doubt: variance of a night's noise less the
            healthy nights', over its own. oil: whether temperatures are known.
    """

    parameters: NDArray[np.intp]
    others: NDArray[np.intp]
    usual: FloatArray
    left: FloatArray
    line: FloatArray
    line_covariance: FloatArray
    before: FloatArray
    middle: float
    healthy: int
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
            parameters, others, usual, np.median(left, axis=0), line, line_covariance,
            np.sqrt(prior), middle, len(nights), covariance, doubt, oil,
        )  # fmt: skip

    @property
    def slopes(self) -> FloatArray:
        """The line in standard deviations of what was believed of it before any night."""
        known = self.before > 0.0
        return np.where(known, self.line / np.where(known, self.before, 1.0), 0.0)

    def night(self, item: NightEvidence) -> _Told:
        """Return what a night says of the causes."""
        away = item.oil_temperature - self.middle if self.oil else 0.0
        away = away if math.isfinite(away) else 0.0
        parts = self._seen(item, away)
        count, q = len(item.names), self.parameters.size
        information, score = np.zeros(count), np.zeros(count)
        kelvins, shared = np.zeros((count, q)), np.zeros(count)
        total = rank = 0.0
        for part in parts:
            solved = np.linalg.solve(
                part.covariance, np.column_stack([part.values, part.signs, part.noise])
            )
            weights = solved[:, 1 : 1 + count]
            information += np.einsum("ik,ik->k", weights, part.signs)
            score += part.signs.T @ solved[:, 0]
            total += float(part.values @ solved[:, 0])
            rank += float(np.trace(solved[:, 1 + count :]))
            pull = away * weights.T @ part.warmed
            kelvins += pull * self.before
            shared += np.einsum("kq,qr,kr->k", pull, self.line_covariance, pull)
        blind = ~(np.diag(item.curvature) > 0.0) | ~(information > 0.0)
        information = np.where(blind, 1.0, information)
        change, gain = score / information, score**2 / information
        own = np.maximum(information - shared, _LEAST_OWN * information) / information**2
        return _Told(
            np.where(blind, np.nan, change),
            np.where(blind, np.nan, information**-0.5),
            np.where(blind, np.nan, np.sqrt(own)),
            np.where(blind, 0.0, gain),
            total,
            rank,
            np.where(blind[:, None], 0.0, kelvins / information[:, None]),
        )

    def _seen(self, item: NightEvidence, away: float) -> tuple[_Seen, _Seen]:
        """Return the calibrated parameters, whitened, and the slopes that they leave."""
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
        parameters = _Seen(own - usual, signs, noise + varied, noise + varied, calibrated)
        rest = item.curvature[self.others] - signs[:, self.others].T @ signs
        deviation = np.sqrt(np.maximum(np.diag(rest[:, self.others]), 0.0))
        apart = deviation > _APART * size[self.others]
        deviation = np.where(apart, deviation, 1.0)
        slopes = item.slope[self.others] - signs[:, self.others].T @ own - self.left
        rest = rest / deviation[:, None] * apart[:, None]
        noise = self.doubt * rest[:, self.others] / deviation
        covariance = noise + _OWN**2 * np.eye(deviation.size)
        cold = np.zeros((deviation.size, self.parameters.size))
        return parameters, _Seen(slopes / deviation * apart, rest, covariance, noise, cold)


@dataclass(frozen=True)
class _Seen:
    """Numbers of a night that are independent of its others.

    Attributes:
        values: (m,). signs: (m, p) what a step of each cause does to them. covariance: (m, m).
        noise: (m, m) the part of it that healthy nights have.
        warmed: (m, q) what a change of each calibrated parameter does to them, so that of oil is.
    """

    values: FloatArray
    signs: FloatArray
    covariance: FloatArray
    noise: FloatArray
    warmed: FloatArray


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
