"""Whole runs replayed freely by several models: what `predict` gives, beside what was measured.

The errors of a diagnosis are those of these replays, so that anybody can compute them again from
`predict` with recalibrated.yaml and revised.yaml. A free replay says more about its start than
about the model where a small change of the start grows; so each run is replayed once more from a
start one standard deviation of the sensors' noise away, and how far that moves each channel is
kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.dataset import Use
from eha_bench.diagnosis.gate import Measured
from eha_bench.diagnosis.prediction import STEP, first_state, simulate_from
from eha_bench.plants.model import Model

FloatArray = NDArray[np.float64]
Columns = Mapping[str, FloatArray]

_WORKERS = max(1, min(4, os.cpu_count() or 1))


@dataclass(frozen=True)
class Replay:
    """One run as measured and as each model replays it.

    Attributes:
        run: its name. use: train or holdout. locked, bypass_open: its setup.
        time: (n,) s from the first sample.
        inputs: channel -> (n,) what drove the models, SI.
        measured: channel -> (n,) SI, NaN where it may not be believed.
        simulated: one mapping channel -> (n,) SI for each model, in the order they were given.
        moved: channel -> root mean square change by one standard deviation of the start, SI, of the
            last model.
    """

    run: str
    use: Use
    locked: bool
    bypass_open: bool
    time: FloatArray
    inputs: Columns
    measured: Columns
    simulated: tuple[Columns, ...]
    moved: Mapping[str, float]

    def errors(self, channel: str) -> tuple[FloatArray, ...]:
        """Return measured less simulated, (n,) for each model.

        NaN where nothing was measured, infinite where a simulation diverged.
        """
        measured = self.measured[channel]
        return tuple(
            np.where(np.isfinite(values[channel]), measured - values[channel], measured + np.inf)
            for values in self.simulated
        )


def replay(
    runs: Sequence[Measured],
    models: Sequence[Model],
    noise: Mapping[str, float],
    progress: Callable[[float], None] | None = None,
) -> tuple[Replay, ...]:
    """Replay runs from their inputs and first samples, as `predict` does.

    Args:
        runs: that passed the gate; those with nothing to compare are left out.
        models: of one plant, the last one is what was found.
        noise: channel -> standard deviation of the sensors' noise, SI.
        progress: called with the fraction done.
    """
    found = []
    usable = [item for item in runs if item.outputs]
    with ThreadPoolExecutor(_WORKERS) as pool:
        for number, item in enumerate(pool.map(lambda m: _one(m, models, noise), usable)):
            found.append(item)
            if progress:
                progress((number + 1) / len(usable))
    return tuple(found)


def _one(measured: Measured, models: Sequence[Model], noise: Mapping[str, float]) -> Replay:
    outputs = models[-1].plant.outputs
    simulated = []
    for model in models:
        values = simulate_from(measured, model, first_state(measured, model), STEP)
        simulated.append(_columns(values, measured.outputs, outputs))
    own = {name: column for name in measured.outputs
           if (column := measured.column(name)) is not None}  # fmt: skip
    own = _with_difference(own)
    shaken = _shaken(measured, models[-1], noise)
    moved = {}
    if shaken is not None:
        other = _columns(shaken, measured.outputs, outputs)
        for name, column in own.items():
            change = (other[name] - simulated[-1][name])[np.isfinite(column)]
            moved[name] = float(np.sqrt(np.mean(change**2)))
    return Replay(
        measured.run.name,
        measured.run.use,
        measured.run.locked,
        measured.run.bypass_open,
        measured.time,
        measured.inputs,
        own,
        tuple(simulated),
        moved,
    )


def _shaken(measured: Measured, model: Model, noise: Mapping[str, float]) -> FloatArray | None:
    """Return a replay whose start is as far off as its sensors' noise makes it."""
    start = first_state(measured, model)
    sizes = {name: noise[name] for name in start if name in noise and name != "current"}
    if measured.run.locked:
        sizes.pop("piston_velocity", None)
    if not sizes:
        return None
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(sizes))
    for (name, size), sign in zip(sorted(sizes.items()), signs, strict=True):
        start[name] += float(sign) * size
    return simulate_from(measured, model, start, STEP)


def _columns(values: FloatArray, channels: Sequence[str], outputs: Sequence[str]) -> Columns:
    return _with_difference(
        {name: np.ascontiguousarray(values[:, outputs.index(name)]) for name in channels}
    )


def _with_difference(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    if "pressure_a" in columns and "pressure_b" in columns:
        columns["pressure_difference"] = columns["pressure_a"] - columns["pressure_b"]
    return columns
