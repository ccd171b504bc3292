"""How surely an experiment will decide between rivals, and how well it will tell parameters.

Rivals are forms of causes, and a diagnosis names causes: only those of unlike causes are compared.
Under the rival q a recording is y = f_q(theta) + noise, theta of its posterior. About a centre
theta_c the model is linear in standard coordinates z of that posterior, so the least cost that a
refit reaches is min over d of |y - f_q(theta_c) - J_q d|^2 + |z_c + d|^2, which is solved for; the
best of several centres counts (a Gauss-Newton step from each). A diagnosis names the rival whose
cost lies below that of every other by its threshold `behind`, a likelihood ratio. A lead that a
wrong rival has in the recordings so far has to be made up for as well, and one that the right rival
has is not counted on: resampling did not confirm either. Truths are drawn
from each rival's posterior and simulated without linearisation, noise is drawn; how often the right
rival is named, and how often a wrong one, is counted.

For the search itself the distance of Buzzi-Ferraris and Forzatti serves (Chem. Eng. Sci. 38 (1983)
225, doi:10.1016/0009-2509(83)85004-0): the squared difference of two predictions in units of what
noise and both posteriors make of it, d' (I + A_r + A_q)^-1 d. It costs no draws.

Everything follows from inner products of simulated outputs, which add up over time and over trials.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.response import Bench

DISTINGUISHED = DEFAULT.behind
"""Fall of the cost by which a diagnosis distinguishes a candidate from another."""
BLOCK = 0.1
"""Length of a block, s."""
NOISES = 24
"""Draws of noise for each draw of parameters."""
_SUFFICES = 30.0
"""Distance at which the right rival is named in 95 of 100: the gain is about normal with mean D and
variance 4 D, and has to reach what is asked."""
_SPREAD = 3.0
"""What its sum over blocks is to be on average, in standard deviations, so that it is sure."""
_HALF = 0.5
"""Half of a difference that takes a slope, in standard deviations of the posterior."""


@dataclass(frozen=True)
class Odds:
    """How surely an experiment decides.

    Attributes:
        right: probability that the right rival is named. wrong: that another one is.
        draws: how many recordings that is counted in.
        by_rival: cause -> probability that it is named where it is the right one.
    """

    right: float
    wrong: float
    draws: int
    by_rival: dict[str, float]

    @property
    def worth(self) -> float:
        """What an experiment is worth: a wrong name costs as much as five right ones."""
        return self.right - 5.0 * self.wrong


@dataclass(frozen=True)
class DrawRows:
    """Which rows of the inner products are what: slopes, draws and noise.

    Attributes:
        sizes: number of fitted parameters of each rival. draws: z of each rival's draws, (k, p),
            the first of them zero: the fitted values themselves. causes: of each rival.
        behind: by how much each lies behind the first in the recordings so far, squares of a
            standard deviation of the noise.
    """

    sizes: tuple[int, ...]
    draws: tuple[FloatArray, ...]
    causes: tuple[str, ...]
    behind: tuple[float, ...]

    def lead(self, other: int, truth: int) -> float:
        """Return by how much another rival is ahead of one in the recordings so far, or 0."""
        return max(self.behind[truth] - self.behind[other], 0.0)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Rivals of unlike causes, two at a time."""
        return [
            (r, q)
            for r, q in combinations(range(len(self.sizes)), 2)
            if self.causes[r] != self.causes[q]
        ]

    @property
    def points(self) -> tuple[FloatArray, ...]:
        """What has to be simulated of each rival: draws, then both ends of each slope."""
        return tuple(
            np.concatenate([z, _HALF * np.eye(p), -_HALF * np.eye(p)])
            for z, p in zip(self.draws, self.sizes, strict=True)
        )

    def rows(self) -> tuple[list[slice], list[slice], slice]:
        """Return the rows of each rival's draws, of its slopes, and of the noise."""
        at = 0
        outputs, slopes = [], []
        for z in self.draws:
            outputs.append(slice(at, at + len(z)))
            at += len(z)
        for p in self.sizes:
            slopes.append(slice(at, at + p))
            at += p
        return outputs, slopes, slice(at, at + NOISES)


def layout_of(
    rivals: Sequence[Hypothesis], draws: int, rng: np.random.Generator | None = None
) -> DrawRows:
    """Return a layout with the fitted values and so many draws of each posterior."""
    sizes = tuple(len(rival.keys) for rival in rivals)
    found = []
    for p in sizes:
        z = np.zeros((draws + 1, p))
        if rng is not None and draws:
            z[1:] = rng.standard_normal((draws, p))
        found.append(z)
    behind = tuple(rival.behind if math.isfinite(rival.behind) else 0.0 for rival in rivals)
    return DrawRows(sizes, tuple(found), tuple(rival.cause for rival in rivals), behind)


def inner_products(
    layout: DrawRows,
    simulated: Sequence[FloatArray],
    outputs: Sequence[str],
    bench: Bench,
    ticks: Sequence[int],
    seed: Sequence[int],
) -> FloatArray:
    """Return inner products of everything up to each of some ticks, (ticks, rows, rows).

    Args:
        layout: of the rows. simulated: (m, n, outputs) of each rival at `layout.points`, SI.
        outputs: of the plant, in order. bench: sensors. ticks: increasing. seed: of the noise.
    """
    columns = [list(outputs).index(name) for name in bench.channels]
    scaled = [item[:, :, columns] / bench.noise for item in simulated]
    origin = scaled[0][0]
    rows = [item[: len(z)] - origin for item, z in zip(scaled, layout.draws, strict=True)]
    for item, z, p in zip(scaled, layout.draws, layout.sizes, strict=True):
        up, down = item[len(z) : len(z) + p], item[len(z) + p :]
        rows.append((up - down) / (2.0 * _HALF))
    noise = np.random.default_rng(seed).standard_normal((NOISES, *origin.shape))
    stacked = np.concatenate([*rows, noise])
    out = np.zeros((len(ticks), len(stacked), len(stacked)))
    before, total = 0, np.zeros((len(stacked), len(stacked)))
    for number, tick in enumerate(ticks):
        part = stacked[:, before:tick].reshape(len(stacked), -1)
        total = total + part @ part.T
        out[number] = total
        before = tick
    return out


def distances(layout: DrawRows, gram: FloatArray) -> FloatArray:
    """Return the distance of each pair of unlike causes, (pairs,), from inner products."""
    outputs, slopes, _ = layout.rows()
    found = []
    for r, q in layout.pairs:
        a, b = outputs[r].start, outputs[q].start
        both = np.r_[slopes[r], slopes[q]]
        square = gram[a, a] - 2.0 * gram[a, b] + gram[b, b]
        along = gram[both, a] - gram[both, b]
        inner = np.eye(both.size) + gram[np.ix_(both, both)]
        found.append(square - along @ np.linalg.solve(inner, along))
    return np.maximum(np.array(found, dtype=np.float64), 0.0)


def shares_of_a_decision(layout: DrawRows, grams: FloatArray) -> FloatArray:
    """Return, for each number of blocks, what they give of what a decision needs, (blocks,).

    The gain of the right rival over another is about normal in each block, with the mean d of the
    block's distance and the variance 4 d. It has to be large, and spread over blocks.

    Args:
        layout: of the rows. grams: inner products up to the end of each block.
    """
    reached = np.array([distances(layout, gram) for gram in grams])
    leads = np.array([max(layout.lead(r, q), layout.lead(q, r)) for r, q in layout.pairs])
    enough = (reached / (_SUFFICES + leads)).min(axis=1)
    return np.asarray(np.minimum(enough, _deviations(reached) ** 2 / _SPREAD**2))


def is_spread(layout: DrawRows, grams: FloatArray) -> BoolArray:
    """Return after which of so many blocks the gain comes from many of them, (blocks,).

    A diagnosis believes a likelihood ratio at the noise only. A machine has other forms than any
    rival, which show where it was not recorded before; blocks are resampled then, and a gain in a
    few of them counts for nothing.

    Args:
        layout: of the rows. grams: inner products up to the end of each block.
    """
    return _deviations(np.array([distances(layout, gram) for gram in grams])) >= _SPREAD


def _deviations(reached: FloatArray) -> FloatArray:
    """Return the expected gain in standard deviations of a sum of resampled blocks, (blocks,).

    Args:
        reached: distance of each pair after each block, (blocks, pairs). The least one counts.
    """
    parts = np.maximum(np.diff(reached, axis=0, prepend=0.0), 0.0)
    spread = np.sqrt(np.cumsum(parts**2 + 4.0 * parts, axis=0))
    return np.asarray((np.cumsum(parts, axis=0) / np.maximum(spread, 1e-300)).min(axis=1))


def posterior_after(
    rival: Hypothesis, layout: DrawRows, gram: FloatArray, which: int
) -> FloatArray:
    """Return a rival's covariance after the experiment, (p, p) SI."""
    own = layout.rows()[1][which]
    inner = np.eye(layout.sizes[which]) + gram[own, own]
    return np.asarray(rival.root @ np.linalg.solve(inner, rival.root.T))


def least_costs(layout: DrawRows, gram: FloatArray, rival: int) -> FloatArray:
    """Return the least cost of a refit of one rival to what each draw of every rival records.

    Shape (draws of all rivals, NOISES). What is common to all rivals (the noise's own square) is in
    it. With L L' = I + J'J the cost from a centre c is |y_d + e_m - y_c|^2 + |z_c|^2 -
    |L^-1 (J'(y_d + e_m - y_c) - z_c)|^2: all of it inner products of what d, m and c bring.
    """
    outputs, slopes, noise = layout.rows()
    own, z = outputs[rival], layout.draws[rival]
    rows = np.concatenate([gram[: outputs[-1].stop, slopes[rival]], gram[noise, slopes[rival]],
                           gram[own, slopes[rival]] + z])  # fmt: skip
    inner = np.eye(z.shape[1]) + gram[slopes[rival], slopes[rival]]
    taken = np.linalg.solve(np.linalg.cholesky(inner), rows.T)
    places = np.r_[0 : outputs[-1].stop, noise, own]
    left = gram[np.ix_(places, places)] - taken.T @ taken
    d = slice(0, outputs[-1].stop)
    m = slice(d.stop, d.stop + NOISES)
    c = slice(m.stop, len(places))
    square = np.diag(left)
    costs = (
        square[d][:, None, None] + square[m][None, :, None]
        + (square[c] + np.sum(z * z, axis=1))[None, None, :]
        + 2.0 * left[d, m][:, :, None] - 2.0 * left[d, c][:, None, :]
        - 2.0 * left[m, c][None, :, :]
    )  # fmt: skip
    if len(z) > 1:
        # a refit does not begin at the truth: the other rivals have no such centre either
        itself = np.arange(len(z))
        costs[own.start + itself, :, itself] = np.inf
    return np.asarray(costs.min(axis=2))


def odds(layout: DrawRows, grams: FloatArray) -> tuple[Odds, ...]:
    """Return how surely a diagnosis will name the right rival, after each block.

    Args:
        layout: of the rows.
        grams: inner products up to the end of each block, (blocks, rows, rows).
    """
    count, blocks = len(layout.sizes), len(grams)
    causes = list(dict.fromkeys(layout.causes))
    of_cause = np.array([causes.index(cause) for cause in layout.causes])
    right, wrong = np.zeros((blocks, count)), np.zeros((blocks, count))
    draws = 0
    every = np.array([[least_costs(layout, gram, q) for q in range(count)] for gram in grams])
    for truth, rows in enumerate(layout.rows()[0]):
        costs = every[:, :, rows]
        costs = costs[:, :, 1:] if len(layout.draws[truth]) > 1 else costs
        leads = np.array([layout.lead(other, truth) for other in range(count)])
        costs = costs - leads[None, :, None, None]
        costs = costs.reshape(blocks, count, -1)
        best = costs.argmin(axis=1)
        gains = costs - costs.min(axis=1, keepdims=True)
        # forms of one cause need not be distinguished
        alike = of_cause[None, :, None] == of_cause[best][:, None, :]
        named = ((gains >= DISTINGUISHED) | alike).all(axis=1)
        is_right = of_cause[best] == of_cause[truth]
        right[:, truth] = np.mean(named & is_right, axis=1)
        wrong[:, truth] = np.mean(named & ~is_right, axis=1)
        draws += best.shape[1]
    # every cause counts alike, however many forms it has
    share = np.array([[float(own == k) for own in of_cause] for k in range(len(causes))])
    share /= share.sum(axis=1, keepdims=True)
    by_cause, wrong_by_cause = right @ share.T, wrong @ share.T
    return tuple(
        Odds(
            float(by_cause[k].mean()),
            float(wrong_by_cause[k].mean()),
            draws,
            {cause: float(by_cause[k, number]) for number, cause in enumerate(causes)},
        )
        for k in range(blocks)
    )
