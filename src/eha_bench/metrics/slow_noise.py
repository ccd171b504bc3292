"""How far the mean of a window may be off in slow noise, of which a recording shows little.

In noise of correlation 0.97 from sample to sample, a window of a hundred samples holds two
independent ones. The correlation that is estimated from a few such windows is often too small, and
then it also says that it is well known: no degrees of freedom that are taken from the estimate mend
that. So the mean is taken over all noise that it may be, each as likely as the data make it:

    S(f) = s / (|1 - r e^(-i w)|^2 |B(w)|^2),   w = 2 pi f,   for every correlation r, and
    S(f) = s (1 + f_c / f)                                    for every corner f_c,

B the faster part of the autoregression that fits best. Before the data are seen, both kinds are as
likely, as is every r, and every octave of f_c; s is unknown. How likely the data are is Whittle's
likelihood by what the periodogram of a window is expected to be, its straight line removed, rather
than by the spectrum itself, which a short window smears (A. M. Sykulski and others, Biometrika
106, 2019, doi:10.1093/biomet/asy071). Given a kind, the mean divided by its standard deviation has
Student's distribution; all together are a mixture of them, which is summed up by the Student's
distribution with the same 68 and 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import stdtr, stdtrit

from eha_bench.core.arrays import FloatArray

_SLOW = 0.3  # correlation of the slowest part, below which its estimate is good enough
_CORRELATIONS = 16
_CORNERS = 12
_HIGHEST = 50.0  # corner, cycles a sample: no white noise is seen any more
_SLOWEST = 4.0  # windows: what lasts longer is a drift along all of them
_LOWEST = 0.05  # over the length of a window: below, no more power of 1 / f is counted
_FINER = 8  # lines of the model for one of the longest window
_SIZES = np.geomspace(0.02, 50.0, 160)  # of a deviation from the mean, on a scale of its own
_FREEDOMS = np.geomspace(1.0, 400.0, 80)


@dataclass(frozen=True, eq=False)
class SlowNoise:
    """The noise that it may be, k kinds of it.

    Attributes:
        autocovariances: (k, m) at lags 0..m-1 samples.
        weights: (k,) how likely each is, 1 in sum.
        freedom: degrees of freedom of the size of each.
        decays: whether the correlation of its slowest part was left open.
        block: samples whose mean is one lag.
    """

    autocovariances: FloatArray
    weights: FloatArray
    freedom: float
    decays: bool
    block: int = 1

    def of_mean(self, count: int) -> tuple[float, float]:
        """Return variance and degrees of freedom of the mean of `count` consecutive samples."""
        blocks = max(count / self.block, 1.0)
        lags = np.arange(1, min(math.ceil(blocks), self.autocovariances.shape[1]))
        pairs = self.autocovariances[:, 1 : lags.size + 1] @ (blocks - lags)
        variances = (blocks * self.autocovariances[:, 0] + 2.0 * pairs) / (blocks * blocks)
        deviations = np.sqrt(np.maximum(variances, 0.0))
        scale = float(self.weights @ deviations)
        if not scale > 0.0:
            return 0.0, self.freedom
        away = _SIZES / np.maximum(deviations / scale, 1e-9)[:, None]
        within = 2.0 * self.weights @ stdtr(self.freedom, away) - 1.0
        one, two = np.interp((_ONE, 0.95), within, _SIZES)
        freedom = float(np.interp(-two / one, -_ratios(), _FREEDOMS))
        standard = scale * float(two) / float(stdtrit(freedom, 0.975))
        return standard**2, freedom


_ONE = math.erf(math.sqrt(0.5))  # share of a normal distribution within one standard deviation


@cache
def _ratios() -> FloatArray:
    """Return how many times as far 95 % of Student's distributions reach as 68 % do."""
    upper = 0.5 + 0.5 * _ONE
    return np.asarray(stdtrit(_FREEDOMS, 0.975) / stdtrit(_FREEDOMS, upper))


def slow_noise(
    residuals: Sequence[FloatArray], coefficients: FloatArray, block: int = 1
) -> SlowNoise | None:
    """Return what noise it may be where it is correlated; else None.

    Args:
        residuals: (n,) each, of straight lines fitted to settled windows.
        coefficients: (p,) of the autoregression x[k] = sum a[i] x[k-1-i] + e that fits them best.
        block: samples that each residual is the mean of.
    """
    longest = max(residual.size for residual in residuals)
    if coefficients.size == 0:
        return None
    poles = np.roots(np.concatenate([[1.0], -coefficients]))
    place = int(np.argmax(np.abs(poles)))
    decays = abs(poles[place].imag) <= 1e-6 and poles[place].real >= _SLOW
    fixed = np.real(np.poly(np.delete(poles, place) if decays else poles))
    spectra, logs = _kinds(longest, np.atleast_1d(fixed), decays)
    covariances = np.fft.irfft(spectra)[:, :longest]
    powers = np.concatenate([_periodogram(residual) for residual in residuals])
    expected = np.concatenate(
        [_expected_periodogram(covariances, part.size) for part in residuals], axis=1
    )
    expected = np.maximum(expected, 1e-12 * expected.max(axis=1, keepdims=True))
    sizes = np.maximum(np.mean(powers / expected, axis=1), 1e-300)
    logs = logs - powers.size * np.log(sizes) - np.sum(np.log(expected), axis=1)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    likely = weights > 1e-6
    return SlowNoise(
        covariances[likely] * sizes[likely, None],
        weights[likely] / float(weights[likely].sum()),
        2.0 * powers.size,
        decays,
        block,
    )


def _kinds(longest: int, fixed: FloatArray, decays: bool) -> tuple[FloatArray, FloatArray]:
    """Return spectra (k, l), and the logarithm of how likely each is before the data are seen.

    The coefficients of the faster part were fitted to the data, and each counts as a likelihood
    lower by one (H. Akaike, IEEE Trans. AC 19, 1974, doi:10.1109/TAC.1974.1100705).
    """
    length = 2 * next_fast_len(_FINER * longest // 2, real=True)
    lines = np.arange(length // 2 + 1) / length
    gaps = np.ones(1)
    if decays:
        gaps = np.geomspace(1.0 / (_SLOWEST * longest), 1.0 - _SLOW, _CORRELATIONS)
    waves = 4.0 * np.sin(math.pi * lines) ** 2
    slower = gaps[:, None] ** 2 + (1.0 - gaps[:, None]) * waves
    regressions = 1.0 / (slower * np.abs(np.fft.rfft(fixed, length)) ** 2)
    corners = np.geomspace(1.0 / longest, _HIGHEST, _CORNERS)
    flickers = 1.0 + corners[:, None] / np.maximum(lines, _LOWEST / longest)
    # gaps stand at equal ratios: of every correlation as likely as another, each has its own share
    shares = np.concatenate([gaps / gaps.sum(), np.full(_CORNERS, 1.0 / _CORNERS)])
    logs = np.log(0.5 * shares)
    logs[: gaps.size] -= fixed.size - 1
    return np.concatenate([regressions, flickers]), logs


def _periodogram(residual: FloatArray) -> FloatArray:
    """Return the power at every frequency above 0 and below half of the sample rate."""
    lines = (residual.size - 1) // 2
    found: FloatArray = np.abs(np.fft.rfft(residual)[1 : lines + 1]) ** 2 / residual.size
    return found


def _expected_periodogram(covariances: FloatArray, count: int) -> FloatArray:
    """Return what the periodogram of `count` samples less their line is expected to be, (k, j).

    With autocovariances (k, m), C their matrix, e_j the waves, and q the line of norm 1: power is
    |e_j' (1 - q q') x|^2 / n, so e_j' C e_j - 2 Re((q' e_j)* q' C e_j) + |q' e_j|^2 q' C q over n.
    """
    lines = slice(1, (count - 1) // 2 + 1)
    own = covariances[:, :count]
    tapered = own * (1.0 - np.arange(own.shape[1]) / count)
    power = 2.0 * np.fft.rfft(tapered, count, axis=1).real[:, lines] - tapered[:, :1]
    line = np.linspace(-1.0, 1.0, count)
    line /= math.sqrt(float(line @ line))
    around = np.zeros((own.shape[0], 2 * count))
    around[:, : own.shape[1]] = own
    around[:, -1 : -own.shape[1] : -1] = own[:, 1:]
    product = np.fft.rfft(around, axis=1) * np.fft.rfft(line, 2 * count)
    spread = np.fft.irfft(product, 2 * count, axis=1)[:, :count]
    waves = np.fft.rfft(line)[lines]
    crossed = (np.conj(waves) * np.fft.rfft(spread, axis=1)[:, lines]).real
    rest = np.abs(waves) ** 2 * (spread @ line)[:, None] - 2.0 * crossed
    return np.asarray(power + rest / count)
