"""Intervals that respect correlated residuals, and directions that the data do not determine.

The variance is the larger of the usual one, scaled by the mean square of the residual, and of the
sandwich H^-1 (sum over blocks g g') H^-1 with blocks of 0.3 s, which stays right where residuals
are correlated (White, Econometrica 48 (1980) 817, doi:10.2307/1912934; Liang, Zeger, Biometrika 73
(1986) 13, doi:10.1093/biomet/73.1.13).

Where an equation's form is not quite right, runs made under other conditions ask for other values.
Where runs disagree more than chance would (Chow, Econometrica 28 (1960) 591, doi:10.2307/1910133),
the variance grows by how much leaving runs out changes, over what noise would change (Birge, Phys.
Rev. 40 (1932) 207, doi:10.1103/PhysRev.40.207). Runs are few, so that ratio is averaged with that
of all parameters (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3, doi:10.2202/1544-6115.1027) and
Student's t takes as many degrees of freedom as runs of equal say are worth (Carter, Schnepel,
Steigerwald, Rev. Econ. Stat. 99 (2017) 698, doi:10.1162/REST_a_00639).

Where a stick event jumps, the cost is not a parabola, and no Jacobian says how well it determines a
parameter. The sizes of effects are therefore checked against their profile (`profile`). What the
step of integration moves (`finish`) is added as a separate error.

No data say by how much an effect's equation is itself inexact: what a fit can follow, it follows.
With a hundred thousand samples noise leaves a few parts in ten thousand of an effect's size, and
against a plant with another integrator that was too little: sizes were off by one to two
thousandths. So a thousandth of the size is added, as a standard uncertainty that comes from
judgement (type B of JCGM 100:2008, section 4.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtri, stdtrit

from eha_bench.core.arrays import FloatArray
from eha_bench.core.finite import finite_or_none
from eha_bench.diagnosis.fit.evidence import Groups
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import soften

_Z = 1.96
LOOSE = 0.3
"""Standard deviation along a direction, as a share of a parameter, from which it is open."""
_LOOSE_TOGETHER = 0.1
"""The same where three and more parameters move together: each moves by a part of it."""
_RIDGE = 0.02
_CONCERNED = 0.01
_CHANCE = 0.05
_TOGETHER = 3
"""Blocks of 0.1 s that are taken together: an error with a memory of 20 ms is longer than one."""
_INEXACT = 1e-3
"""Standard uncertainty of an effect's equation, of the size that is fitted."""
_OPEN = 1e3
"""Half of an interval, in sizes of the parameter, from which there is none."""
_BELIEVED = 0.5
"""Standard deviation of what is believed of a parameter that data leave open, as a share of it."""
_ALONE = 0.1
"""Below this many degrees of freedom one run says nearly all, and no other can disagree."""


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, SI.

    Attributes:
        value: SI. low, high: interval; infinite where there is none. unit: SI.
        profile: interval by the profile of the likelihood, where that is another one.
    """

    value: float
    low: float
    high: float
    unit: str
    profile: tuple[float, float] | None = None

    @property
    def without_interval(self) -> Estimate:
        """The number alone."""
        return replace(self, low=-float("inf"), high=float("inf"), profile=None)


@dataclass(frozen=True)
class Spread:
    """How far a fitted number may be off.

    Attributes:
        deviation: standard deviation, SI (inf: not determined).
        degrees: of freedom with which that is known.
        inflation: its variance over what white noise of the sensors' size alone would make.
    """

    deviation: float
    degrees: float = float("inf")
    inflation: float = 1.0

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval, SI (inf: not determined)."""
        return self.deviation * float(stdtrit(self.degrees, 0.975))

    @property
    def least_fall(self) -> float:
        """Fall of the cost from which a value lies outside of the 95 % interval.

        For a cost that is a parabola this is the interval itself: its half width h has
        h^2 = t^2 inflation / curvature. Where it is none, the fall is the better measure (Hauck,
        Donner, J. Am. Stat. Assoc. 72 (1977) 851, doi:10.1080/01621459.1977.10479969).
        """
        return self.inflation * float(stdtrit(self.degrees, 0.975)) ** 2


def spreads(fit: Fit, groups: Groups) -> dict[str, Spread]:
    """Return how far every fitted number may be off, by key.

    Args:
        fit: with the Jacobian at its own place. groups: rows by block and by run.
    """
    if not fit.free:
        return {}
    soft, weight = soften(fit.residual, fit.soft)
    weighted = fit.jacobian * weight[:, None]
    lengths = np.linalg.norm(weighted, axis=0)
    dead = lengths < 1e-3
    scale = np.where(dead, 1.0, lengths)
    matrix = weighted / scale
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    inverse = vectors @ np.diag(1.0 / np.maximum(values, 1e-12)) @ vectors.T
    scores = _scores(matrix, soft, groups)
    middle = sum((own.T @ own for own in scores), np.zeros_like(inverse))
    sandwich = np.diag(inverse @ middle @ inverse)
    usual = np.diag(inverse) * max(1.0, float(soft @ soft) / max(1, soft.size - len(fit.free)))
    ratio, degrees = _disagreement(matrix, soft, scores, groups)
    variance = np.maximum(sandwich, usual) * ratio
    return {
        item.key: Spread(
            float("inf") if dead[k] else float(np.sqrt(variance[k]) / scale[k] * item.scale),
            float(degrees[k]),
            float(variance[k] / max(inverse[k, k], 1e-300)),
        )
        for k, item in enumerate(fit.free)
    }


def _scores(matrix: FloatArray, soft: FloatArray, groups: Groups) -> list[FloatArray]:
    """Return the gradient of each block, (blocks, p), run by run."""
    owner = np.zeros(soft.size, dtype=np.intp)
    for number, rows in enumerate(groups.runs):
        owner[rows] = number
    found: list[list[FloatArray]] = [[] for _ in groups.runs]
    for rows in groups.blocks:
        found[owner[rows[0]]].append(matrix[rows].T @ soft[rows])
    return [
        np.add.reduceat(np.array(own), np.arange(0, len(own), _TOGETHER), axis=0)
        if own
        else np.zeros((1, matrix.shape[1]))
        for own in found
    ]


def _disagreement(
    matrix: FloatArray, soft: FloatArray, scores: Sequence[FloatArray], groups: Groups
) -> tuple[FloatArray, FloatArray]:
    """Return by how much runs disagree about each parameter, and how well that is known.

    Every run is left out in turn, to first order, and the square of what that changes is held
    against what noise would change, as correlated as it is within a run. Where runs disagree at
    all, a parameter that few of them tell borrows from the others: its own ratio and that of all
    are averaged by their degrees of freedom.

    Args:
        matrix: (N, p) weighted, columns of length 1. soft: (N,).
        scores: (blocks, p) of each run. groups: rows by block and by run.

    Returns:
        (p,) ratio of variances, 1 where chance makes as much; (p,) its degrees of freedom.
    """
    normal = matrix.T @ matrix
    gradient = matrix.T @ soft
    size = matrix.shape[1]
    # what a left-out run alone determines stays near where it was
    ridge = _RIDGE * np.diag(np.diag(normal))
    to_the_end = -np.linalg.pinv(normal + ridge, rcond=1e-10) @ gradient
    total, shares, squares = np.zeros(size), np.zeros(size), np.zeros(size)
    chow, ranks = 0.0, -size
    for rows, blocks in zip(groups.runs, scores, strict=True):
        part = matrix[rows]
        own = part.T @ part
        score = blocks.sum(axis=0)
        apart = blocks - blocks.mean(axis=0)
        noise = apart.T @ apart
        inverse = np.linalg.pinv(normal - own + ridge, rcond=1e-10)
        step = inverse @ (score - gradient) - to_the_end
        expected = np.maximum(np.diag(inverse @ own @ inverse), np.diag(inverse @ noise @ inverse))
        # a run that says nothing about a parameter has no say
        concerned = np.diag(own) > _CONCERNED
        total += np.where(concerned, step**2 / np.maximum(expected, 1e-300), 0.0)
        shares += np.where(concerned, np.diag(own), 0.0)
        squares += np.where(concerned, np.diag(own) ** 2, 0.0)
        values, vectors = np.linalg.eigh(own)
        concerning = values > _CONCERNED * max(float(values.max(initial=0.0)), 1e-300)
        level = np.maximum(values, np.diag(vectors.T @ noise @ vectors))[concerning]
        chow += float(np.sum((vectors[:, concerning].T @ score) ** 2 / level))
        ranks += int(concerning.sum())
    if ranks <= 0 or chow < chdtri(ranks, _CHANCE):
        return np.ones(size), np.full(size, np.inf)
    # as many runs of equal say as these are worth
    own_degrees = shares**2 / np.maximum(squares, 1e-300) - 1.0
    own_degrees = np.where(own_degrees > _ALONE, own_degrees, 0.0)
    shared = ranks / size
    degrees = own_degrees + shared
    ratio = (np.where(own_degrees > 0.0, total, 0.0) + shared * chow / ranks) / degrees
    return np.maximum(ratio, 1.0), degrees


def estimates(
    fit: Fit,
    groups: Groups,
    units: dict[str, str],
    profiled: Mapping[str, float] | None = None,
    shift: Mapping[str, float] | None = None,
) -> dict[str, Estimate]:
    """Return every fitted number with its 95 % interval inside its bounds, by key.

    Args:
        fit: with the Jacobian at its own place. groups: rows by block and by run.
        units: by key. profiled: standard deviations by the profile, SI, where there is one.
        shift: what halving the step of integration moves each number by, SI (`finish`).
    """
    found = {}
    for key, spread in spreads(fit, groups).items():
        item = next(free for free in fit.free if free.key == key)
        value = float(fit.vector[item.at])
        wider = replace(spread, deviation=max(spread.deviation, (profiled or {}).get(key, 0.0)))
        inexact = _INEXACT * abs(value) if item.of_effect else 0.0
        further = np.hypot((shift or {}).get(key, 0.0), inexact)
        half = float(np.hypot(wider.half_width, _Z * further))
        if half > _OPEN * max(abs(value), item.scale):
            half = float("inf")
        low, high = (max(item.low, value - half), min(item.high, value + half))
        if np.isinf(half):
            low, high = -half, half
        found[key] = Estimate(value, low, high, units.get(key, ""))
    return found


def covariance(fit: Fit, groups: Groups) -> FloatArray:
    """Return the covariance of all fitted numbers, (p, p) SI, in the order of `fit.free`.

    Correlations are those of the information matrix, standard deviations those of the intervals
    (infinite ones where nothing is determined).
    """
    _, weight = soften(fit.residual, fit.soft)
    weighted = fit.jacobian * weight[:, None]
    lengths = np.maximum(np.linalg.norm(weighted, axis=0), 1e-300)
    normal = (weighted / lengths).T @ (weighted / lengths)
    inverse = np.linalg.inv(normal + 1e-12 * np.eye(len(fit.free)))
    root = np.sqrt(np.diag(inverse))
    deviations = np.array([item.deviation for item in spreads(fit, groups).values()])
    with np.errstate(invalid="ignore"):  # no correlation with what is not determined
        return np.asarray(inverse / np.outer(root, root) * np.outer(deviations, deviations))


@dataclass(frozen=True)
class Covariance:
    """Of fitted numbers: their keys in order, and the matrix, (p, p) SI."""

    parameters: tuple[str, ...]
    matrix: FloatArray

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON; what is not determined is null."""
        rows = [[finite_or_none(float(x)) for x in row] for row in self.matrix]
        return {"parameters": list(self.parameters), "matrix": rows}


def posterior(fit: Fit, groups: Groups) -> Covariance:
    """Return the covariance of what all runs share, finite also where data determine nothing.

    The information of the data, each parameter's as much smaller as its interval is wider than
    white noise makes it (`spreads`), and a Gaussian prior: half a parameter's size, or
    a uniform distribution's deviation between its bounds where that is less. Draws from it move
    along what data leave open, and nowhere else. What belongs to one run is left out
    (marginal), and so is what is the log's.

    Args:
        fit: with the Jacobian at its own place. groups: rows by block and by run.
    """
    keep = [k for k, item in enumerate(fit.free) if not item.run and not item.of_log]
    keys = tuple(fit.free[k].key for k in keep)
    if not keys:
        return Covariance((), np.zeros((0, 0)))
    _, weight = soften(fit.residual, fit.soft)
    weighted = fit.jacobian * weight[:, None]
    normal = weighted.T @ weighted
    scale = np.array([item.scale for item in fit.free])
    size = np.maximum(np.abs([fit.vector[item.at] for item in fit.free]), scale)
    width = np.array([item.high - item.low for item in fit.free])
    belief = np.minimum(_BELIEVED * size, np.where(width > 0.0, width, np.inf) / np.sqrt(12.0))
    belief = belief / scale
    usual = np.sqrt(np.diag(_with_belief(normal, belief)))
    given = np.array([item.deviation for item in spreads(fit, groups).values()]) / scale
    # what is open stays open: only where data tell a parameter may they tell it less well
    ratio = np.where(np.isfinite(given), np.minimum(usual / np.maximum(given, 1e-300), 1.0), 1.0)
    inverse = _with_belief(normal * np.outer(ratio, ratio), belief)
    matrix = (inverse * np.outer(scale, scale))[np.ix_(keep, keep)]
    return Covariance(keys, np.asarray(0.5 * (matrix + matrix.T)))


def _with_belief(normal: FloatArray, belief: FloatArray) -> FloatArray:
    """Return the covariance of an information matrix and a prior, (p, p).

    In units of the prior every eigenvalue is 1 at least, so what data tell a million times better
    than something else does not spoil it.

    Args:
        normal: (p, p) information. belief: (p,) standard deviations of the prior.
    """
    values, vectors = np.linalg.eigh(np.outer(belief, belief) * normal)
    root = (vectors / np.sqrt(1.0 + np.maximum(values, 0.0))) * belief[:, None]
    return np.asarray(root @ root.T)


_ALIKE = 1.1
"""Factor that relative changes of two may differ by where these keep a product or a ratio."""
_HELD = "; along it their intervals are what `within` says"


@dataclass(frozen=True)
class ParameterDirection:
    """A direction in which the parameters of a calibration may move.

    Attributes:
        deviation: standard deviation along it, as a share of the parameters (0.3: 30 %).
        shares: parameter -> part that it takes in it, of a direction of length 1.
    """

    deviation: float
    shares: Mapping[str, float]

    def words(self) -> str:
        """Say it in words."""
        names = list(self.shares)
        if len(names) == 1:
            text = f"{names[0]} is not determined by these data"
        elif len(names) == 2:
            text = f"{names[0]} and {names[1]} only {self._of_two(*self.shares.values())}"
        else:
            text = f"{', '.join(names[:-1])} and {names[-1]} only in combination"
        if self.deviation > _OPEN:
            return f"{text} (the data do not depend on it)"
        return f"{text} (one standard deviation along it is {100.0 * self.deviation:.3g} %)"

    @staticmethod
    def _of_two(first: float, second: float) -> str:
        """Say how two may move together: shares are of relative changes."""
        times = abs(second / first)
        if 1.0 / _ALIKE < times < _ALIKE:
            return "as a ratio" if first * second > 0 else "as a product"
        way = "grows" if first * second > 0 else "falls"
        return f"together: where the first grows by 1 %, the second {way} by {times:.2g} %"


def undetermined_directions(fit: Fit) -> tuple[str, ...]:
    """Return, in words, the directions in which the parameters could move unnoticed.

    A direction counts where one standard deviation along it changes parameters by 30 %, or three
    and more of them together by 10 %. What is believed of them beforehand has no say in that; where
    it alone holds them, that is said.
    """
    open_ = open_parameters(fit)
    return tuple(
        item.words() + (_HELD if fit.beliefs and not open_ & item.shares.keys() else "")
        for item in directions(fit)
        if item.deviation >= (LOOSE if len(item.shares) < 3 else _LOOSE_TOGETHER)
    )


def open_parameters(fit: Fit) -> frozenset[str]:
    """Return the parameters that nothing determines: no interval says anything of them.

    What is believed of them beforehand has its say: a value that only `within` holds has an
    interval as wide as that leaves it.
    """
    return frozenset(
        key
        for item in directions(fit, believed=True)
        for key, share in item.shares.items()
        if item.deviation * abs(share) >= LOOSE
    )


def directions(fit: Fit, *, believed: bool = False) -> tuple[ParameterDirection, ...]:
    """Return the directions of the information matrix of the parameters, the weakest first.

    Args:
        fit: with its Jacobian. believed: whether what is believed beforehand informs as data do.
    """
    free = [item for item in fit.free if not item.of_effect and not item.run]
    columns = [k for k, item in enumerate(fit.free) if item in free]
    if not columns:
        return ()
    rows = slice(fit.residual.size - (0 if believed else fit.beliefs))
    _, weight = soften(fit.residual[rows], fit.soft)
    size = np.array([abs(fit.vector[item.at]) or item.scale for item in free])
    scale = np.array([item.scale for item in free])
    matrix = fit.jacobian[rows][:, columns] * weight[:, None] * (size / scale)
    level = float(np.sqrt(max(1.0, fit.cost / max(1, fit.residual.size))))
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    found = []
    for k in range(values.size):
        direction = vectors[:, k]
        order = np.argsort(-np.abs(direction))
        main = [int(j) for j in order if abs(direction[j]) > 0.4 * abs(direction[order[0]])]
        deviation = level / float(np.sqrt(max(values[k], 1e-300)))
        found.append(
            ParameterDirection(deviation, {free[j].key: float(direction[j]) for j in main})
        )
    return tuple(found)
