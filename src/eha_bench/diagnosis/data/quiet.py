"""Stretches in which nothing moves, and what they tell of the sensors' noise.

What was asked for stands still there for an eighth of a second (or 32 samples), and so do all
readings, but for what a parabola says of a pressure that leaks away. Every reading is then a
constant and its noise, whatever the model: none is used, so none of its errors can be taken for
noise. Logs with too few of such stretches leave the noise as white as it was taken to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.data.colour import Colour, beside_parabola, colour_of
from eha_bench.diagnosis.data.gate import GAP, SAME, Measured
from eha_bench.diagnosis.data.noise import noise_of_input, quantum_of

FloatArray = NDArray[np.float64]

_STRETCH = 0.128
"""Length of a quiet stretch, s."""
_SHORTEST = 32
"""And least number of its samples."""
_MOVES = 2.0
"""What a reading may move by in a stretch, in standard deviations of what is beside its parabola:
noise with a memory of a tenth of the stretch moves as much."""


def coloured(measured: Sequence[Measured]) -> tuple[Measured, ...]:
    """Return runs with the colour of their channels' noise, where it is not white.

    A measured input that remembers is as noisy as all of its noise, not as what is new in it.
    """
    stretches: dict[str, list[FloatArray]] = {}
    for item in measured:
        for stretch in quiet_stretches(item):
            for name, values in stretch.items():
                stretches.setdefault(name, []).append(values)
    found = {name: colour for name, own in stretches.items() if (colour := colour_of(own))}
    return tuple(with_colours(item, found) for item in measured) if found else tuple(measured)


def with_colours(measured: Measured, colours: Mapping[str, Colour]) -> Measured:
    """Return a run with what is known of the colour of its channels' noise."""
    noise = {
        name: noise_of_input(colours[name].whitened(measured.inputs[name]))
        if name in colours
        else level
        for name, level in measured.input_noise.items()
    }
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
            if all(_stands(values) for values in readings.values()):
                yield readings


def _stands(values: FloatArray) -> bool:
    """Whether a reading moves by no more than noise does."""
    beside = beside_parabola(values)
    slow = values - beside
    least = max(float(np.std(beside)), quantum_of(values))
    return bool(np.ptp(slow) <= _MOVES * least)
