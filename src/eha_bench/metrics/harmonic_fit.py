"""Fundamental and harmonics of a record of whole periods, with the noise between the lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray
from eha_bench.metrics.between_lines import BetweenLines, between_lines
from eha_bench.metrics.ringing import Ringing

HARMONICS = 10
"""Highest harmonic that is fitted, and counts as distortion."""


@dataclass(frozen=True)
class HarmonicFit:
    """Phasors of a fundamental and its harmonics, with what they leave."""

    phasors: tuple[complex, ...]  # fundamental first
    variance: float  # of each part of a harmonic's phasor
    fundamental_variance: float  # the same of the fundamental, from which a transient was taken
    transient: complex  # that was taken off the fundamental
    residual_rms: float
    freedom: float


def harmonic_fits(
    time: FloatArray,
    values: FloatArray,
    frequency: float,
    periods: int,
    expected: Sequence[Ringing] = (),
) -> list[HarmonicFit]:
    """Fit offset, fundamental and harmonics at once; the noise comes from between the lines.

    `time` (n,) s over whole periods, `values` (n, k): k channels, `expected` of the first ones what
    earlier periods say of a transient.
    """
    period = (time[-1] - time[0]) / (time.size - 1)
    highest = max(1, min(HARMONICS, math.ceil(0.5 / (frequency * period)) - 1))
    highest = max(1, min(highest, (time.size - 2) // 3))
    turns, projections = _sums(time, values, frequency, highest)
    # over whole periods the columns are nearly orthogonal: normal equations lose nothing
    right = np.concatenate([projections[:1].real, projections[1:].real, projections[1:].imag])
    solution = np.linalg.solve(_normal(turns, highest), right)
    residual = values - solution[0]
    for part in _parts(time.size):
        turn = np.exp(2j * np.pi * frequency * time[part])
        power = np.ones_like(turn)
        for h in range(1, highest + 1):
            power *= turn
            residual[part] -= power.real[:, None] * solution[h]
            residual[part] -= power.imag[:, None] * solution[highest + h]
    under = between_lines(time, residual, frequency, periods, highest, expected)
    return [
        _fit_of_solution(solution[:, k], residual[:, k], highest, own)
        for k, own in enumerate(under)
    ]


def _parts(count: int) -> list[slice]:
    """Return pieces that fit the processor's cache."""
    return [slice(start, start + 16384) for start in range(0, count, 16384)]


def _sums(
    time: FloatArray, values: FloatArray, frequency: float, highest: int
) -> tuple[ComplexArray, ComplexArray]:
    """Return sums of exp(j m w t) for m = 0 .. 2 highest, and of values times it up to highest.

    The least squares need no more than these, and no matrix of the record's length.
    """
    turns = np.zeros(2 * highest + 1, dtype=np.complex128)
    projections = np.zeros((highest + 1, values.shape[1]), dtype=np.complex128)
    for part in _parts(time.size):
        turn = np.exp(2j * np.pi * frequency * time[part])
        power = np.ones_like(turn)
        for m in range(2 * highest + 1):
            turns[m] += power.sum()
            if m <= highest:
                projections[m] += (power[:, None] * values[part]).sum(axis=0)
            power *= turn
    return turns, projections


def _normal(turns: ComplexArray, highest: int) -> FloatArray:
    """Return the normal matrix of the columns 1, cos(h w t), sin(h w t), h = 1 .. highest."""
    orders = np.arange(1, highest + 1)
    total = turns[orders[:, None] + orders]
    gap = orders[:, None] - orders
    difference = np.where(gap >= 0, turns[np.abs(gap)], turns[np.abs(gap)].conj())
    cosines, sines = turns[orders].real, turns[orders].imag
    cross = 0.5 * (total.imag - difference.imag)  # row: cosine, column: sine
    matrix: FloatArray = np.block(
        [
            [turns[:1].real[:, None], cosines[None, :], sines[None, :]],
            [cosines[:, None], 0.5 * (difference.real + total.real), cross],
            [sines[:, None], cross.T, 0.5 * (difference.real - total.real)],
        ]
    )
    return matrix


def _fit_of_solution(
    solution: FloatArray, residual: FloatArray, highest: int, under: BetweenLines
) -> HarmonicFit:
    # a cos + b sin = Re((a - jb) exp(jwt)); a sine of phase 0 is -j
    phasors = [complex(solution[1 + h], -solution[1 + highest + h]) for h in range(highest)]
    phasors[0] -= under.transient
    rms = math.sqrt(float(residual @ residual) / max(residual.size - 1 - 2 * highest, 1))
    return HarmonicFit(
        tuple(phasors),
        under.variance,
        under.variance + under.transient_variance,
        under.transient,
        rms,
        under.freedom,
    )
