"""Simulation error by channel, before and after, beside the noise floor.

Over the windows of a fit (locked and bypassed runs whole, free ones about 0.4 s), each from the
start state that fits it best within what its measurement allows; root mean square, SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.channels import unit_of
from eha_bench.diagnosis.problem import Problem

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelError:
    """Root mean square errors of one channel, SI.

    Attributes:
        uncalibrated: of the declared model. before: recalibrated, without what was found.
        after: with it. noise_floor: of the channel's noise.
    """

    uncalibrated: float
    before: float
    after: float
    noise_floor: float
    unit: str


def rms_by_channel(problem: Problem, vector: FloatArray) -> dict[str, float]:
    """Return each channel's root mean square error, SI, the pressure difference included."""
    problem.prepare(vector)
    residual = problem.with_best_start(vector)
    names = problem.plant.outputs
    sums: dict[str, list[float]] = {}
    for piece in problem.pieces:
        rows = residual[piece.rows]
        by_name: dict[str, tuple[NDArray[np.intp], FloatArray]] = {}
        for channel in np.unique(piece.channels):
            mask = piece.channels == channel
            name = names[channel]
            error = rows[mask] * problem.noise[name]
            by_name[name] = (piece.ticks[mask], error)
            _add(sums, name, error)
        if "pressure_a" in by_name and "pressure_b" in by_name:
            ticks_a, error_a = by_name["pressure_a"]
            ticks_b, error_b = by_name["pressure_b"]
            _, at_a, at_b = np.intersect1d(ticks_a, ticks_b, return_indices=True)
            _add(sums, "pressure_difference", error_a[at_a] - error_b[at_b])
    return {name: float(np.sqrt(total / max(count, 1))) for name, (total, count) in sums.items()}


def _add(sums: dict[str, list[float]], name: str, error: FloatArray) -> None:
    entry = sums.setdefault(name, [0.0, 0.0])
    entry[0] += float(error @ error)
    entry[1] += error.size


def floors(noise: Mapping[str, float]) -> dict[str, float]:
    """Return each channel's noise floor, SI, the pressure difference included."""
    found = dict(noise)
    if "pressure_a" in noise and "pressure_b" in noise:
        found["pressure_difference"] = float(np.hypot(noise["pressure_a"], noise["pressure_b"]))
    return found


def channel_errors(problem: Problem, vectors: Sequence[FloatArray]) -> dict[str, ChannelError]:
    """Return the errors of the declared, the recalibrated and the revised model, by channel."""
    declared, before, after = (rms_by_channel(problem, vector) for vector in vectors)
    floor = floors(problem.noise)
    return {
        name: ChannelError(
            declared[name], before[name], after[name], floor.get(name, float("nan")), unit_of(name)
        )
        for name in sorted(after)
    }
