"""Sensors' noise where nothing ever stands still: its level and colour, from what a model leaves.

A loop that is closed on noisy sensors moves all the time, so no stretch of its log shows noise
alone. What a fitted model leaves of a short stretch, less a parabola, does: what the model lacks is
slower, or stands in separate stretches, so only those that are as quiet as noise count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.special import chdtri

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour, beside_parabola, colour_of
from eha_bench.diagnosis.data.quiet import quiet_stretches, shows_noise
from eha_bench.diagnosis.fit.problem import Problem

_SHORTEST, _LONGEST = 64, 128
"""Samples of a stretch, at least and at most. Beside its parabola a short one says nothing of
slow noise, and a filter's noise is then taken as too quiet there."""
_STRETCH = 0.128
"""And its length between these, s."""
_FREQUENCIES = 64
"""Frequencies at which a spectrum is looked at."""
_QUIET = 0.5
"""Share of the stretches that a first colour is taken from, the quietest ones."""
_ALL = 0.99
"""Share of the stretches of noise alone that the colour is then taken from: choosing the quietest
ones alone would lose noise that is slow."""
_MOST = 4.0
"""Largest level over that of third differences, which hold a quarter of what passes a first-order
filter with a correlation of 0.9: above that it is the model that is wrong, not the sensor."""
_ROUNDS = 4
"""How often colour and stretches are taken from one another."""
_LOW = 0.25
"""Quantile of the stretches' mean squares that a level is taken from."""
_PEAK = 2.0
"""Power at a peak, in that of slow and of fast noise, from which noise swings."""
_FLOOR = 0.1
"""White noise, in all of a noise's power, beside which its spectrum is looked at."""
_MEMORY = 8
"""Samples by whose correlations that is."""
_SAME = 0.25
"""What the mean squares of runs may differ by, as a share, and still be of the same noise."""
_NOT_BY_CHANCE = 4.0
"""And by how many standard errors."""
_FEWEST = 4
"""Least number of a run's stretches that say how loud its noise is."""
_MOST_SAMPLES = 0.5
"""Share of the samples that is most of them."""


@dataclass(frozen=True)
class SeenNoise:
    """What a residual says of sensors' noise.

    Attributes:
        colours: channel -> colour of its noise, where that is not white.
        levels: channel -> standard deviation of all of its noise, resolution included, SI.
    """

    colours: Mapping[str, Colour]
    levels: dict[str, float]


NOTHING_SEEN = SeenNoise({}, {})
"""The note where some run shows its sensors' noise alone."""


def noise_of_residual(problem: Problem, vector: FloatArray) -> SeenNoise:
    """Return the noise of every channel whose residual is no more than noise in short stretches.

    Args:
        problem: the runs' windows. vector: of the fitted model.
    """
    return _seen_noise(problem, _stretches(problem, vector))


def _seen_noise(
    problem: Problem, stretches: Mapping[str, Mapping[str, list[FloatArray]]]
) -> SeenNoise:
    colours, levels = {}, {}
    for name, by_run in stretches.items():
        level, colour = noise_of_stretches([own for run in by_run.values() for own in run])
        if level > _MOST * problem.noise[name]:
            continue
        levels[name] = level
        if colour is not None:
            colours[name] = colour
    return SeenNoise(colours, levels)


def steady_noise_of_residual(problem: Problem, vector: FloatArray) -> SeenNoise:
    """Return the noise of the channels whose residual is a sensor's noise and nothing else.

    A sensor is as noisy in every run, and at rest, and its noise does not swing; what a model lacks
    follows what a run asks for. Where most samples are of runs that hardly have an unbroken
    stretch (losses at a low rate), nothing shows that; a resolution alone is quieter at rest.

    Args:
        problem: the runs' windows. vector: of the fitted model.
    """
    stretches = _stretches(problem, vector)
    seen = _seen_noise(problem, stretches)
    at_rest = _at_rest(problem)
    samples = _samples(problem)
    steady = {
        name
        for name in seen.levels
        if share_shown(stretches[name], samples[name]) > _MOST_SAMPLES
        and not swings(seen.colours.get(name))
        and same_noise([*stretches[name].values(), at_rest.get(name, [])], seen.colours.get(name))
    }
    return SeenNoise(
        {name: colour for name, colour in seen.colours.items() if name in steady},
        {name: level for name, level in seen.levels.items() if name in steady},
    )


def _samples(problem: Problem) -> dict[str, dict[str, int]]:
    """Return how many samples of each channel a fit has, by run."""
    names = problem.plant.outputs
    found: dict[str, dict[str, int]] = {}
    for piece in problem.pieces:
        run = problem.windows[piece.window].measured.run.name
        for channel, mask in piece.by_channel():
            by_run = found.setdefault(names[channel], {})
            by_run[run] = by_run.get(run, 0) + int(np.count_nonzero(mask))
    return found


def share_shown(stretches: Mapping[str, Sequence[FloatArray]], samples: Mapping[str, int]) -> float:
    """Return the share of the samples that is of runs with stretches enough to tell their noise."""
    covered = sum(samples[run] for run, own in stretches.items() if len(own) >= _FEWEST)
    return covered / sum(samples.values())


def swings(colour: Colour | None) -> bool:
    """Whether noise is loudest at one frequency, as a resonance is and a filter is not."""
    if colour is None:
        return False
    # without a floor, the zero that a filter has at half the sampling rate makes ripples elsewhere
    correlations = colour.correlations(_MEMORY + 1)
    correlations[0] += _FLOOR
    factors = solve_toeplitz(correlations[:-1], correlations[1:])
    turns = np.outer(np.pi * np.arange(_FREQUENCIES) / _FREQUENCIES, np.arange(1, _MEMORY + 1))
    power = np.abs(1.0 - np.exp(-1j * turns) @ factors) ** -2.0
    return bool(power[1:-1].max() > _PEAK * max(power[0], power[-1]))


def same_noise(runs: Sequence[Sequence[FloatArray]], colour: Colour | None) -> bool:
    """Whether stretches of all runs are as loud, but for chance.

    By the median of their mean squares: a few stretches in which a run holds more do not count.

    Args:
        runs: of each its stretches, (n,) each. colour: of the noise, None where it is white.
    """
    squares = [_mean_squares(run) for run in runs if len(run) >= _FEWEST]
    if len(squares) < 2:
        return True
    length = next(own for run in runs for own in run).size
    _, freedom = _expected_square(colour, length)
    usual = float(np.median(np.concatenate(squares)))
    for own in squares:
        # of a median: pi / 2 times the variance of a mean
        error = float(np.sqrt(np.pi / freedom / own.size))
        off = abs(float(np.median(own)) / usual - 1.0)
        if off > max(_SAME, _NOT_BY_CHANCE * error):
            return False
    return True


def noise_of_stretches(stretches: Sequence[FloatArray]) -> tuple[float, Colour | None]:
    """Return the standard deviation of noise, in the stretches' unit, and its colour if not white.

    The level is that of the quietest quarter, made up for having been chosen: of noise alone the
    mean squares of stretches are scattered as chi-square, whose quartile is known.

    Args:
        stretches: of as many samples each; some may hold more than noise.
    """
    squares = _mean_squares(stretches)
    kept = squares <= np.quantile(squares, _QUIET)
    for _ in range(_ROUNDS):
        colour = colour_of([own for own, keep in zip(stretches, kept, strict=True) if keep])
        usual, freedom = _expected_square(colour, stretches[0].size)
        quartile = float(np.quantile(squares, _LOW))
        variance = quartile / (usual * float(chdtri(freedom, 1.0 - _LOW)) / freedom)
        kept = squares <= variance * usual * float(chdtri(freedom, 1.0 - _ALL)) / freedom
    return float(np.sqrt(variance)), colour


def _stretches(problem: Problem, vector: FloatArray) -> dict[str, dict[str, list[FloatArray]]]:
    """Return what is left of each channel, by run, in stretches of neighbouring samples, SI."""
    problem.prepare(vector)
    residual = problem.with_best_start(vector)
    length = _length_of_stretches(problem)
    found: dict[str, dict[str, list[FloatArray]]] = {}
    names = problem.plant.outputs
    for piece in problem.pieces:
        rows = residual[piece.rows]
        run = problem.windows[piece.window].measured.run.name
        for channel, mask in piece.by_channel():
            own, ticks = rows[mask] * problem.noise[names[channel]], piece.ticks[mask]
            for first in range(0, own.size - length + 1, length):
                span = slice(first, first + length)
                if ticks[span][-1] - ticks[span][0] == length - 1:
                    by_run = found.setdefault(names[channel], {})
                    by_run.setdefault(run, []).append(own[span])
    return found


def _length_of_stretches(problem: Problem) -> int:
    """Return how many samples a stretch has."""
    tick = float(np.median([window.measured.tick for window in problem.windows]))
    return int(np.clip(round(_STRETCH / tick), _SHORTEST, _LONGEST))


def _at_rest(problem: Problem) -> dict[str, list[FloatArray]]:
    """Return the readings of each channel while nothing moves, where they show its noise."""
    found: dict[str, list[FloatArray]] = {}
    length = _length_of_stretches(problem)
    runs = {item.measured.run.name: item.measured for item in problem.windows}
    for measured in runs.values():
        for stretch in quiet_stretches(measured):
            for name, values in stretch.items():
                if shows_noise(values, measured.steps.get(name, 0.0)):
                    found.setdefault(name, []).extend(
                        values[first : first + length]
                        for first in range(0, values.size - length + 1, length)
                    )
    return found


def _mean_squares(stretches: Sequence[FloatArray]) -> FloatArray:
    """Return how loud each stretch is about its parabola, (n,)."""
    return np.array([float(np.mean(beside_parabola(own) ** 2)) for own in stretches])


def _expected_square(colour: Colour | None, length: int) -> tuple[float, float]:
    """Return the mean square of a stretch about its parabola, for noise of 1, and its freedom.

    Without a colour the noise is white.

    A quadratic form x'Ax of normal x has the mean tr(AR) and the variance 2 tr(ARAR); chi-square
    of as many degrees has the same ratio of both (Satterthwaite, Biometrics Bull. 2 (1946) 110).
    """
    beside = np.stack([beside_parabola(unit) for unit in np.eye(length)])
    white = np.eye(length)[0]
    form = beside @ toeplitz(white if colour is None else colour.correlations(length))
    mean = float(np.trace(form))
    return mean / length, mean**2 / float(np.sum(form * form.T))
