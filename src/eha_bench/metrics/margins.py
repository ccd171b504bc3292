"""Gain and phase margin of a loop, from its closed-loop frequency response.

A loop that compares the reference with the measurement has T = L / (1 + L) from reference to
measurement, so L = T / (1 - T), and 1 / L = 1 / T - 1, which is interpolated: for poles without
zeros its real part is a polynomial of f^2, and its imaginary part over f as well. What a controller
adds on other ways (feedforward, inner loops) is part of this L: the margins are those of the loop
with unity feedback that answers the same way. They can be estimated only where the reference
excited the loop at its crossover, and the points there are reliable.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray, IndexArray
from eha_bench.core.metric import Better, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial
from eha_bench.metrics.band_interpolation import Local, band_quantile, local_cubic
from eha_bench.metrics.bandwidth import BandMetric
from eha_bench.metrics.frequency_response import FrequencyResponse
from eha_bench.metrics.metric import NotScored


@dataclass(frozen=True)
class InverseLoop:
    """1 / L near a frequency, by local cubics in f^2.

    Attributes:
        guess: Hz, where they were fitted.
        real: its real part.
        turned: its imaginary part over f / guess.
        sd: (n,) standard deviation of either part, at the response's points.
        ratio: (n,) frequencies over `guess`.
        quantile: Student's, two-sided 95 %.
    """

    guess: float
    real: Local
    turned: Local
    sd: FloatArray
    ratio: FloatArray
    quantile: float

    def value(self, x: float) -> complex:
        """Return 1 / L at f^2 = x guess^2."""
        return complex(float(self.real.value(x)), math.sqrt(x) * float(self.turned.value(x)))

    def slope(self, x: float) -> complex:
        """Return its derivative with respect to x."""
        step = 1e-5 * x
        return (self.value(x + step) - self.value(x - step)) / (2.0 * step)

    def variances(self, x: float) -> tuple[float, float]:
        """Return the variance of the real and of the imaginary part."""
        real = np.sum((self.real.weights(x) * self.sd[self.real.chosen]) ** 2)
        scaled = self.sd[self.turned.chosen] / self.ratio[self.turned.chosen]
        turned = np.sum((self.turned.weights(x) * scaled) ** 2)
        return self.real.misfit * float(real), self.turned.misfit * x * float(turned)


@dataclass(frozen=True)
class StabilityMargin:
    """A margin at a crossover: value with the reach of its interval, and the frequency in Hz."""

    value: float
    reach: float
    frequency: float


class MarginMetric(BandMetric):
    """Scores the loop that the reference is the command of; its least margin is reported."""

    by_default = False
    symbol: str

    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the margin; only the channel that should follow the reference closes the loop."""
        if channel != trial.channel:
            raise NotScored(f"{channel} is not what the reference asks for ({trial.channel} is)")
        return super().measure(recording, trial, channel)

    def of(self, response: FrequencyResponse) -> Measure:
        """Return the margin nearest to instability over all crossovers."""
        inverse = 1.0 / response.response - 1.0
        places = self.crossovers(inverse, response.relative_sd * np.abs(1.0 / response.response))
        every = [self.margin(loop_near(response, int(place)), int(place)) for place in places]
        found = [margin for margin in every if self.counts(margin.value)]
        if not found:
            raise NotScored(
                f"{self.symbol} nowhere between {response.frequency[0]:.4g} and "
                f"{response.frequency[-1]:.4g} Hz{''.join(map(self.other, every))}: "
                "the loop was not excited where it crosses over"
            )
        least = min(found, key=lambda margin: self.distance(margin.value))
        many = f", the least of {len(found)} crossovers" if len(found) > 1 else ""
        return Measure(
            least.value,
            least.value - least.reach,
            least.value + least.reach,
            f"L = T / (1 - T) at {least.frequency:.4g} Hz, where {self.symbol}{many}",
        )

    @abstractmethod
    def crossovers(self, inverse: ComplexArray, sd: FloatArray) -> IndexArray:
        """Return the points before which 1 / L, (n,) with sd (n,) of each part, crosses over."""

    @abstractmethod
    def margin(self, loop: InverseLoop, first: int) -> StabilityMargin:
        """Return the margin where the loop crosses over before point `first`."""

    @abstractmethod
    def distance(self, value: float) -> float:
        """Return what is least for the least margin."""

    def counts(self, value: float) -> bool:
        """Whether a crossover of this margin is one to report."""
        return math.isfinite(value)

    def other(self, margin: StabilityMargin) -> str:
        """Return what to say of a crossover that does not count."""
        return f" ({margin.value:.3g} at {margin.frequency:.4g} Hz)"


class PhaseMargin(MarginMetric):
    """180 degrees less the lag of the loop where its gain is 1, rad; negative is unstable."""

    spec = MetricSpec(
        "phase_margin",
        "phase of the loop above -180 degrees at gain 1",
        "rad",
        better=Better.HIGHER,
    )
    symbol = "|L| = 1"

    def crossovers(self, inverse: ComplexArray, sd: FloatArray) -> IndexArray:
        """Return where the loop's gain falls or rises through 1."""
        return sign_changes(np.abs(inverse) - 1.0, sd)

    def margin(self, loop: InverseLoop, first: int) -> StabilityMargin:
        """Return 180 degrees minus the angle of 1 / L where |1 / L| = 1."""
        x = _zero(loop, first, lambda value: abs(value) - 1.0)
        value, slope = loop.value(x), loop.slope(x)
        angle = math.atan2(value.imag, value.real) % (2.0 * math.pi)
        along = slope / value
        # a gain that is off moves the crossover, and the phase with it
        turn = along.imag / along.real if along.real != 0.0 else math.inf
        part = 1.0 / value
        across = (turn * part.real - part.imag, -turn * part.imag - part.real)
        return _margin(loop, x, math.pi - angle, across)

    def distance(self, value: float) -> float:
        """Return how far the margin is from none."""
        return abs(value)


class GainMargin(MarginMetric):
    """What the gain of the loop may be multiplied by until it oscillates, a ratio above 1.

    A loop with two integrations lags by 180 degrees at low frequency as well, where its gain is
    large: there less gain would be unstable. Such a crossover is not a margin for more.
    """

    spec = MetricSpec(
        "gain_margin", "inverse of the gain of the loop at -180 degrees", better=Better.HIGHER
    )
    symbol = "|L| < 1 with a lag of 180 deg"

    def crossovers(self, inverse: ComplexArray, sd: FloatArray) -> IndexArray:
        """Return where 1 / L crosses the negative real axis."""
        places = sign_changes(inverse.imag, sd)
        behind = inverse.real[places - 1] + inverse.real[places] < 0.0
        return places[behind]

    def margin(self, loop: InverseLoop, first: int) -> StabilityMargin:
        """Return |1 / L| where its imaginary part is 0."""
        x = _zero(loop, first, lambda value: value.imag)
        value, slope = loop.value(x), loop.slope(x)
        shift = slope.real / slope.imag if slope.imag != 0.0 else math.inf
        return _margin(loop, x, abs(value), (1.0, -shift))

    def distance(self, value: float) -> float:
        """Return the margin itself."""
        return value

    def counts(self, value: float) -> bool:
        """Whether more gain would be unstable, and not less."""
        return math.isfinite(value) and value > 1.0

    def other(self, margin: StabilityMargin) -> str:
        """Return that the gain may be lowered, and by what."""
        return f" (at {margin.frequency:.4g} Hz |L| is {1.0 / max(margin.value, 1e-300):.3g})"


def loop_near(response: FrequencyResponse, first: int) -> InverseLoop:
    """Return 1 / L around the middle between point `first` and the one before it."""
    frequency = response.frequency
    guess = math.sqrt(float(frequency[first - 1] * frequency[first]))
    ratio = frequency / guess
    inverse = 1.0 / response.response
    sd = np.nan_to_num(response.relative_sd) * np.abs(inverse)
    real = local_cubic(ratio**2, inverse.real - 1.0, sd)
    turned = local_cubic(ratio**2, inverse.imag / ratio, sd / ratio)
    quantile = band_quantile(response, np.union1d(real.chosen, turned.chosen))
    return InverseLoop(guess, real, turned, sd, ratio, quantile)


def sign_changes(values: FloatArray, sd: FloatArray) -> IndexArray:
    """Return the points (n,) whose value has, beyond two sd (n,), another sign than before."""
    sure = np.flatnonzero(np.abs(values) > 2.0 * np.nan_to_num(sd))
    found = []
    for before, after in zip(sure[:-1].tolist(), sure[1:].tolist(), strict=True):
        if values[before] * values[after] < 0.0:
            same = values[before + 1 : after + 1] * values[after] > 0.0
            found.append(before + 1 + int(np.argmax(same)))
    return np.array(found, dtype=np.intp)


def _zero(loop: InverseLoop, first: int, curve: Callable[[complex], float]) -> float:
    """Return x at which a curve of 1 / L is zero between point `first` and the one before it."""
    grid = np.linspace(float(loop.ratio[first - 1]) ** 2, float(loop.ratio[first]) ** 2, 129)
    heights = np.array([curve(loop.value(float(x))) for x in grid])
    changes = np.flatnonzero(heights[:-1] * heights[1:] <= 0.0)
    if changes.size == 0:  # the cubic passes the zero just outside
        return float(grid[int(np.argmin(np.abs(heights)))])
    at = int(changes[changes.size // 2])
    low, high = float(heights[at]), float(heights[at + 1])
    share = low / (low - high) if low != high else 0.5
    return float(grid[at] + share * (grid[at + 1] - grid[at]))


def _margin(
    loop: InverseLoop, x: float, value: float, across: tuple[float, float]
) -> StabilityMargin:
    """Return a margin; `across` is its derivative by real and imaginary part of 1 / L."""
    real, imaginary = loop.variances(x)
    variance = across[0] ** 2 * real + across[1] ** 2 * imaginary
    reach = loop.quantile * math.sqrt(variance) if math.isfinite(variance) else math.nan
    return StabilityMargin(value, reach, loop.guess * math.sqrt(x))
