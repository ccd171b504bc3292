"""Frequency response by periodic signals: noise and nonlinear distortion separated, line by line.

Noise differs from period to period, distortion by a nonlinearity only from one realisation of the
phases to the next: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain
Approach, 2nd ed., 2012, chapter 4 (robust and fast method), doi:10.1002/9781118287422.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from eha_bench.core.arrays import ComplexArray, FloatArray, IndexArray
from eha_bench.core.signal import Lines
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.response_point import ResponsePoint
from eha_bench.metrics.step_response import magnitude, require_finite
from eha_bench.metrics.window import Timeline

TRANSIENT_PERIODS = 1
"""Periods at the start of every realisation that are never used."""

_NEIGHBOURS = 5  # lines whose variances are averaged: they are smooth, and few repeats know little


@dataclass(frozen=True)
class _Realisation:
    response: ComplexArray  # (lines,)
    noise: FloatArray  # variance of `response` over the periods, (lines,); NaN from one period
    idle: FloatArray  # power of the response on lines without a sine, over |R|^2, (lines,)
    periods: int


def multisine_points(
    values: FloatArray, line: Timeline, lines: tuple[Lines, ...]
) -> list[ResponsePoint]:
    """Return a point for every excited line from all realisations that the recording holds.

    Raises:
        NotScored: no settled period, samples without a value, or lines above half the sample rate.
    """
    harmonics = np.array(lines[0].harmonics, dtype=np.intp)
    period = lines[0].period
    harmonics = harmonics[harmonics / period < 0.45 / line.period]
    if harmonics.size == 0:
        raise NotScored("all lines lie above half the sample rate")
    found = [_realisation(values, line, block, harmonics) for block in lines]
    realisations = [item for item in found if item is not None]
    if not realisations:
        raise NotScored(
            f"no settled period: {TRANSIENT_PERIODS} of every realisation is left out as transient"
        )
    return _response_points(realisations, harmonics, period)


def _realisation(
    values: FloatArray, line: Timeline, block: Lines, harmonics: IndexArray
) -> _Realisation | None:
    """Return what the settled periods of one realisation say, or None if it has none."""
    end = float(line.time[-1]) + 1.01 * line.period
    whole = math.floor((min(block.stop, end) - block.start) / block.period + 1e-6)
    if whole <= TRANSIENT_PERIODS or block.start < line.time[0] - line.period:
        return None
    used = whole - TRANSIENT_PERIODS
    start = block.start + TRANSIENT_PERIODS * block.period
    window = line.between(start, start + used * block.period)
    if window.stop - window.start < 0.9 * used * block.period / line.period:
        return None
    require_finite(line, values, window)
    require_finite(line, line.reference, window)
    response = _spectra(values, line, window, start, block.period, used)
    reference = _spectra(line.reference, line, window, start, block.period, used).mean(axis=0)
    excited = reference[harmonics]
    if np.any(np.abs(excited) < 1e-6 * np.max(np.abs(excited))) or magnitude(excited) == 0.0:
        raise NotScored("the reference does not hold the lines that the signal has")
    ratios = response[:, harmonics] / excited
    mean = ratios.mean(axis=0)
    noise = np.full(harmonics.size, np.nan)
    if used > 1:
        noise = np.sum(np.abs(ratios - mean) ** 2, axis=0) / (used * (used - 1))
    idle = _idle(response, harmonics) / np.abs(excited) ** 2
    return _Realisation(mean, noise, idle, used)


def _spectra(
    values: FloatArray, line: Timeline, window: slice, start: float, period: float, used: int
) -> ComplexArray:
    """Return the spectrum of every period, (used, m)."""
    scale = magnitude(values[window]) or 1.0
    count = round(period / line.period)
    fits = abs(period / line.period - count) * used < 0.01
    if fits and window.stop - window.start == used * count:
        data = values[window]
    else:
        from scipy.interpolate import CubicSpline  # slow to import

        # periods that are not whole number of samples: the same spline on both sides of the ratio
        stamps = start + np.arange(used * count) * (period / count)
        near = slice(max(window.start - 3, 0), window.stop + 3)
        spline = CubicSpline(line.time[near], values[near])
        data = spline(np.clip(stamps, line.time[near][0], line.time[near][-1]))
    spectra: ComplexArray = np.fft.rfft((data / scale).reshape(used, count), axis=1) * scale
    return spectra


def _idle(response: ComplexArray, harmonics: IndexArray) -> FloatArray:
    """Return the power of the mean period on idle lines near each excited one, noise taken off."""
    used, size = response.shape
    mean = response.mean(axis=0)
    idle = np.setdiff1d(np.arange(1, min(int(harmonics[-1]) + 1, size)), harmonics)
    if idle.size == 0:
        return np.full(harmonics.size, np.nan)
    power = np.abs(mean[idle]) ** 2
    if used > 1:
        power -= np.sum(np.abs(response[:, idle] - mean[idle]) ** 2, axis=0) / (used * (used - 1))
    smooth = uniform_filter1d(power, min(_NEIGHBOURS, idle.size), mode="nearest")
    near: FloatArray = np.maximum(np.interp(harmonics, idle, smooth), 0.0)
    return near


def _response_points(
    realisations: list[_Realisation], harmonics: IndexArray, period: float
) -> list[ResponsePoint]:
    count = len(realisations)
    width = min(_NEIGHBOURS, harmonics.size)
    responses = np.array([item.response for item in realisations])
    mean = responses.mean(axis=0)
    noise = uniform_filter1d(
        np.mean([item.noise for item in realisations], axis=0) / count, width, mode="nearest"
    )
    periods = sum(item.periods for item in realisations)
    if count > 1:
        spread = np.sum(np.abs(responses - mean) ** 2, axis=0) / (count * (count - 1))
        total = uniform_filter1d(spread, width, mode="nearest")
        freedom = 2.0 * (count - 1) * width
        distortion = np.sqrt(np.maximum(total - np.nan_to_num(noise), 0.0) * count)
    else:
        idle = np.array(realisations[0].idle)
        distortion = np.sqrt(idle)
        total = noise + np.nan_to_num(idle)
        freedom = 2.0 * (periods - 1) * width
    # coherence as one period would have it
    single = total * (periods if count == 1 else count)
    known = np.isfinite(total) & (freedom > 0)
    power = np.abs(mean) ** 2
    coherence = np.where(known, power / np.maximum(power + np.nan_to_num(single), 1e-300), 1.0)
    return [
        ResponsePoint(
            frequency=float(harmonics[k]) / period,
            response=complex(mean[k]),
            variance=float(total[k]) if known[k] else math.nan,
            freedom=freedom if known[k] else 0.0,
            coherence=float(coherence[k]),
            noise=float(np.sqrt(noise[k])),
            distortion=float(distortion[k]),
        )
        for k in range(harmonics.size)
    ]
