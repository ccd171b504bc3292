"""Frequency response by a sweep: H1 with local polynomials instead of windows.

In a narrow band the response and the transient are smooth, the sweep's spectrum is not; fitting
both by parabolas takes leakage and transient away that Welch's windows would leave in (R. Pintelon,
J. Schoukens, G. Vandersteen, K. Barbe, Mech. Systems and Signal Processing 24, 2010,
doi:10.1016/j.ymssp.2009.08.009).
"""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray, IndexArray
from eha_bench.core.signal import Sweep
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.response_point import ResponsePoint
from eha_bench.metrics.step_response import magnitude, require_finite
from eha_bench.metrics.window import Timeline

_LEAST_HALF = 6  # bins on either side: 13 equations for 6 unknowns
_RELATIVE_HALF = 0.04  # of the frequency: how wide a band may be at high frequencies
_TAIL = 0.1  # of the sweep: recorded after its end, if there, so that the response can die out


def chirp_points(
    values: FloatArray, line: Timeline, sweeps: tuple[Sweep, ...]
) -> list[ResponsePoint]:
    """Return points in bands that do not overlap, over every sweep that the recording holds.

    Raises:
        NotScored: the recording ends before the sweep has started, or samples have no value.
    """
    points = []
    for sweep in sweeps:
        points += _sweep_points(values, line, sweep)
    if not points:
        raise NotScored("the sweep is too short: no band holds enough lines of its spectrum")
    return points


def _sweep_points(values: FloatArray, line: Timeline, sweep: Sweep) -> list[ResponsePoint]:
    end = float(line.time[-1]) + line.period
    done = sweep if end >= sweep.stop else None
    if done is None:
        if end <= sweep.start + 0.1 * (sweep.stop - sweep.start):
            raise NotScored(f"the recording ends at {end:.4g} s, before the sweep")
        done = sweep.until(end)
    stop = min(done.stop + _TAIL * (done.stop - done.start), end)
    window = line.between(done.start, stop)
    if window.stop - window.start < 64:
        raise NotScored(f"{window.stop - window.start} samples in the sweep")
    require_finite(line, values, window)
    require_finite(line, line.reference, window)
    if magnitude(line.reference[window]) == 0.0 or magnitude(values[window]) == 0.0:
        raise NotScored("the reference or the channel is zero throughout the sweep")
    response, bin_width = _spectrum(line, values, window)
    reference, _ = _spectrum(line, line.reference, window)
    low, high = sorted((done.f_start, done.f_stop))
    high = min(high, 0.45 / line.period)
    first, last = max(1, math.ceil(low / bin_width)), math.floor(high / bin_width)
    points = []
    start = first
    while start + 2 * _LEAST_HALF <= last:
        half = max(_LEAST_HALF, int(_RELATIVE_HALF * start))
        stop_bin = min(start + 2 * half, last)
        if last - stop_bin < _LEAST_HALF:  # no room for another band: take the rest along
            stop_bin = last
        points.append(_point(response, reference, np.arange(start, stop_bin + 1), bin_width))
        start = stop_bin + 1
    return points


def _spectrum(line: Timeline, values: FloatArray, window: slice) -> tuple[ComplexArray, float]:
    """Return the spectrum without the offset, and the width of a bin in Hz."""
    time, data = line.time[window], values[window]
    count = time.size
    uniform = np.linspace(float(time[0]), float(time[-1]), count)
    if np.max(np.abs(uniform - time)) > 1e-3 * line.period:
        from scipy.interpolate import CubicSpline  # slow to import

        data = CubicSpline(time, data)(uniform)
    step = (float(time[-1]) - float(time[0])) / (count - 1)
    return np.fft.rfft(data - data.mean()), 1.0 / (count * step)


def _point(
    response: ComplexArray, reference: ComplexArray, bins: IndexArray, bin_width: float
) -> ResponsePoint:
    """Fit G and the transient by parabolas over the bins; the point is G in their middle."""
    middle = 0.5 * (float(bins[0]) + float(bins[-1]))
    x = (bins - middle) / max(middle - float(bins[0]), 1.0)
    powers = np.vander(x, 3, increasing=True)
    r, y = reference[bins], response[bins]
    size_r, size_y = float(np.max(np.abs(r))) or 1.0, float(np.max(np.abs(y))) or 1.0
    design = np.hstack([powers * (r / size_r)[:, None], powers.astype(np.complex128)])
    solution, _, rank, _ = np.linalg.lstsq(design, y / size_y, rcond=1e-10)
    rest = y / size_y - design @ solution
    freedom = bins.size - int(rank)
    scatter = float(np.sum(np.abs(rest) ** 2)) / max(freedom, 1)
    inverse = np.linalg.pinv(design.conj().T @ design)
    gain = size_y / size_r
    explained = float(np.sum(np.abs(design[:, :3] @ solution[:3]) ** 2)) / bins.size
    total = explained + scatter
    return ResponsePoint(
        frequency=middle * bin_width,
        response=complex(solution[0]) * gain,
        variance=scatter * float(inverse[0, 0].real) * gain**2,
        freedom=2.0 * freedom,
        coherence=explained / total if total > 0.0 else 0.0,
    )
