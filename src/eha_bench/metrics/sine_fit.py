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
        amplitude_sd, phase_sd, frequency_sd: Cramér-Rao bounds for white noise of the residual's
            standard deviation.
    """

    frequency: float
    amplitude: float
    phase: float
    offset: float
    residual: FloatArray
    amplitude_sd: float
    phase_sd: float
    frequency_sd: float


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
    return _finished(time, values, frequency, float(np.sum((centred - centred.mean()) ** 2)))


def _linear(time: FloatArray, values: FloatArray, frequency: float) -> FloatArray:
    angle = 2.0 * np.pi * frequency * time
    design = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
    solution: FloatArray = np.linalg.lstsq(design, values, rcond=None)[0]
    return solution


def _model(time: FloatArray, frequency: float, parameters: FloatArray) -> FloatArray:
    angle = 2.0 * np.pi * frequency * time
    a, b, c = (float(value) for value in parameters)
    model: FloatArray = a * np.cos(angle) + b * np.sin(angle) + c
    return model


def _finished(time: FloatArray, values: FloatArray, frequency: float, scatter: float) -> SineFit:
    """Return the fit at a frequency, with bounds; `scatter` is the sum of squares of time, s^2."""
    parameters = _linear(time, values, frequency)
    a, b, c = (float(value) for value in parameters)
    residual = values - _model(time, frequency, parameters)
    sd = math.sqrt(float(residual @ residual) / max(values.size - 4, 1))
    amplitude = math.hypot(a, b)
    amplitude_sd = sd * math.sqrt(2.0 / values.size)
    if amplitude == 0.0:
        phase_sd = frequency_sd = math.nan
    else:
        frequency_sd = sd / amplitude * math.sqrt(2.0 / scatter) / (2.0 * np.pi)
        # the phase is that at t = 0, the frequency's error turns it until there
        turned = 2.0 * np.pi * frequency_sd * abs(float(time.mean()))
        phase_sd = math.hypot(amplitude_sd / amplitude, turned)
    return SineFit(
        frequency, amplitude, math.atan2(a, b), c, residual, amplitude_sd, phase_sd, frequency_sd
    )
