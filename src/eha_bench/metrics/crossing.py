"""Where a response crosses a level: by local polynomials in noise, between samples without."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.budget import Budget
from eha_bench.metrics.coverage import between, coverage_factor, type_a
from eha_bench.metrics.local import LocalFit, fit, half_width, holds_around, through
from eha_bench.metrics.noise import Noise
from eha_bench.metrics.polynomial import real_roots

_PLACED = 1.12
"""What the variance of a crossing is larger by than its weights say.

The window is placed where the noise itself puts the crossing; by simulation the errors are 6 %
larger than those of a window at a given place.
"""

SOON = 0.25
"""Share of the step up to which a response may just have set off, with a kink."""

_STILL = 0.05  # of the step: what is no farther may not have set off yet
_MOVED = 3.0  # standard deviations from the initial level: what has moved so far has set off
_KINKED = 1.3  # as 95 % of what lies anywhere between two bounds do not reach them
_FOLLOWED = 1.5  # of the window in which a line is straight: a cubic follows further
_APART = 1.0  # what a cubic may be off by, against how far parabolas are from it ...
_BENT = 1.5  # ... and, times the square of the samples a rise, against how far a straight line is
_NARROWER = (0.6, 0.35)  # of a window: what a cubic in it is compared with
_SAME = 3.0  # standard deviations that both may be apart, else the narrower counts
_FEWEST_A_RISE = 2.0  # samples from 10 to 90 %, below which no polynomial tells where it crossed


@dataclass(frozen=True)
class Crossing:
    """Where a response crosses a level.

    Attributes:
        time: s.
        slope: of the response there, per s.
        variance: of the response's value there, by its noise.
        around: the polynomial it was found with; None between two samples.
        between: s by which interpolation may be off, to either side.
        span: s that the samples it was found with cover.
    """

    time: float
    slope: float
    variance: float
    around: LocalFit | None = None
    between: float = 0.0
    span: float = 0.0

    def budget(self, level: Budget, noise: Noise) -> Budget:
        """Return what moves its time, in s; `level` is the budget of the level that it crosses."""
        own = type_a("noise", self.variance, noise.freedom) + level
        # a response that lies on the level (of a sensor at its end) crosses it at any time
        per_unit = 1.0 / self.slope if self.slope != 0.0 else math.inf
        return own.scaled(per_unit) + between("interpolation", self.between)

    def interval(self, level: Budget, noise: Noise) -> tuple[float, float]:
        """Return where the response cannot be distinguished from the level, at 95 % (s).

        That is the interval by inversion (Fieller), which a curved approach to the level makes
        lopsided; where the polynomial's window ends first, the straight line goes on.
        """
        whole = self.budget(level, noise)
        factor = coverage_factor(whole)
        reach = factor * whole.standard
        low, high = self.time - reach, self.time + reach
        if self.around is None or not math.isfinite(reach):
            return low, high
        local, target = self.around, self.around.value(self.time)
        spread = noise.spread(local.operator)
        others = level.variance + (self.slope * self.between) ** 2 / 3.0

        def near(times: FloatArray) -> BoolArray:
            own = _PLACED * spread.variances(local.powers(times))
            return np.asarray(
                np.abs(local.values(times) - target) <= factor * np.sqrt(own + others)
            )

        first, last = holds_around(local, self.time, near)
        inside = (local.origin - local.scale, local.origin + local.scale)
        return (
            first if first > inside[0] else min(low, first),
            last if last < inside[1] else max(high, last),
        )


def straight(time: FloatArray, values: FloatArray, level: float, index: int) -> Crossing:
    """Return the crossing between samples index - 1 and index by a straight line."""
    span = float(time[index] - time[index - 1])
    rise = float(values[index] - values[index - 1])
    share = (level - float(values[index - 1])) / rise if rise != 0.0 else 1.0
    return Crossing(float(time[index - 1]) + share * span, rise / span, 0.0, span=span)


def between_samples(
    time: FloatArray,
    values: FloatArray,
    level: float,
    index: int,
    noise: Noise,
    first: int,
    samples_a_rise: float,
) -> Crossing:
    """Return the crossing between samples index - 1 and index by a cubic through four samples.

    No sample before `first` is used: at the edge a response has a kink. A cubic is off by about as
    much as the parabolas through three of its four samples are apart from it, or by as much less
    than a straight line as there are more samples in a rise. Of fewer than two samples a rise, the
    response may have crossed anywhere between them.
    """
    line = straight(time, values, level, index)
    start = min(max(index - 2, first, 0), max(time.size - 4, 0))
    here = slice(start, start + 4)
    if samples_a_rise < _FEWEST_A_RISE or start < min(first, index - 1) or time[here].size < 4:
        share = (line.time - float(time[index - 1])) / line.span
        variance = noise.variance(np.array([1.0 - share, share]))
        return Crossing(line.time, line.slope, variance, between=0.5 * line.span, span=line.span)
    cubic = _polynomial_crossing(time[here], values[here], level, line)
    if cubic is None:
        variance = noise.variance(np.array([0.5, 0.5]))
        return Crossing(line.time, line.slope, variance, between=0.5 * line.span, span=line.span)
    apart = []
    for part in (slice(start, start + 3), slice(start + 1, start + 4)):
        other = _polynomial_crossing(time[part], values[part], level, line)
        apart.append(abs((line if other is None else other).time - cubic.time))
    variance = noise.variance(_lagrange(time[here], cubic.time))
    if float(values[start]) < _STILL and index + 3 < time.size:
        # there may be a kink just before: what comes after it knows nothing of what was before
        # but hardly after a sample that has moved; far up, two samples later, it may still matter
        moved = level <= SOON and float(values[index - 1]) > _MOVED * noise.sd
        kink = index - 1 if moved else index
        away, later = _kink_crossing(time, values, level, kink, line, cubic.time)
        apart.append(_KINKED * away)
        after = slice(kink, kink + 3)
        variance = max(variance, noise.variance(_lagrange(time[after], later)))
    missed = max(_APART * max(apart), _BENT / samples_a_rise**2 * abs(cubic.time - line.time))
    # of what noise moves, its slope there too; of what lies between samples, no cubic tells more
    noisy = math.sqrt(3.0 * variance) > missed * abs(cubic.slope)
    around = through(time[here], values[here], start) if noisy else None
    return Crossing(cubic.time, cubic.slope, variance, around, missed, line.span)


def _kink_crossing(
    time: FloatArray, values: FloatArray, level: float, kink: int, line: Crossing, place: float
) -> tuple[float, float]:
    """Return how far away a response crosses that has a kink just before sample `kink`, and when.

    Both in s. By the parabola and the cubic through the samples that come after, and as much later
    again as these are apart, up to the sample that is beyond the level.
    """
    beyond = float(time[np.searchsorted(time, line.time)])
    found = []
    for count in (3, 4):
        after = slice(kink, kink + count)
        if kink + count <= time.size:
            later = _polynomial_crossing(time[after], values[after], level, line)
            if later is not None and later.time <= beyond:
                found.append(later.time)
    if not found:
        return 0.0, place
    latest = min(max(found) + (max(found) - min(found)), beyond)
    return max(latest - place, place - min(found)), min(found)


def _polynomial_crossing(
    time: FloatArray, values: FloatArray, level: float, line: Crossing
) -> Crossing | None:
    """Return where the polynomial through all samples crosses, within the line's two samples."""
    scale = float(time[-1] - time[0])
    place = (time - line.time) / scale
    coefficients = np.linalg.solve(np.vander(place), values - level)
    roots = np.roots(coefficients)
    real = roots[np.abs(roots.imag) < 1e-9].real * scale + line.time
    inside = real[np.abs(real - line.time) <= line.span]
    if inside.size == 0:
        return None
    at = float(inside[np.argmin(np.abs(inside - line.time))])
    slope = float(np.polyval(np.polyder(coefficients), (at - line.time) / scale)) / scale
    return Crossing(at, slope, 0.0) if slope * line.slope > 0.0 else None


def _lagrange(time: FloatArray, at: float) -> FloatArray:
    """Return the weight of every sample in the polynomial through all of them at a time."""
    scale = float(time[-1] - time[0])
    powers = np.vander((time - at) / scale, increasing=True)
    weights: FloatArray = np.linalg.inv(powers)[0]
    return weights


def refined_crossing(
    time: FloatArray,
    values: FloatArray,
    level: float,
    guess: Crossing,
    noise: Noise,
    widest: int,
) -> Crossing | None:
    """Return the crossing of a local polynomial near a guess, where it has none, the guess.

    Its window is narrowed until cubics in narrower ones say the same; None where none is narrow
    enough.
    """
    half = half_width(time, values, guess.time, noise, widest, _FOLLOWED)
    local = fit(time, values, guess.time, half + 1, 3)
    while True:
        found = _at(local, level, guess, noise)
        missed = 0.0
        for part in _NARROWER:
            narrower = max(int(part * half), 1)
            other = fit(time, values, guess.time, narrower + 1, 3)
            difference, sd = local.apart(other, found.time, noise)
            missed = max(missed, difference**2 - 2.0 * sd**2)
            if abs(difference) > _SAME * sd:
                break
        else:
            return replace(found, between=math.sqrt(missed) / max(abs(found.slope), 1e-300))
        if narrower == 1:
            return None
        half, local = narrower, other


def _at(local: LocalFit, level: float, guess: Crossing, noise: Noise) -> Crossing:
    """Return the crossing of a polynomial nearest to a guess; the guess where it has none."""
    shifted = local.coefficients.copy()
    shifted[0] -= level
    real = [x for x in real_roots(shifted) if abs(x) <= 1.0]
    same = [x for x in real if local.slope(local.origin + x * local.scale) * guess.slope > 0.0]
    place = local.origin + float(min(same, key=abs)) * local.scale if same else guess.time
    weights = local.powers(np.array([place]))[0] @ local.operator
    variance = _PLACED * noise.variance(weights)
    span = 2.0 * local.scale
    if not same:
        return Crossing(guess.time, guess.slope, variance, span=span)
    return Crossing(place, local.slope(place), variance, local, span=span)
