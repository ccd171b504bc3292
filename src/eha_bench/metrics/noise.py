"""Noise of a recording, estimated where the response is settled, with its correlation.

Intervals are propagated through the autocovariance, not through a standard deviation alone:
filtered sensors and sampled-down drives have noise that is far from white, and an interval that
ignores it is too short by the root of its correlation time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.special import stdtrit

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.metrics.flicker import flicker
from eha_bench.metrics.slow_noise import SlowNoise, slow_noise

_FEWEST = 8
_HIGHEST_ORDER = 12
_LONGEST = 2000
_BLOCKS = 400  # of a window, at most, that what is slow in it is told from
_FEW_LAGS = 40  # up to which adding lag by lag is quicker than a transform
_LEFT = 0.3  # least share of the noise's variance that a fitted line is taken to leave
_SLOW = 0.3  # coefficient of an autoregression below which its bias is no matter
_KNOWN = 2.5
_SLOWEST = 0.99
_BAND = 0.03  # cycles a sample: power at low frequency is looked at up to here ...
_FEWEST_LINES = 4  # ... and on as many lines at least
_DIFFERENCES = 30_000  # of a long series: all would cost a quarter of a scoring
_PENALTY = 4.0  # per coefficient: Akaike's 2 would find correlation in a third of all white noise


@dataclass(frozen=True)
class LinearCovariance:
    """The covariance of k linear functions of the data, (k, k).

    Attributes:
        total: by the whole autocovariance.
        white: by the variance of the samples alone.
    """

    total: FloatArray
    white: FloatArray

    def variance(self, weights: FloatArray) -> float:
        """Return the variance of sum(weights * functions), (k,)."""
        return float(self.variances(weights[None, :])[0])

    def variances(self, weights: FloatArray) -> FloatArray:
        """Return the variance of every row's sum, (m, k) -> (m,)."""
        white = np.sum(weights @ self.white * weights, axis=1)
        if self.total is self.white:
            return np.asarray(white)
        total = np.sum(weights @ self.total * weights, axis=1)
        # the cut-off autocovariance is not positive definite for every weight vector
        found: FloatArray = np.maximum(total, 1e-3 * white)
        return found


@dataclass(frozen=True)
class Noise:
    """Stationary noise.

    Attributes:
        autocovariance: (m,) at lags 0..m-1 samples, in the unit of the data squared.
        freedom: degrees of freedom of the estimate (0: unknown, intervals are NaN).
        slow: the same for what a mean over a long window has of it: noise at low frequency, of
            which a record holds less than of all of it.
        low: power at low frequency over what the autocovariance says of it.
        band: up to which frequency `low` was seen, cycles a sample.
        flickers: whether it is noise of 1 / f.
        means: what noise it may be, for the mean of a window; None where that is clear.
    """

    autocovariance: FloatArray
    freedom: float
    slow: float = math.nan
    low: float = 1.0
    band: float = 0.0
    flickers: bool = False
    means: SlowNoise | None = None

    def __post_init__(self) -> None:
        """Take the slow part for as well known as the whole by default."""
        if math.isnan(self.slow):
            object.__setattr__(self, "slow", self.freedom)

    @cached_property
    def sd(self) -> float:
        """Standard deviation of one sample."""
        return math.sqrt(float(self.autocovariance[0]))

    @property
    def known(self) -> bool:
        """Whether there were enough settled samples to estimate it."""
        return self.freedom > 0

    def variance(self, weights: FloatArray) -> float:
        """Return the variance of sum(weights * data) over consecutive samples."""
        if self.autocovariance.size == 1:
            return float(weights @ weights) * float(self.autocovariance[0])
        return self.spread(weights[None, :]).variance(np.ones(1))

    def spread(self, operator: FloatArray) -> LinearCovariance:
        """Return how operator @ data scatters over consecutive samples, operator (k, n)."""
        white = operator @ operator.T * float(self.autocovariance[0])
        lags = self.autocovariance[: operator.shape[1]]
        if lags.size == 1:
            return LinearCovariance(white, white)
        if lags.size <= _FEW_LAGS:
            total = white.copy()
            for lag in range(1, lags.size):
                pair = operator[:, lag:] @ operator[:, :-lag].T
                total += float(lags[lag]) * (pair + pair.T)
            return LinearCovariance(total, white)
        from scipy.signal import fftconvolve  # slow to import

        kernel = np.concatenate([lags[:0:-1], lags])
        blurred = fftconvolve(operator, kernel[None, :], axes=1)[:, lags.size - 1 :]
        total = operator @ blurred[:, : operator.shape[1]].T
        return LinearCovariance(0.5 * (total + total.T), white)

    def correlation(self, lag: int) -> float:
        """Return the correlation of two samples so many samples apart."""
        if not 0 <= lag < self.autocovariance.size:
            return 0.0
        return float(self.autocovariance[lag] / max(float(self.autocovariance[0]), 1e-300))

    def variance_of_mean(self, count: int) -> float:
        """Return the variance of the mean of `count` consecutive samples."""
        lags = np.arange(1, min(self.autocovariance.size, count))
        pairs = 2.0 * float(np.sum((count - lags) * self.autocovariance[1 : lags.size + 1]))
        white = count * float(self.autocovariance[0])
        seen = min(count * self.band, 1.0)
        return float(self.low**seen) * max(white + pairs, 1e-3 * white) / (count * count)

    def of_mean(self, count: int) -> tuple[float, float]:
        """Return variance and degrees of freedom of the mean of `count` consecutive samples."""
        own = self.variance_of_mean(count), self.slow
        if self.means is None:
            return own
        other = self.means.of_mean(count)
        # the spectrum of a sensor's filter is not among those that it may be
        return other if self.means.decays or _reach(*other) > _reach(*own) else own

    def quantile(self) -> float:
        """Return Student's two-sided 95 % quantile for the degrees of freedom (NaN if unknown)."""
        return float(stdtrit(self.freedom, 0.975)) if self.known else math.nan


def _reach(variance: float, freedom: float) -> float:
    return math.sqrt(variance) * float(stdtrit(freedom, 0.975))


UNKNOWN = Noise(np.zeros(1), 0.0)


@lru_cache(maxsize=64)
def _positions(count: int) -> tuple[FloatArray, float]:
    """Return (count,) places from -1 to 1 and the sum of their squares; windows are often alike."""
    position = np.linspace(-1.0, 1.0, count)
    position.flags.writeable = False
    return position, float(position @ position)


def detrended(segment: FloatArray) -> FloatArray:
    """Return the residual of a straight line fitted to (n,) samples."""
    position, power = _positions(segment.size)
    centred = segment - segment.mean()
    slope = float(position @ centred) / power
    result: FloatArray = centred - slope * position
    return result


def estimate(segments: Sequence[FloatArray]) -> Noise:
    """Return the noise of settled stretches, each freed of its straight line.

    The autocovariance is that of an autoregression by Burg's method, its order by a criterion like
    Akaike's with twice its penalty: on a few dozen samples it loses much less of a long correlation
    than the sample autocovariance does (Broersen, Automatic Autocorrelation and Spectral Analysis,
    2006, doi:10.1007/1-84628-329-9).
    """
    usable = [segment for segment in segments if segment.size >= _FEWEST]
    if not usable:
        return UNKNOWN
    residuals = [detrended(segment) for segment in usable]
    count = sum(residual.size for residual in residuals)
    freedom = float(count - 2 * len(residuals))
    variance = sum(float(residual @ residual) for residual in residuals) / freedom
    if not variance > 0.0:
        return Noise(np.zeros(1), freedom)
    coefficients = _burg(residuals, count)
    if coefficients.size == 0:
        return Noise(np.array([variance]), freedom)
    length = count / len(residuals)
    model = _unbiased(coefficients, length)
    correlation = _correlation(model)
    # what correlation costs: as many independent samples as have the same squared spread
    squares = 1.0 + 2.0 * float(np.sum(correlation[1:] ** 2))
    # a line fitted to correlated noise takes more of its variance away than two samples' worth
    at_zero = 1.0 + 2.0 * float(np.sum(correlation[1:]))
    mean = max(at_zero, 1.0)
    variance *= 1.0 / max(1.0 - 2.0 * mean / length, _LEFT) * freedom / count
    # the noise at frequency 0, sd^2 / (1 - a)^2 of an autoregression of first order, is known as
    # well as a is: var(a) = (1 - a^2) / n, so var(log) = 4 (1 + a) / ((1 - a) n) = 2 / freedom,
    # which a's own error in it makes a little less
    slow = min(freedom, max(count / (_KNOWN * mean), 1.0))
    low, band, lines = _low(residuals, model, variance * at_zero)
    if lines:
        slow = min(slow, 2.0 * lines)
    found = Noise(variance * correlation, max(freedom / squares, 2.0), slow, low, band)
    rising = flicker(residuals, coefficients)
    if rising is None:
        return found
    other = Noise(
        rising.autocovariance,
        max(freedom / 2.0, 2.0),
        min(freedom, rising.freedom),
        flickers=True,
    )
    # what still rings is not noise of 1 / f: that adds to a mean's variance, and takes nothing off
    window = round(length)
    slower = other.variance_of_mean(window) > found.variance_of_mean(window)
    return other if slower else found


def with_means(noise: Noise, segments: Sequence[FloatArray]) -> Noise:
    """Return noise with what it may be besides, by settled stretches, where it is slow."""
    usable = [segment for segment in segments if segment.size >= _FEWEST]
    if not usable:
        return noise
    # of long windows, means over blocks tell as much of what is slow, and quicker
    block = math.ceil(max(segment.size for segment in usable) / _BLOCKS)
    whole = [segment for segment in usable if segment.size // block >= _FEWEST]
    residuals = [detrended(means_over(segment, block)) for segment in whole]
    if not math.fsum(float(residual @ residual) for residual in residuals) > 0.0:
        return noise
    coefficients = _burg(residuals, sum(residual.size for residual in residuals))
    return replace(noise, means=slow_noise(residuals, coefficients, block))


def means_over(values: FloatArray, block: int) -> FloatArray:
    """Return the means of (n,) values over blocks, what is left over at the start not used."""
    left = values.size % block
    return values if block == 1 else np.asarray(values[left:].reshape(-1, block).mean(axis=1))


def _low(
    residuals: Sequence[FloatArray], coefficients: FloatArray, at_zero: float
) -> tuple[float, float, int]:
    """Return power at low frequency over the model's, the band it was seen in, and its lines.

    A sensor's filter leaves noise that no short autoregression follows down to frequency 0. What is
    there is taken from the periodogram of the model's residuals (prewhitening: D. W. K. Andrews,
    J. C. Monahan, Econometrica 60, 1992, doi:10.2307/2951574): as if the residuals were white
    there, or as if the noise itself were; which of them holds is not known, and the larger counts.
    A line that was fitted before has taken 3 / (pi j)^2 of line j away.
    """
    if not at_zero > 0.0:
        return 1.0, 0.0, 0
    whitening = np.concatenate([[1.0], -coefficients])
    power, lines, band = np.zeros(2), 0, 0.0
    for residual in residuals:
        white = np.convolve(residual, whitening, "valid")
        count = max(round(_BAND * white.size), _FEWEST_LINES)
        if white.size < 4 * count:
            continue
        orders = np.arange(1, count + 1)
        spectrum = np.abs(np.fft.rfft(white)[1 : count + 1]) ** 2 / white.size
        spectrum /= 1.0 - 3.0 / (math.pi * orders) ** 2
        turns = np.exp(-2j * math.pi / white.size * np.outer(orders, np.arange(whitening.size)))
        gains = np.abs(turns @ whitening) ** 2
        power += np.sum(spectrum) / np.sum(whitening) ** 2, np.sum(spectrum / gains)
        lines += count
        band = max(band, count / white.size)
    if lines == 0:
        return 1.0, 0.0, 0
    return float(power.max()) / lines / at_zero, band, lines


def _unbiased(coefficients: FloatArray, length: float) -> FloatArray:
    """Return an autoregression whose slowest pole is as slow as it was before the line was fitted.

    A coefficient estimated from n samples about a fitted line is too small by (2 + 4 a) / n on
    average (M. G. Kendall, Biometrika 41, 1954; a line instead of a mean doubles its constant).
    """
    poles = np.roots(np.concatenate([[1.0], -coefficients]))
    slowest = poles[int(np.argmax(np.abs(poles)))]
    if abs(slowest.imag) > 1e-6 or slowest.real < _SLOW:
        return coefficients
    true = min((slowest.real * length + 2.0) / (length - 4.0), _SLOWEST)
    scale = max(true / slowest.real, 1.0)
    stretched: FloatArray = coefficients * scale ** np.arange(1, coefficients.size + 1)
    return stretched


def _burg(residuals: Sequence[FloatArray], count: int) -> FloatArray:
    """Return the coefficients of the best autoregression x[k] = sum a[i] x[k-1-i] + e.

    All stretches lie in one array; what has no neighbour in its own stretch is 0.
    """
    stops = np.cumsum([residual.size for residual in residuals]).tolist()
    starts = [0, *stops[:-1]]
    forward = np.concatenate(residuals)
    backward, later = np.empty_like(forward), np.empty_like(forward)
    backward[1:] = forward[:-1]
    power = float(forward @ forward) / count
    for start in starts:
        forward[start] = backward[start] = 0.0
    reflections: list[float] = []
    best, lowest = 0, count * math.log(power)
    for order in range(1, max(1, min(_HIGHEST_ORDER, count // 10)) + 1):
        energy = float(forward @ forward) + float(backward @ backward)
        if not energy > 0.0:
            break
        reflection = 2.0 * float(forward @ backward) / energy
        reflections.append(reflection)
        power *= 1.0 - reflection**2
        if not power > 0.0:
            break
        np.subtract(backward[:-1], reflection * forward[:-1], out=later[1:])
        forward -= reflection * backward
        backward, later = later, backward
        for start, stop in zip(starts, stops, strict=True):
            backward[start] = 0.0
            if start + order < stop:
                forward[start + order] = 0.0
        penalty = _PENALTY * order * count / max(count - order - 2, 1)
        if count * math.log(power) + penalty < lowest:
            best, lowest = order, count * math.log(power) + penalty
    coefficients = np.zeros(0)
    for reflection in reflections[:best]:
        coefficients = np.concatenate(
            [coefficients - reflection * coefficients[::-1], [reflection]]
        )
    return coefficients


def _correlation(coefficients: FloatArray) -> FloatArray:
    """Return the autocorrelation of an autoregression, until it has died out."""
    from scipy.signal import fftconvolve, lfilter  # slow to import

    poles = np.abs(np.roots(np.concatenate([[1.0], -coefficients])))
    slowest = min(float(poles.max()), 0.999)
    length = min(_LONGEST, 8 + int(math.log(1e-4) / math.log(max(slowest, 0.1))))
    impulse = np.zeros(2 * length)
    impulse[0] = 1.0
    response = lfilter([1.0], np.concatenate([[1.0], -coefficients]), impulse)
    covariance = fftconvolve(response, response[::-1])[2 * length - 1 :][:length]
    result: FloatArray = covariance / covariance[0]
    return result


def white_noise(values: FloatArray) -> float:
    """Return the standard deviation of the white part of (n,) samples, from third differences.

    The median absolute difference is blind to jumps; differencing is blind to what is smooth. Of a
    long series, `_DIFFERENCES` of them are enough: their median knows the deviation to 0.7 %.
    """
    if values.size < 8:
        return 0.0
    if values.size > 2 * _DIFFERENCES:
        places = _scattered_places(values.size - 3)
        # in the order of sums that numpy.diff has
        first, second, third, last = (values[places + k] for k in range(4))
        middle = third - second
        apart = ((last - third) - middle) - (middle - (second - first))
    else:
        apart = np.diff(values, 3)
    return _median(np.abs(apart, out=apart)) / (0.6744897501960817 * math.sqrt(20.0))


@lru_cache(maxsize=4)
def _scattered_places(count: int) -> IndexArray:
    """Return places in 0 to `count`, evenly spread, that no period of a signal falls in with.

    Multiples of the golden ratio modulo 1 (L. Kuipers and H. Niederreiter, Uniform Distribution of
    Sequences, Wiley 1974, chapter 2.3).
    """
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    return np.sort((np.arange(_DIFFERENCES) * golden % 1.0 * count).astype(np.intp))


def _median(values: FloatArray) -> float:
    """Return the median of (n,) values as `numpy.median` does, at the cost of one partition."""
    half = values.size // 2
    values = np.partition(values, half)
    upper, largest = float(values[half]), float(values[half:].max())
    if math.isnan(largest):
        return math.nan
    return upper if values.size % 2 else 0.5 * (float(values[:half].max()) + upper)
