"""How much of a residual is more than noise, and what a candidate would explain of it.

The *excess* is the cost above what noise alone makes. A candidate's *share* is the part of the
excess that its refit takes away, on the data fitted and, by leaving each run out in turn, on data
that was not: a share is hard to reach by accident, where a likelihood ratio is not, since with
100,000 correlated samples every wrong term gains something. Leaving a run out is done to first
order from the Jacobian at the optimum (one Gauss-Newton step without its rows), which costs no
simulation.

Significance is by resampling blocks of 0.1 s, which keeps the serial correlation (Künsch, Ann.
Statist. 17 (1989) 1217, doi:10.1214/aos/1176347265).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.noise import noise_of, noise_of_step
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.oscillation import oscillation
from eha_bench.diagnosis.fit.problem import Problem, soften


def _soft_mean() -> float:
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    soft, _ = soften(nodes)
    return float(weights @ soft**2 / weights.sum())


_COUNTED = 0.01
"""Least probability that is read off counted draws."""
_OUTLYING = 5.0
"""Robust standard deviations of blocks' gains beyond which one is an outlier."""
_FEW = 0.02
"""Most blocks, as a share, that may lose more than that and be accidents."""
_CONCERNED = 0.03
FURTHEST = 8.0
"""Size of a residual beyond which it counts as one of that size, in the noise."""
_FEW_READINGS = 60
"""Readings of a stretch that do not tell its noise."""
_QUIETER = 0.5
"""Root mean square of a channel's residual, in its noise, from which that was taken too large."""
_GAP = np.array([np.nan])
SOFT_MEAN = _soft_mean()
"""Mean soft-L1 cost of one residual that is standard normal noise."""


def refined_noise(
    problem: Problem, residual: FloatArray, noise: Mapping[str, float]
) -> dict[str, float]:
    """Return the noise of each channel, estimated from a residual instead of the raw signal.

    What is smooth in the signal but not over four samples is mostly gone from the residual. Noise
    is no louder than what is left of a channel: one that is read slowly, and jumps, looks louder.
    """
    names = problem.plant.outputs
    most = _rms_by_channel(problem, residual)
    short = _read_in_short_windows(problem, residual)
    steps = _steps(problem)
    found: dict[int, list[tuple[float, int]]] = {}
    for channel, measured, part in _stretches(problem, residual):
        name = names[channel]
        colour = measured.colours.get(name)
        level = noise_of(part, steps.get(name, 0.0) / noise[name])
        level /= colour.sharpness if colour else 1.0
        size = int(np.isfinite(part).sum())
        if np.isfinite(level) and size > _FEW_READINGS:
            found.setdefault(channel, []).append((level, size))
    out = dict(noise)
    for channel, items in found.items():
        levels = np.array([item[0] for item in items])
        sizes = np.array([item[1] for item in items], dtype=np.float64)
        order = np.argsort(levels)
        cumulative = np.cumsum(sizes[order]) / sizes.sum()
        middle = float(levels[order][np.searchsorted(cumulative, 0.5)])
        least, greatest = 0.5, 2.0  # beyond these something else than noise is at work
        if most[channel] < _QUIETER:
            least, greatest = 0.0, 1.0
        elif channel in short:
            least = greatest = 1.0
        level = noise[names[channel]] * float(np.clip(middle, least, greatest))
        out[names[channel]] = max(level, noise_of_step(steps.get(names[channel], 0.0)))
    return out


def _read_in_short_windows(problem: Problem, residual: FloatArray) -> set[int]:
    """Return channels, by number, of which no window has readings enough to tell their noise.

    Where inputs were measured a run is cut on purpose, and its windows tell it together.
    """
    longest: dict[int, int] = {}
    for window, channel, part in _by_channel(problem, residual):
        cut = bool(problem.windows[window].measured.input_noise)
        size = _FEW_READINGS + 1 if cut else part.size
        longest[channel] = max(longest.get(channel, 0), size)
    return {channel for channel, size in longest.items() if size <= _FEW_READINGS}


def _rms_by_channel(problem: Problem, residual: FloatArray) -> dict[int, float]:
    """Return what is left of each channel, by its number, in its noise."""
    squares: dict[int, list[FloatArray]] = {}
    for _, channel, part in _by_channel(problem, residual):
        squares.setdefault(channel, []).append(part[np.isfinite(part)] ** 2)
    return {
        channel: float(np.sqrt(np.mean(np.concatenate(own)))) for channel, own in squares.items()
    }


def _steps(problem: Problem) -> dict[str, float]:
    """Return each channel's step of resolution, SI: the usual one of its runs."""
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    steps: dict[str, list[float]] = {}
    for item in runs.values():
        for name, step in item.steps.items():
            steps.setdefault(name, []).append(step)
    return {name: float(np.median(own)) for name, own in steps.items()}


def _stretches(
    problem: Problem, residual: FloatArray
) -> Iterator[tuple[int, Measured, FloatArray]]:
    """Yield channels with their residual in each window, or in a run that is cut into short ones.

    Between the windows of a run stands NaN: they hang together no more than across a gap.
    """
    cut: dict[tuple[str, int], list[FloatArray]] = {}
    runs: dict[str, Measured] = {}
    for window, channel, part in _by_channel(problem, residual):
        measured = problem.windows[window].measured
        runs[measured.run.name] = measured
        if measured.input_noise or part.size <= _FEW_READINGS:
            cut.setdefault((measured.run.name, channel), []).extend((part, _GAP))
        else:
            yield channel, measured, part
    for (name, channel), parts in cut.items():
        yield channel, runs[name], np.concatenate(parts)


def _by_channel(problem: Problem, residual: FloatArray) -> Iterator[tuple[int, int, FloatArray]]:
    """Yield windows and channels, by number, with their part of a stacked residual."""
    for piece in problem.pieces:
        rows = residual[piece.rows]
        for channel, mask in piece.by_channel():
            yield piece.window, channel, rows[mask]


@dataclass(frozen=True)
class Excess:
    """What a residual holds beyond noise.

    Attributes:
        total: cost above the noise's.
        size: number of residuals.
        significance: in standard deviations, of the most structured block length, or of a channel
            that swings.
        by_channel: channel -> mean square.
        bursts: correlation of neighbouring squares, in standard deviations of none, of the channel
            where it is largest (Engle's test: Econometrica 50 (1982) 987, doi:10.2307/1912773).
        against_beliefs: cost of parameters that are away from what is believed of them.
    """

    total: float
    size: int
    significance: float
    by_channel: Mapping[str, float]
    bursts: float = 0.0
    against_beliefs: float = 0.0

    @property
    def relative(self) -> float:
        """Excess as a share of the noise's cost."""
        return self.total / (SOFT_MEAN * self.size)


def excess(problem: Problem, fit: Fit) -> Excess:
    """Return what the residual of a fit holds beyond noise."""
    white = 1.0
    significance = -np.inf
    parts = [(channel, part) for _, channel, part in _by_channel(problem, fit.residual)]
    clipped = [np.clip(part, -FURTHEST, FURTHEST) for _, part in parts]
    for length in (1, 8, 32, 128):
        total, count = 0.0, 0
        for part in clipped:
            blocks = part.size // length
            if blocks:
                means = part[: blocks * length].reshape(blocks, length).mean(axis=1)
                total += float(np.sum(means**2)) * length
                count += blocks
        if count > len(fit.free) + 4:
            value = total / (count - len(fit.free))
            if length == 1:
                # what is white only tells a wrong estimate of the noise
                white = max(1.0, value)
            else:
                above = value / white - 1.0
                significance = max(significance, above * np.sqrt(count / 2.0))
    bursts = 0.0
    for channel in dict.fromkeys(channel for channel, _ in parts):
        own = [part for (at, _), part in zip(parts, clipped, strict=True) if at == channel]
        significance = max(significance, oscillation(own))
        bursts = max(bursts, _bursts(own))
    names = problem.plant.outputs
    sums: dict[str, list[float]] = {}
    for channel, part in parts:
        sums.setdefault(names[channel], []).append(float(np.mean(part**2)))
    floor = SOFT_MEAN * (problem.size - len(fit.free))
    return Excess(
        fit.cost - floor,
        problem.size,
        float(significance),
        {name: float(np.mean(values)) for name, values in sums.items()},
        bursts,
        against_beliefs(fit),
    )


def against_beliefs(fit: Fit) -> float:
    """Return the cost of parameters that are away from what is believed of them."""
    beliefs, _ = soften(fit.residual[fit.residual.size - fit.beliefs :], fit.soft)
    return float(beliefs @ beliefs)


def _bursts(parts: list[FloatArray]) -> float:
    """Return the correlation of neighbouring squares in standard deviations of none."""
    squares = [part**2 for part in parts]
    first = np.concatenate([part[:-1] for part in squares])
    second = np.concatenate([part[1:] for part in squares])
    both = np.isfinite(first) & np.isfinite(second)
    first, second = first[both], second[both]
    if first.size < 3 or not (first.std() > 0.0 and second.std() > 0.0):
        return 0.0
    return float(np.corrcoef(first, second)[0, 1] * np.sqrt(first.size))


@dataclass(frozen=True)
class Groups:
    """Rows of a residual by run, to be left out in turn, and by block, to be resampled."""

    runs: tuple[IndexArray, ...]
    blocks: tuple[IndexArray, ...]


def groups_of(problem: Problem, block: float = 0.1, most: int = 8) -> Groups:
    """Return the rows of each run (of parts of runs where there are few) and of each block.

    Args:
        problem: residuals.
        block: length of a block, s.
        most: runs are split into parts until there are at least four groups.
    """
    by_run: dict[str, list[tuple[IndexArray, FloatArray]]] = {}
    blocks: list[IndexArray] = []
    for piece in problem.pieces:
        window = problem.windows[piece.window]
        rows = np.arange(piece.rows.start, piece.rows.stop)
        time = window.measured.time[window.first + piece.ticks]
        by_run.setdefault(window.measured.run.name, []).append((rows, time))
        number = np.floor(time / block).astype(np.int64)
        order = np.flatnonzero(np.diff(number)) + 1
        blocks += [part for part in np.split(rows, order) if part.size]
    parts = 1 if len(by_run) >= 4 else int(np.ceil(min(most, 6) / len(by_run)))
    runs: list[IndexArray] = []
    for items in by_run.values():
        rows = np.concatenate([item[0] for item in items])
        time = np.concatenate([item[1] for item in items])
        edges = np.quantile(time, np.linspace(0.0, 1.0, parts + 1)[1:-1])
        label = np.searchsorted(edges, time)
        runs += [rows[label == k] for k in range(parts) if (label == k).any()]
    return Groups(tuple(runs), tuple(blocks))


def left_out(fit: Fit, groups: Groups) -> FloatArray:
    """Return the soft cost of every residual when its run was left out of the fit, (N,)."""
    soft, weight = soften(fit.residual, fit.soft)
    costs = soft**2
    if not fit.free:
        return costs
    weighted = fit.jacobian * weight[:, None]
    normal = weighted.T @ weighted
    gradient = weighted.T @ soft
    out = costs.copy()
    # what a left-out run alone determines stays near where it was
    ridge = 0.02 * np.diag(np.diag(normal))
    for rows in groups.runs:
        part = weighted[rows]
        left = normal - part.T @ part + ridge
        step = -np.linalg.lstsq(left, gradient - part.T @ soft[rows], rcond=1e-10)[0]
        # beyond the range of the linearisation nothing is learnt from a larger step
        step = np.clip(step, -0.5, 0.5)
        moved, _ = soften(fit.residual[rows] + fit.jacobian[rows] @ step, fit.soft)
        out[rows] = moved**2
    return out


@dataclass(frozen=True)
class Improvement:
    """What a candidate gains over the fit without it.

    Attributes:
        gain: fall of the cost on the data fitted.
        gain_out: fall of the cost on runs left out in turn.
        share, share_out: both over the excess before on the data fitted; what the fit without a
            cause bends to costs more on runs left out, so share_out may well be above 1.
        p_value: of gain_out <= 0, by resampling blocks: as of a normal sum, or as counted, where
            that is less and above 0.01; or of most blocks' gain, where few lose what these gain.
        runs_better: share of the runs (by count) that gain when left out, of those it changes.
        explained_out: gain_out as a part of the excess before on the same runs left out, at most 1.
        of_noise: the lesser gain over the noise's cost of all readings.
    """

    gain: float
    gain_out: float
    share: float
    share_out: float
    p_value: float
    runs_better: float
    explained_out: float
    of_noise: float = 0.0


NOT_COMPARED = Improvement(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
"""What stands where nothing has been compared yet: no gain."""


def _bootstrap_p(gain: float, sums: FloatArray, seed: int) -> float:
    """Return the probability that a gain is none, by resampling what blocks gain of it, (n,)."""
    generator = np.random.default_rng(seed)
    draws = generator.integers(0, sums.size, size=(1000, sums.size))
    totals = sums[draws].sum(axis=1)
    spread = float(totals.std()) or 1e-300
    # what acts in few blocks makes sums that are far from normal, and never a loss
    counted = max(_COUNTED, float(np.mean(totals <= 0.0)))
    return min(float(ndtr(-gain / spread)), counted)


def _winsorised_p(gain: float, sums: FloatArray) -> float:
    """Return the probability that most blocks gain nothing, where few lose what they gain; else 1.

    Where a valve opens, or a rod breaks loose, a little sooner, one block may lose more than a
    hundred others gain, whatever causes it. Gains and losses are winsorised at `_OUTLYING` robust
    standard deviations (Huber, Ronchetti, Robust Statistics, 2nd ed. 2009, section 1.5). Where that
    takes from the gain, it was made by few blocks: these are counted as they are. Where more than
    `_FEW` of the blocks lose so much, they are no accidents.
    """
    typical = float(np.median(np.abs(sums))) / 0.6745
    held = np.clip(sums, -_OUTLYING * typical, _OUTLYING * typical)
    more, spread = float(held.sum() - sums.sum()), float(held.std()) * np.sqrt(sums.size)
    few = float(np.mean(sums < held)) <= _FEW
    if not (few and more > 0.0 and gain > 0.0 and spread > 0.0):
        return 1.0
    return float(ndtr(-(gain + more) / spread))


def compare(
    before: Fit, after: Fit, groups: Groups, excess_before: float, seed: int = 0
) -> Improvement:
    """Return what `after` gains over `before`, fitted and left out."""
    soft_b, _ = soften(before.residual, before.soft)
    soft_a, _ = soften(after.residual, after.soft)
    gain = float(soft_b @ soft_b - soft_a @ soft_a)
    out_before = left_out(before, groups)
    difference = out_before - left_out(after, groups)
    gain_out = float(difference.sum())
    sums = np.array([float(difference[rows].sum()) for rows in groups.blocks])
    p_value = min(_bootstrap_p(gain_out, sums, seed), _winsorised_p(gain_out, sums))
    per_run = np.array([float(difference[rows].sum()) for rows in groups.runs])
    # beliefs are of no run: each has its part of what they gain
    per_run += (gain_out - per_run.sum()) / max(per_run.size, 1)
    # where there is hardly any excess, shares of it mean nothing
    scale = max(excess_before, gain, 1.0)
    # runs in which a candidate does nothing have no say: a load does not act on a locked piston
    concerned = per_run[np.abs(per_run) > _CONCERNED * np.abs(per_run).max(initial=0.0)]
    better = float(np.mean(concerned > 0)) if concerned.size else 0.0
    floor = SOFT_MEAN * (before.residual.size - len(before.free))
    scale_out = max(float(out_before.sum()) - floor, gain_out, 1.0)
    return Improvement(
        gain,
        gain_out,
        gain / scale,
        gain_out / scale,
        p_value,
        better,
        gain_out / scale_out,
        min(gain, gain_out) / (SOFT_MEAN * max(before.residual.size, 1)),
    )
