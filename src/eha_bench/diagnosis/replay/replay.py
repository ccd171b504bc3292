"""Whole runs replayed freely by several models: what `predict` gives, with what was measured.

The errors of a diagnosis are those of these replays, so that anyone can compute them again from
`predict` with recalibrated.yaml and revised.yaml. But one noisy sample is all that a replay starts
from, and where a small change of the start lasts or grows, its error says more about that sample
than about the model. So each run is replayed once more from a start one standard deviation of the
sensors' noise away; where that shows, the run is replayed from the start within three standard
deviations that fits it best. Commands that were lost are taken likewise, as far off as they may be.
Both errors are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.interruption import result_at_checkpoints
from eha_bench.core.processors import usable_processors
from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.data.first_rates import first_rates
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import is_bounded
from eha_bench.diagnosis.fit.effort import note_simulated_time
from eha_bench.diagnosis.fit.lost_inputs import at_their_best, with_held
from eha_bench.diagnosis.fit.own_parameters import OwnValues
from eha_bench.diagnosis.replay.asked_before import with_asked_before
from eha_bench.diagnosis.replay.first_sample import first_sample, first_state
from eha_bench.diagnosis.replay.prediction import STEP, simulate_from
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Drive, Plant

Columns = Mapping[str, FloatArray]

COARSE = 2e-4
"""Integration step where only differences between two starts count, s."""

_LOOSE = 0.3
_FURTHEST = 3.0
_PARTS = (0.1, 0.25, 0.5, 1.0, 1.0)
"""Parts of a run that say one after the other where its start is."""
_WORKERS = min(4, usable_processors())


@dataclass(frozen=True)
class Replay:
    """One run as measured and as each model replays it.

    Attributes:
        run: its name. use: train, holdout or unseen. locked, bypass_open: its setup.
        time: (n,) s from the first sample.
        inputs: channel -> (n,) what drove the models, SI.
        measured: channel -> (n,) SI, NaN where it may not be believed.
        simulated: one mapping channel -> (n,) SI for each model, in the order they were given, from
            the best start within the noise of the first sample.
        predicted: the same from the first sample as it is.
        moved: channel -> root mean square change by one standard deviation of the start, SI, of the
            last model.
        units: SI units of channels that eha_bench does not know.
        is_bounded: whether an error of the model does not add up over it.
        until: s from which on nothing is compared.
    """

    run: str
    use: Use
    locked: bool
    bypass_open: bool
    time: FloatArray
    inputs: Columns
    measured: Columns
    simulated: tuple[Columns, ...]
    predicted: tuple[Columns, ...]
    moved: Mapping[str, float]
    units: Mapping[str, str] = field(default_factory=dict)
    is_bounded: bool = False
    until: float = math.inf

    @property
    def tick(self) -> float:
        """Mean step of its clock, s; it has two samples or more."""
        return float(self.time[-1] - self.time[0]) / (self.time.size - 1)

    def unit(self, channel: str) -> str:
        """Return the SI unit of a channel."""
        return self.units.get(channel, unit_of(channel))

    def errors(self, channel: str) -> tuple[FloatArray, ...]:
        """Return measured less simulated, (n,) for each model.

        NaN where nothing was measured, infinite where a simulation diverged.
        """
        return tuple(self._error(channel, values) for values in self.simulated)

    def prediction_errors(self, channel: str) -> tuple[FloatArray, ...]:
        """Return measured less predicted, (n,) for each model, as `errors` does."""
        return tuple(self._error(channel, values) for values in self.predicted)

    def _error(self, channel: str, values: Columns) -> FloatArray:
        measured, other = self.measured[channel], values[channel]
        error = np.where(np.isfinite(other), measured - other, measured + np.inf)
        return np.where(self.time < self.until, error, np.nan)


def replay(
    runs: Sequence[Measured],
    models: Sequence[Model],
    noise: Mapping[str, float],
    progress: Callable[[float], None] | None = None,
    own: Sequence[OwnValues] = (),
    lateness: Sequence[Mapping[str, float]] = (),
) -> tuple[Replay, ...]:
    """Replay runs from their inputs and first samples, as `predict` does.

    Args:
        runs: that passed the gate; those with nothing to compare are left out.
        models: of one plant, the last one is what was found.
        noise: channel -> standard deviation of the sensors' noise, SI.
        progress: called with the fraction done.
        own: of each model, the runs' own parameters.
        lateness: of each model, clock -> s by which its fit takes stamps to be late.
    """
    found = []
    values = own or [{}] * len(models)
    late = lateness or [{}] * len(models)
    usable = [item for item in runs if item.outputs]

    def one(measured: Measured) -> Replay:
        return _one(measured, models, values, late, noise)

    with ThreadPoolExecutor(_WORKERS) as pool:
        started = [pool.submit(one, item) for item in usable]
        try:
            for number, (item, future) in enumerate(zip(usable, started, strict=True)):
                found.append(result_at_checkpoints(future))
                note_simulated_time(len(models) * float(item.time[-1]))
                if progress:
                    progress((number + 1) / len(usable))
        finally:
            for future in started:
                future.cancel()
    return tuple(found)


def _one(
    measured: Measured,
    models: Sequence[Model],
    given: Sequence[OwnValues],
    late: Sequence[Mapping[str, float]],
    noise: Mapping[str, float],
) -> Replay:
    runs = [
        replace(measured.knowing(item.get(measured.run.name, {})), lateness=clocks)
        for item, clocks in zip(given, late, strict=True)
    ]
    own = _read_columns(measured)
    starts = [first_state(run, model) for run, model in zip(runs, models, strict=True)]
    firsts = [first_sample(run, model).state for run, model in zip(runs, models, strict=True)]
    logged = runs
    runs = [
        with_asked_before(run, model, start)
        for run, model, start in zip(runs, models, starts, strict=True)
    ]
    started = [
        _simulate(run, model, start, STEP)
        for run, model, start in zip(runs, models, starts, strict=True)
    ]
    predicted = [
        values if first == start
        else _simulate(with_asked_before(run, model, first), model, first, STEP)
        for run, model, first, start, values
        in zip(logged, models, firsts, starts, started, strict=True)
    ]  # fmt: skip
    if measured.unsure:
        runs = [
            _with_lost_inputs(run, model, start, own, noise)
            for run, model, start in zip(runs, models, starts, strict=True)
        ]
        started = [
            _simulate(run, model, start, STEP)
            for run, model, start in zip(runs, models, starts, strict=True)
        ]
    moved = _start_sensitivity(runs[-1], models[-1], starts[-1], own, noise)
    loose = any(value > _LOOSE * noise[name] for name, value in moved.items() if name in noise)
    simulated = [
        _from_best_start(run, model, start, values, own, noise) if loose else values
        for run, model, start, values in zip(runs, models, starts, started, strict=True)
    ]
    return _replay_of(measured, own, simulated, predicted, moved, models[-1])


def rough_replay(
    measured: Measured, models: Sequence[Model], own: OwnValues, lateness: Mapping[str, float]
) -> Replay:
    """Replay one run quickly, from its first sample as it is and at a coarse step.

    Args:
        measured: the run; it has something to compare. models: of one plant.
        own: runs' own parameters. lateness: clock -> s by which its stamps are late.
    """
    known = own.get(measured.run.name, {})
    run = replace(measured.knowing(known), lateness=lateness)
    values = [_simulate(run, model, first_state(run, model), COARSE) for model in models]
    return _replay_of(measured, _read_columns(measured), values, values, {}, models[-1])


def _read_columns(measured: Measured) -> Columns:
    """Return what a run's sensors read, P1 - P2 included, NaN where it may not be believed."""
    columns = {name: measured.column(name) for name in measured.outputs}
    read = {name: column for name, column in columns.items() if column is not None}
    return _with_difference(read, measured.roles.pair)


def _replay_of(
    measured: Measured,
    read: Columns,
    simulated: Sequence[Columns],
    predicted: Sequence[Columns],
    moved: Mapping[str, float],
    model: Model,
) -> Replay:
    run = measured.run
    return Replay(
        run.name, run.use, run.locked, run.bypass_open, measured.time, measured.inputs, read,
        tuple(simulated), tuple(predicted), moved, model.plant.units, is_bounded(measured),
    )  # fmt: skip


def _with_lost_inputs(
    measured: Measured,
    model: Model,
    start: Mapping[str, float],
    own: Columns,
    noise: Mapping[str, float],
) -> Measured:
    """Return a run with lost values of its inputs as fits best, within what they may be."""
    weights = {name: size for name, size in noise.items() if name in own and size > 0.0}
    if not weights:
        return measured
    times = np.concatenate([measured.time[np.isfinite(own[name])] for name in weights])

    def residual(drive: Drive) -> FloatArray:
        values = _simulate(replace(measured, inputs=drive.inputs), model, start, COARSE)
        left = _weighted_difference(own, values, weights)
        return left if np.isfinite(left).all() else np.zeros(left.size)

    def cost(drive: Drive) -> float:
        left = residual(drive)
        return float(left @ left)

    drive = replace(measured, asked_before={}).drive(0, measured.time.size)
    held = with_held(drive, measured.unsure)
    if held is not None and cost(held) < cost(drive):
        drive = held
    best = at_their_best(
        drive, measured.unsure, times, lambda drives: [residual(item) for item in drives]
    )
    return replace(measured, inputs=best.inputs)


def _spreads(
    measured: Measured, start: Mapping[str, float], noise: Mapping[str, float]
) -> dict[str, float]:
    """Return how far each state at the start may be off, one standard deviation, SI."""
    found = {
        name: float(np.hypot(noise[name], _gone_before_read(measured, name)))
        for name in sorted(start)
        if noise.get(name, 0.0) > 0.0
    }
    found |= {name: rate.spread for name, rate in first_rates(measured).items() if name in start}
    still = {*measured.roles.acting, *(measured.roles.locked if measured.run.locked else ())}
    return {name: size for name, size in found.items() if name not in still}


def _gone_before_read(measured: Measured, name: str) -> float:
    """Return how far a channel went until its first reading, by how it went on, SI."""
    column = measured.column(name)
    if column is None or name not in measured.first or measured.first[name].tick == 0:
        return 0.0
    read = np.flatnonzero(np.isfinite(column))
    if read.size < 2:
        return 0.0
    first, time = read[0], measured.time
    later = read[min(np.searchsorted(read, 2 * first), read.size - 1)]
    rate = (column[later] - column[first]) / (time[later] - time[first])
    return float(abs(rate) * (time[first] - time[0]))


def _start_sensitivity(
    measured: Measured,
    model: Model,
    start: Mapping[str, float],
    own: Columns,
    noise: Mapping[str, float],
) -> dict[str, float]:
    """Return how far a start one standard deviation off in every state moves each channel."""
    spreads = _spreads(measured, start, noise)
    if not spreads:
        return dict.fromkeys(own, 0.0)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(spreads))
    shaken = dict(start)
    for (name, size), sign in zip(spreads.items(), signs, strict=True):
        shaken[name] += float(sign) * size
    other = _simulate(measured, model, shaken, COARSE)
    base = _simulate(measured, model, start, COARSE)
    moved = {}
    for name, column in own.items():
        change = (other[name] - base[name])[np.isfinite(column)]
        moved[name] = float(np.sqrt(np.mean(change**2)))
    return moved


def _from_best_start(
    measured: Measured,
    model: Model,
    start: Mapping[str, float],
    values: Columns,
    own: Columns,
    noise: Mapping[str, float],
) -> Columns:
    """Replay from the start that fits best within the noise of the first sample.

    Its first part tells it first: over a whole run, what sticks elsewhere or swings in another
    phase makes many minima. Gauss-Newton steps, a tenth of the run and then more of it.
    """
    weights = {name: size for name, size in noise.items() if name in own and size > 0.0}
    target = _weighted_difference(own, values, weights)
    if not weights or not np.isfinite(target).all():
        return values
    spreads = _spreads(measured, start, noise)
    times = np.concatenate([measured.time[np.isfinite(own[name])] for name in weights])

    def off(shares: FloatArray, step: float) -> Columns:
        moved = dict(start)
        for (name, size), share in zip(spreads.items(), shares, strict=True):
            moved[name] += float(share) * size
        return _simulate(measured, model, moved, step)

    shares, best, least = np.zeros(len(spreads)), values, float(target @ target)
    for part in _PARTS:
        rows = times - measured.time[0] <= part * (measured.time[-1] - measured.time[0])
        base = off(shares, COARSE)
        left = _weighted_difference(own, base, weights)[rows]
        columns = [_weighted_difference(off(shares + unit, COARSE), base, weights, where=own)[rows]
                   for unit in np.eye(len(spreads))]  # fmt: skip
        matrix = np.column_stack(columns)
        if not (np.isfinite(matrix).all() and np.isfinite(left).all()):
            break
        # a start is as likely off by one standard deviation as a sample is by its noise; stacked,
        # as their squares would drown it where a start runs away
        stacked = np.vstack([matrix, np.eye(len(columns))])
        change = np.linalg.lstsq(stacked, np.concatenate([left, -shares]))[0]
        for length in (1.0, 0.3):
            trial = np.clip(shares + length * change, -_FURTHEST, _FURTHEST)
            there = _weighted_difference(own, off(trial, COARSE), weights)[rows]
            if there @ there + trial @ trial < left @ left + shares @ shares:
                shares = trial
                break
        else:
            continue
        found = off(shares, STEP)
        after = _weighted_difference(own, found, weights)
        if float(after @ after) < least:
            best, least = found, float(after @ after)
    return best


def _weighted_difference(
    one: Columns, other: Columns, weights: Mapping[str, float], where: Columns | None = None
) -> FloatArray:
    """Return the difference of some channels where they were measured, in their noise, (N,)."""
    there = where or one
    parts = [
        ((one[name] - other[name]) / size)[np.isfinite(there[name])]
        for name, size in weights.items()
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _simulate(measured: Measured, model: Model, start: Mapping[str, float], step: float) -> Columns:
    values = simulate_from(measured, model, start, step)
    return _columns(values, measured, model.plant)


def _columns(values: FloatArray, measured: Measured, plant: Plant) -> Columns:
    """Return simulated channels at the instants at which their samples were taken."""
    outputs = plant.outputs
    return _with_difference(
        {
            name: np.ascontiguousarray(
                measured.at_sample_instants(name, values[:, outputs.index(name)], measured.lateness)
            )
            for name in measured.outputs
        },
        plant.roles.pair,
    )


def _with_difference(
    columns: dict[str, FloatArray], pair: tuple[str, ...]
) -> dict[str, FloatArray]:
    if pair and all(name in columns for name in pair):
        columns["pressure_difference"] = columns[pair[0]] - columns[pair[1]]
    return columns
