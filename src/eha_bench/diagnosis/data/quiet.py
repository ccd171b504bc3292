"""Stretches in which nothing moves, and what they tell of the sensors' noise.

What was asked for stands still there for an eighth of a second (or 32 samples), and so do all
readings, but for what a parabola says of a pressure that leaks away. None swings with another one:
an oscillation about a standing mean is not rest. Every reading is then a constant and its noise,
whatever the model: none is used, so none of its errors can be taken for noise. Steady motion is not
rest, though all readings stand: its ripple is the machine's, not the sensors'. What a sensor
remembers from sample to sample depends on the sampling period, so each period has its own colours.
Logs with too few of such stretches leave the noise as white as it was taken to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour, beside_parabola, colour_of
from eha_bench.diagnosis.data.gate import SAME
from eha_bench.diagnosis.data.measured import GAP, Measured
from eha_bench.diagnosis.data.noise import THIRD, noise_of_input, noise_of_step, quantum_of

_STRETCH = 0.128
"""Length of a quiet stretch, s."""
_SHORTEST = 32
"""And least number of its samples."""
_STEPS = 2.5
"""Least range of readings that are noise, in steps of the resolution."""
_MOVES = 2.0
"""What a reading may move by in a stretch, in standard deviations of what is off its parabola:
noise with a memory of a tenth of the stretch moves as much."""
_PARTS = 4
_UNEVEN = 5.0
"""Spread of a part of a stretch beside its own parabola, in the usual one of its `_PARTS`, from
which a motion ends in it: not one in 100,000 stretches of 32 white readings is so uneven."""
_GOES = 5.0
"""Mean of a speed that is motion, in standard deviations of what is off its parabola."""
_SMOOTH = 8.0
"""Size of what is off a parabola, in the noise by third differences, from which it may be
motion: noise of a first-order filter is as smooth where it forgets within forty samples."""
_TOGETHER = 0.8
"""Correlation of two readings, one perhaps later, from which they swing together."""
_LATER = 0.25
"""Longest delay between them, as a share of a stretch."""
_FORGOTTEN = 0.5
"""Correlation up to which noise has forgotten."""
_ALIKE = 0.05
"""What sampling periods may differ by and still be the same, as a share of them."""


def with_noise_colour(measured: Sequence[Measured]) -> tuple[Measured, ...]:
    """Return runs with the colour of their channels' noise, where it is not white.

    A measured input that remembers is as noisy as all of its noise, not as what is new in it.
    """
    out = list(measured)
    left = [*range(len(out))]
    while left:
        first = measured[left[0]]
        group = [at for at in left if _sampled_alike(measured[at], first)]
        left = [at for at in left if at not in group]
        if found := _colours([measured[at] for at in group]):
            for at in group:
                out[at] = with_colours(measured[at], found)
    return tuple(out)


def coloured_like(measured: Measured, others: Sequence[Measured]) -> Measured:
    """Return a run with the colours of others of its sampling period; without any it is as it was.

    Args:
        measured: a run on its own. others: runs that have their colours.
    """
    for other in others:
        if other.colours and _sampled_alike(measured, other):
            return with_colours(measured, other.colours)
    return measured


def _colours(measured: Sequence[Measured]) -> dict[str, Colour]:
    """Return the colours of channels whose noise is not white, over runs of one period."""
    stretches: dict[str, list[FloatArray]] = {}
    for item in measured:
        for stretch in quiet_stretches(item):
            for name, values in stretch.items():
                if shows_noise(values, item.steps.get(name, 0.0)):
                    stretches.setdefault(name, []).append(values)
    found = {name: colour_of(own) for name, own in stretches.items()}
    return {
        name: colour
        for name, colour in found.items()
        if colour is not None and _forgets(colour, stretches[name][0].size)
    }


def _forgets(colour: Colour, samples: int) -> bool:
    """Whether noise forgets within half a stretch: what does not may as well be a slow motion."""
    half = samples // 2
    return bool(colour.correlations(half + 1)[half] < _FORGOTTEN)


def shows_noise(values: FloatArray, step: float) -> bool:
    """Whether readings tell of noise: what changes by a step or two of its resolution does not.

    Args:
        values: while nothing moves, (n,). step: of the resolution, 0 where there is none.
    """
    return bool(np.ptp(values) > _STEPS * step)


def _sampled_alike(one: Measured, other: Measured) -> bool:
    if one is other:
        return True
    if min(one.time.size, other.time.size) < 2:
        return False
    return abs(one.tick - other.tick) <= _ALIKE * max(one.tick, other.tick)


def with_colours(measured: Measured, colours: Mapping[str, Colour]) -> Measured:
    """Return a run with what is known of the colour of its channels' noise."""
    noise = dict(measured.input_noise)
    for name in noise.keys() & colours.keys():
        colour = colours[name]
        level = noise_of_input(colour.whitened(measured.inputs[name])) / colour.sharpness
        # of some samples nothing is left: then what was known before is all there is
        if level > 0.0:
            noise[name] = level
    return replace(measured, colours=colours, input_noise=noise)


def quiet_stretches(measured: Measured) -> Iterator[dict[str, FloatArray]]:
    """Yield the readings of every stretch of a run in which nothing moves, by channel."""
    time = measured.time
    steps = np.diff(time)
    usual = float(np.median(steps))
    ticks = max(_SHORTEST, round(_STRETCH / usual))
    still = np.asarray(steps < GAP * usual)
    asked = [values for name, values in measured.inputs.items() if name not in measured.input_noise]
    for values in asked:
        still &= np.abs(np.diff(values)) <= SAME * np.ptp(values)
    edges = np.flatnonzero(~still) + 1
    for start, stop in zip([0, *edges], [*edges, time.size], strict=True):
        for first in range(int(start), int(stop) - ticks + 1, ticks):
            span = slice(first, first + ticks)
            if any(np.ptp(values[span]) > SAME * np.ptp(values) for values in asked):
                continue
            valid = np.asarray(measured.valid[span].all(axis=0))
            readings = {
                name: measured.values[span, at]
                for at, name in enumerate(measured.outputs)
                if valid[at]
            }
            readings |= {
                name: values[span]
                for name, values in measured.still.items()
                if np.isfinite(values[span]).all()
            }
            readings |= {name: measured.inputs[name][span] for name in measured.input_noise}
            if not all(_stands(values) and _is_even(values) for values in readings.values()):
                continue
            if _rests(measured, span, readings) and not _swings(readings):
                yield readings


def _stands(values: FloatArray) -> bool:
    """Whether a reading moves by no more than noise does."""
    if np.ptp(values) == 0.0:
        return True
    beside = beside_parabola(values)
    slow = values - beside
    least = max(float(np.std(beside)), quantum_of(values))
    return bool(np.ptp(slow) <= _MOVES * least)


def _is_even(values: FloatArray) -> bool:
    """Whether all parts of a stretch are about as noisy: a motion that ends in one is no noise."""
    parts = [
        float(np.sqrt(np.mean(beside_parabola(part) ** 2)))
        for part in np.array_split(values, _PARTS)
    ]
    usual = max(float(np.median(parts)), noise_of_step(quantum_of(values)))
    return max(parts) <= _UNEVEN * usual


def _rests(measured: Measured, span: slice, readings: Mapping[str, FloatArray]) -> bool:
    """Whether readings that stand are those of a machine at rest, not of steady motion."""
    roles = measured.roles
    speeds = [name for name in roles.rates if name in readings and name not in measured.still]
    if any(_goes(readings[name]) for name in speeds):
        return False
    if any(name in readings for name in roles.turning):
        return True
    # nothing says whether the shaft turns, except what drives it
    drives = {*roles.acting, *roles.acting.values()}
    turned = [name for name in measured.inputs if name in drives]
    if turned:
        return all(_is_nothing(measured, name, span) for name in turned)
    # no shaft drives what is compared: a rod whose position stands is all that could move
    return any(name in readings and name not in measured.still for name in roles.rate_of)


def _swings(readings: Mapping[str, FloatArray]) -> bool:
    """Whether readings oscillate together: an oscillation is off a parabola, as noise is.

    Noise of one sensor may be as smooth, but another one's does not follow it.
    """
    beside = {
        name: beside_parabola(values) for name, values in readings.items() if np.ptp(values) > 0.0
    }
    smooth = [name for name, own in beside.items() if _is_smooth(own, quantum_of(readings[name]))]
    return any(
        _together(beside[name], own)
        for name in smooth
        for other, own in beside.items()
        if other != name
    )


def _is_smooth(beside: FloatArray, step: float) -> bool:
    """Whether a reading is far larger than what its neighbours differ by."""
    sharp = float(np.sqrt(np.mean(np.diff(beside, 3) ** 2) / THIRD))
    return float(np.std(beside)) > _SMOOTH * max(sharp, noise_of_step(step))


def _together(one: FloatArray, other: FloatArray) -> bool:
    """Whether two readings are equal, one of them perhaps later."""
    for lag in range(int(_LATER * one.size) + 1):
        for early, late in ((one, other), (other, one)):
            first, second = early[: early.size - lag], late[lag:]
            size = float(np.linalg.norm(first) * np.linalg.norm(second))
            if abs(float(first @ second)) > _TOGETHER * size:
                return True
    return False


def _goes(values: FloatArray) -> bool:
    """Whether a reading is clearly not nothing."""
    return bool(abs(np.mean(values)) > _GOES * np.std(beside_parabola(values)))


def _is_nothing(measured: Measured, name: str, span: slice) -> bool:
    values = measured.inputs[name]
    if name in measured.input_noise:
        return not _goes(values[span])
    return bool(np.abs(values[span]).max() <= SAME * np.abs(values).max())
