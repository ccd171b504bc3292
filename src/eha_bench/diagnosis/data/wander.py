"""A sensor's zero that drifts slowly under its noise: how far, and over which time.

    E[w(t) w(t + T)] = (s noise)^2 exp(-|T| / tau)

A zero that drifts about where it was set: flicker of an amplifier, temperature (an
Ornstein-Uhlenbeck process; the Gauss-Markov bias of IEEE Std 952, annex B). Over a stretch it is a
sum of cosines whose sizes follow its spectral density, each independent of the others: so its few
slow cosines and the noise say what it is, by maximum likelihood, and what it may be (Whittle,
J. R. Stat. Soc. B 15 (1953) 125).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour

LARGEST = 0.5
"""Largest wander in standard deviations of the noise: what is more shows in a log by itself."""
_SLOW, _FAST = 0.2, 10.0
"""Shortest and longest memory, s: what forgets sooner is noise, later an offset."""
_FASTEST = 60.0
"""Angular frequency below which a stretch is looked at, rad/s."""
_FEWEST = 64
"""Least number of cosines, of all stretches together."""
_PLAIN = 25.0
"""Least fall of minus twice the log likelihood: chance makes it once in a hundred thousand."""
_LEAST = 0.1
"""Variance of a cosine, in that of the noise, below which it is left out."""


@dataclass(frozen=True)
class Wander:
    """A zero that wanders.

    Attributes:
        size: standard deviation, in that of the sensor's noise. memory: s until it has forgotten.
    """

    size: float
    memory: float

    def density(self, frequency: FloatArray) -> FloatArray:
        """Return the two-sided spectral density at angular frequencies in rad/s, s."""
        turns = (frequency * self.memory) ** 2
        return np.asarray(2.0 * self.size**2 * self.memory / (1.0 + turns), dtype=np.float64)


@dataclass(frozen=True)
class NoiseStretch:
    """What is left of a channel's readings in a stretch, in its noise.

    Attributes:
        time: (n,) s. left: (n,). colour: of its noise, None where it is white.
    """

    time: FloatArray
    left: FloatArray
    colour: Colour | None


def cosines(time: FloatArray, wander: Wander) -> FloatArray:
    """Return the cosines that a wandering zero is made of over a stretch, (n, k), in its noise.

    Each times an independent standard normal number.
    """
    span = _span(time)
    frequency = _frequencies(span)
    variance = _variance(wander, frequency, np.full(frequency.size, span))
    keep = np.flatnonzero(variance > _LEAST * _tick(time))
    return _waves(time, frequency[keep], span) * np.sqrt(variance[keep] / span)


def wander_of(stretches: Sequence[NoiseStretch]) -> Wander | None:
    """Return how a channel's zero wanders, or None where it may as well stand.

    Args:
        stretches: in which a model leaves nothing else; the mean of all of them is not asked.
    """
    lines = _spectrum(stretches)
    if lines.squares.size < _FEWEST:
        return None

    def read(free: FloatArray) -> tuple[float, Wander]:
        memory = float(np.clip(np.exp(free[2]), _SLOW, _FAST))
        return float(np.exp(free[0])), Wander(float(np.exp(free[1])), memory)

    def cost(variance: FloatArray) -> float:
        return float(np.sum(np.log(variance) + lines.squares / variance))

    def cost_of(free: FloatArray) -> float:
        level, wander = read(free)
        slow = _variance(wander, lines.frequency, lines.span)
        return cost(level * lines.white + slow / lines.tick)

    start = np.log([1.0, 0.2, 1.0])
    done = minimize(cost_of, start, method="Nelder-Mead", options={"maxiter": 400})
    _, wander = read(np.asarray(done.x, dtype=np.float64))
    stands = cost(float(np.mean(lines.squares / lines.white)) * lines.white)
    if stands - float(done.fun) < _PLAIN or wander.size > LARGEST:
        return None
    return wander


def _variance(wander: Wander, frequency: FloatArray, span: FloatArray) -> FloatArray:
    """Return the variance of each cosine over a stretch, s: its spectral density.

    A zero that has not forgotten where it was is an offset, and no more than that.
    """
    density = wander.density(frequency)
    offset = np.minimum(density, wander.size**2 * span)
    return np.asarray(np.where(frequency > 0.0, density, offset), dtype=np.float64)


@dataclass(frozen=True)
class _Spectrum:
    """Slow cosines of all stretches, each (k,).

    Attributes:
        squares: of what is left along each. white: what noise makes of them.
        frequency: rad/s. span, tick: of their stretch, s.
    """

    squares: FloatArray
    white: FloatArray
    frequency: FloatArray
    span: FloatArray
    tick: FloatArray


def _spectrum(stretches: Sequence[NoiseStretch]) -> _Spectrum:
    usable = [item for item in stretches if item.time.size >= 8 * _frequencies_of(item).size]
    # an offset of all of them is the effect of that name
    mean = float(np.mean(np.concatenate([item.left for item in usable]))) if usable else 0.0
    parts = [np.zeros((5, 0))]
    for item in usable:
        frequency, size = _frequencies_of(item), item.time.size
        span = _span(item.time)
        waves = _waves(item.time, frequency, span)
        waves /= np.linalg.norm(waves, axis=0)
        white = np.ones(size) if item.colour is None else item.colour.amplitudes(size)
        parts.append(
            np.stack([
                (waves.T @ (item.left - mean)) ** 2, white[: frequency.size] ** 2, frequency,
                np.full(frequency.size, span), np.full(frequency.size, _tick(item.time)),
            ])
        )  # fmt: skip
    return _Spectrum(*np.hstack(parts))


def _frequencies_of(item: NoiseStretch) -> FloatArray:
    return _frequencies(_span(item.time))


def _frequencies(span: float) -> FloatArray:
    """Return the angular frequencies of the slow cosines over a time, rad/s."""
    count = 1 + int(span * _FASTEST / np.pi)
    return np.asarray(np.arange(count) * np.pi / span, dtype=np.float64)


def _waves(time: FloatArray, frequency: FloatArray, span: float) -> FloatArray:
    """Return cosines over a stretch, (n, k), whose mean square is 1 (of no frequency: also 1)."""
    waves = np.cos(np.outer(time - time[0] + 0.5 * (span - (time[-1] - time[0])), frequency))
    return np.asarray(np.where(frequency > 0.0, np.sqrt(2.0), 1.0) * waves, dtype=np.float64)


def _tick(time: FloatArray) -> float:
    return float(np.median(np.diff(time)))


def _span(time: FloatArray) -> float:
    """Return the time that a stretch's samples stand for, s."""
    return float(time[-1] - time[0]) + _tick(time)
