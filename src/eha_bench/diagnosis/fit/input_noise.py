"""What the noise of a measured input makes a simulation do.

A measured state among the inputs drives the model with its sensor's noise, and a balance adds that
up: of a current's white noise a shaft makes a walk. White noise of standard deviation s on n ticks
is a sum of cosines with independent normal amplitudes, each of standard deviation s (the discrete
cosine transform is orthogonal: Ahmed, Natarajan, Rao, IEEE Trans. Comput. C-23 (1974) 90,
doi:10.1109/T-C.1974.223784). So the response to each of them is one more direction in which a
residual may be off by one standard deviation, as the start state's are. Whatever adds up answers
to slow cosines most; how many matter is asked of the model itself: cosines are added until one draw
of all the faster ones moves the residual by far less than its own noise. An imposed position whose
noise a stiff load cell sees answers to the fastest most: what is left of these is taken as white.
Where noise remembers (`colour`), its cosines are as large as its spectral density says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import idct

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.plants.plant import Drive

_FIRST = 8
_FURTHER = 1.5
"""Factor by which the number of cosines grows while the faster ones still show."""
SHOWS = 0.02
"""Square of what faster cosines may move a residual by, as a share of one channel's noise."""
_FASTEST = 125.0
"""Frequency of the fastest cosine, Hz: masses on oil swing slower, and each takes a simulation.
What shows beyond it counts as white noise of the channel in that window."""
_NEAR = 0.03
"""Change of a parameter up to which the responses are kept: they are off by as little."""
_REACH = 2.0
"""Amplitude at which a cosine is simulated: a compromise as that of a start state's spread."""

Residuals = Callable[[Sequence[Drive]], list[FloatArray]]
"""Returns the residual of a window under each of several drives, (N,), weighted by its noise."""


@dataclass(frozen=True)
class InputNoise:
    """What the noise of a window's inputs does to its residual.

    Attributes:
        columns: (N, k) change by each cosine, its amplitude one standard deviation.
        vector: parameters at which that was simulated.
        simulations: how many it took.
        faster: (N,) change by one draw of all cosines that are no column, 0 where they do not show.
    """

    columns: FloatArray
    vector: FloatArray
    simulations: int
    faster: FloatArray

    def is_near(self, vector: FloatArray) -> bool:
        """Whether responses at other parameters are the same but for some percent."""
        most = _NEAR * np.maximum(np.abs(vector), np.abs(self.vector))
        return bool((np.abs(vector - self.vector) <= most).all())

    def reweighted(self, ratio: FloatArray) -> InputNoise:
        """Return the same for a residual that is multiplied row by row, (N,)."""
        return replace(self, columns=self.columns * ratio[:, None], faster=self.faster * ratio)


def input_noise_of(
    drive: Drive,
    noise: Mapping[str, float],
    colours: Mapping[str, Colour],
    vector: FloatArray,
    residuals: Residuals,
) -> InputNoise:
    """Return what the noise of all measured inputs does to a window's residual.

    Args:
        drive: of the window. noise: input -> standard deviation, SI.
        colours: input -> colour of its noise, where it is not white. vector: of the plant.
        residuals: of the window.
    """
    (base,) = residuals([drive])
    columns: list[FloatArray] = []
    faster = np.zeros(base.size)
    simulations = 1
    ticks = drive.time.size - drive.first
    for name, sigma in noise.items():
        colour = colours.get(name)
        sizes = sigma * (colour.amplitudes(ticks) if colour else np.ones(ticks))
        own, left, count = _responses(drive, name, sizes, base, residuals)
        columns += own
        faster += left
        simulations += count
    together = np.array(columns).reshape(len(columns), base.size).T
    return InputNoise(together, vector, simulations, faster)


def _responses(
    drive: Drive, name: str, sizes: FloatArray, base: FloatArray, residuals: Residuals
) -> tuple[list[FloatArray], FloatArray, int]:
    """Return the changes by the cosines of one input that show, by one draw of the others, (N,).

    And how many were simulated.
    """
    ticks = sizes.size
    seconds = float(drive.time[-1] - drive.time[drive.first])
    most = min(max(_FIRST, round(2.0 * _FASTEST * seconds)), ticks)
    numbers, draw = np.arange(ticks), np.random.default_rng(0).standard_normal(ticks)
    # signs alone: their squares are those of all draws on average
    signs = np.where(draw < 0.0, -1.0, 1.0)

    def by(amplitudes: FloatArray) -> Drive:
        values = drive.inputs[name].copy()
        values[drive.first :] += idct(sizes * amplitudes, norm="ortho")
        return replace(drive, inputs={**drive.inputs, name: values})

    columns: list[FloatArray] = []
    simulations = 0
    count = min(_FIRST, most)
    while True:
        asked = [by(np.where(numbers == k, _REACH, 0.0)) for k in range(len(columns), count)]
        if count < ticks:
            # one draw of all the faster ones is simulated with them
            fast = signs if count == most else draw
            asked.append(by(np.where(numbers < count, 0.0, fast)))
        simulations += len(asked)
        changes = [left - base for left in residuals(asked)]
        columns += [change / _REACH for change in changes[: count - len(columns)]]
        left = changes[-1] if count < ticks else np.zeros(base.size)
        if float(left @ left) < SHOWS * ticks:
            return columns, np.zeros(base.size), simulations
        if count == most:
            return columns, left, simulations
        count = min(int(count * _FURTHER), most)
