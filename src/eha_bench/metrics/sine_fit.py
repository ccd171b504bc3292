"""A sine fit with four parameters (IEEE Std 1057-2017, clause 5.3.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray


@dataclass(frozen=True)
class SineFit:
    """offset + amplitude * sin(2 pi f t + phase), and what is left.

    Attributes:
        frequency: Hz.
        amplitude: unit of the data, not negative.
        phase: rad, in (-pi, pi].
        offset: unit of the data.
        residual: (n,) data minus fit.
    """

    frequency: float
    amplitude: float
    phase: float
    offset: float
    residual: FloatArray


def fit4(time: FloatArray, values: FloatArray, frequency: float, rounds: int = 30) -> SineFit:
    """Fit amplitude, phase, offset and frequency, from a first guess of the frequency (Hz).

    The guess must lie within about one period in the record's length; n >= 5.
    """
    middle = 0.5 * (float(time[0]) + float(time[-1]))  # centred: frequency and phase decouple
    centred = time - middle
    span = max(float(time[-1] - time[0]), 1e-300)
    for _ in range(rounds):
        a, b, _ = _linear(centred, values, frequency)
        angle = 2.0 * np.pi * frequency * centred
        turn = 2.0 * np.pi * centred * (-a * np.sin(angle) + b * np.cos(angle))
        design = np.column_stack(
            [np.cos(angle), np.sin(angle), np.ones_like(angle), turn * (1.0 / span)]
        )
        solution = np.linalg.lstsq(design, values, rcond=None)[0]
        change = float(solution[3]) / span
        change = max(min(change, 0.3 / span), -0.3 / span)
        frequency = max(frequency + change, 1e-12)
        if abs(change) < 1e-12 * frequency:
            break
    a, b, c = (float(value) for value in _linear(time, values, frequency))
    angle = 2.0 * np.pi * frequency * time
    residual = values - (a * np.cos(angle) + b * np.sin(angle) + c)
    return SineFit(frequency, math.hypot(a, b), math.atan2(a, b), c, residual)


def _linear(time: FloatArray, values: FloatArray, frequency: float) -> FloatArray:
    angle = 2.0 * np.pi * frequency * time
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
    solution: FloatArray = np.linalg.lstsq(design, values, rcond=None)[0]
    return solution
