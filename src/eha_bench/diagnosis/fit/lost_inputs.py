"""What inputs that were not logged make a simulation do.

The value of a lost message is a guess that may be off by its spread (`data.lost_inputs`), and held
until the next message it acts all that while. What that does to a window's residual is one more
direction in which it may be off by one standard deviation, as its start state is. Messages that
were lost far apart are simulated together, as each one's response has died away where the next
begins. Those whose guesses together make less than the noise are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.lost_inputs import LostValues
from eha_bench.diagnosis.fit.input_noise import SHOWS, InputNoise, Residuals
from eha_bench.plants.plant import Drive

_APART = 0.4
"""Time between lost messages that are simulated together, s: masses on oil have come to rest."""
_FEWER = 4
"""Factor by which the number of messages grows while what is left still shows."""
_FURTHEST = 3.0
"""Most that a lost value is taken to be off by, in its spreads."""


@dataclass(frozen=True)
class _Pulse:
    """A lost message: its input, the ticks that it acts over, and how far it may be off, SI.

    That has the sign of what was asked for before: a drive that saturates answers to one side only.
    """

    name: str
    tick: int
    stop: int
    spread: float


def lost_input_noise(
    drive: Drive,
    unsure: Mapping[str, LostValues],
    begin: int,
    times: FloatArray,
    vector: FloatArray,
    residuals: Residuals,
) -> InputNoise:
    """Return what messages of inputs that were lost do to a window's residual.

    Args:
        drive: of the window. unsure: input -> its values that were not logged.
        begin: tick of the run at which the drive begins. times: (N,) s of the residual's rows.
        vector: of the plant. residuals: of the window.
    """
    _, columns, simulations = _responses(drive, unsure, begin, times, residuals)
    return InputNoise(columns, vector, simulations, np.zeros(times.size))


def at_their_best(
    drive: Drive,
    unsure: Mapping[str, LostValues],
    times: FloatArray,
    residuals: Residuals,
) -> Drive:
    """Return a whole run's drive with lost values as its readings ask for, within their spreads.

    One Gauss-Newton step; a value is as likely off by its spread as a reading is by its noise.

    Args:
        drive: of the run. unsure: input -> its values that were not logged.
        times: (N,) s of the residual's rows. residuals: of the run.
    """
    pulses, columns, _ = _responses(drive, unsure, 0, times, residuals)
    if not pulses:
        return drive
    stacked = np.vstack([columns, np.eye(len(pulses))])
    (now,) = residuals([drive])
    found = -np.linalg.lstsq(stacked, np.append(now, np.zeros(len(pulses))))[0]
    return _with(drive, pulses, np.clip(found, -_FURTHEST, _FURTHEST))


def with_held(drive: Drive, unsure: Mapping[str, LostValues]) -> Drive | None:
    """Return a whole run's drive with what was asked for before acting on; None where it cannot.

    Where a row of a table is lost, so may be what it would have asked for (a bus that failed).
    """
    inputs = {name: values.copy() for name, values in drive.inputs.items()}
    found = False
    for name, own in unsure.items():
        if own.held is None:
            continue
        found = found or own.ticks.size > 0
        for tick, stop, value in zip(own.ticks, own.stops, own.held.tolist(), strict=True):
            inputs[name][int(tick) : int(stop)] = value
    return replace(drive, inputs=inputs) if found else None


def _responses(
    drive: Drive,
    unsure: Mapping[str, LostValues],
    begin: int,
    times: FloatArray,
    residuals: Residuals,
) -> tuple[list[_Pulse], FloatArray, int]:
    """Return lost messages that show, what each does, (N, k), and how many simulations it took."""
    items = [
        pulse
        for name, own in unsure.items()
        for pulse in _pulses(name, own, drive, begin)
        if pulse.stop > drive.turns and pulse.tick < drive.time.size
    ]
    items.sort(key=lambda item: -abs(item.spread))
    if not items:
        return [], np.zeros((times.size, 0)), 0
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(items))
    base, left = residuals([drive, _with(drive, items, signs)])
    simulations, count = 2, 0
    while float((left - base) @ (left - base)) >= SHOWS * drive.time.size:
        count = min(max(_FEWER * count, _FEWER), len(items))
        if count == len(items):
            break
        (left,) = residuals([_with(drive, items[count:], signs[count:])])
        simulations += 1
    columns: list[FloatArray] = []
    pulses: list[_Pulse] = []
    batches = _apart(items[:count], drive.time)
    simulations += len(batches)
    moved_by = [_with(drive, batch, np.ones(len(batch))) for batch in batches]
    for batch, moved in zip(batches, residuals(moved_by) if batches else [], strict=True):
        pulses += batch
        begins = [float(drive.time[item.tick]) for item in batch]
        for start, stop in zip(begins, [*begins[1:], np.inf], strict=True):
            columns.append(np.where((times >= start) & (times < stop), moved - base, 0.0))
    return pulses, np.array(columns).reshape(len(columns), times.size).T, simulations


def _pulses(name: str, own: LostValues, drive: Drive, begin: int) -> Iterator[_Pulse]:
    """Yield the lost messages of an input, by the ticks of a drive that begins at a run's tick."""
    values = drive.inputs[name]
    held = np.full(own.ticks.size, np.inf) if own.held is None else own.held
    for tick, stop, spread, before in zip(own.ticks, own.stops, own.spread, held, strict=True):
        first, last = max(int(tick) - begin, drive.turns), min(int(stop) - begin, values.size)
        guess = values[min(first, values.size - 1)]
        yield _Pulse(name, first, last, float(np.copysign(spread, before - guess)))


def _with(drive: Drive, pulses: list[_Pulse], sizes: FloatArray) -> Drive:
    """Return a drive whose lost values are off by so many of their spreads."""
    inputs = {name: values.copy() for name, values in drive.inputs.items()}
    for item, size in zip(pulses, sizes, strict=True):
        inputs[item.name][item.tick : item.stop] += size * item.spread
    return replace(drive, inputs=inputs)


def _apart(items: list[_Pulse], time: FloatArray) -> list[list[_Pulse]]:
    """Return lost messages in batches of which each is far from the one before it."""
    batches: list[list[_Pulse]] = []
    for item in sorted(items, key=lambda item: item.tick):
        for batch in batches:
            if time[item.tick] - time[batch[-1].tick] >= _APART:
                batch.append(item)
                break
        else:
            batches.append([item])
    return batches
