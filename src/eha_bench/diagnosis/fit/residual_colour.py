"""Sensors' noise where nothing ever stands still: its level and colour, from what a model leaves.

A loop that is closed on noisy sensors moves all the time, so no stretch of its log shows noise
alone. What a fitted model leaves of a short stretch, less a parabola, does: what the model lacks is
slow beside it, or stands in stretches of its own, so only those that are as quiet as noise count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.stats import chi2

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour, beside_parabola, colour_of
from eha_bench.diagnosis.fit.problem import Problem

_STRETCH = 64
"""Samples of a stretch."""
_QUIET = 0.5
"""Share of the stretches that a first colour is taken from, the quietest ones."""
_ALL = 0.99
"""Share of the stretches of noise alone that the colour is then taken from: choosing the quietest
ones alone would lose noise that is slow."""
_MOST = 4.0
"""Largest level beside that of third differences, which hold a quarter of what passes a first-order
filter with a correlation of 0.9: above that it is the model that is wrong, not the sensor."""
_ROUNDS = 4
"""How often colour and stretches are taken from one another."""
_LOW = 0.25
"""Quantile of the stretches' mean squares that a level is taken from."""


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
    colours, levels = {}, {}
    for name, stretches in _stretches(problem, vector).items():
        level, colour = noise_of_stretches(stretches)
        if level > _MOST * problem.noise[name]:
            continue
        levels[name] = level
        if colour is not None:
            colours[name] = colour
    return SeenNoise(colours, levels)


def noise_of_stretches(stretches: Sequence[FloatArray]) -> tuple[float, Colour | None]:
    """Return the standard deviation of noise, in the stretches' unit, and its colour if not white.

    The level is that of the quietest quarter, made up for having been chosen: of noise alone the
    mean squares of stretches are scattered as chi-square, whose quartile is known.

    Args:
        stretches: of 64 samples each; some may hold more than noise.
    """
    squares = np.array([float(np.mean(beside_parabola(own) ** 2)) for own in stretches])
    kept = squares <= np.quantile(squares, _QUIET)
    for _ in range(_ROUNDS):
        colour = colour_of([own for own, keep in zip(stretches, kept, strict=True) if keep])
        usual, freedom = _expected(colour)
        quartile = float(np.quantile(squares, _LOW))
        variance = quartile / (usual * float(chi2.ppf(_LOW, freedom)) / freedom)
        kept = squares <= variance * usual * float(chi2.ppf(_ALL, freedom)) / freedom
    return float(np.sqrt(variance)), colour


def _stretches(problem: Problem, vector: FloatArray) -> dict[str, list[FloatArray]]:
    """Return what is left of each channel in stretches of samples that follow one another, SI."""
    problem.prepare(vector)
    residual = problem.with_best_start(vector)
    found: dict[str, list[FloatArray]] = {}
    names = problem.plant.outputs
    for piece in problem.pieces:
        rows = residual[piece.rows]
        for channel, mask in piece.by_channel():
            own, ticks = rows[mask] * problem.noise[names[channel]], piece.ticks[mask]
            for first in range(0, own.size - _STRETCH + 1, _STRETCH):
                span = slice(first, first + _STRETCH)
                if ticks[span][-1] - ticks[span][0] == _STRETCH - 1:
                    found.setdefault(names[channel], []).append(own[span])
    return found


def _expected(colour: Colour | None) -> tuple[float, float]:
    """Return the mean square of a stretch beside its parabola, for noise of 1, and its freedom.

    Without a colour the noise is white.

    A quadratic form x'Ax of normal x has the mean tr(AR) and the variance 2 tr(ARAR); chi-square
    of as many degrees has the same ratio of both (Satterthwaite, Biometrics Bull. 2 (1946) 110).
    """
    beside = np.stack([beside_parabola(unit) for unit in np.eye(_STRETCH)])
    white = np.eye(_STRETCH)[0]
    form = beside @ toeplitz(white if colour is None else colour.correlations(_STRETCH))
    mean = float(np.trace(form))
    return mean / _STRETCH, mean**2 / float(np.sum(form * form.T))
