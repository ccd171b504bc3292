"""What lies between the harmonics of a record of whole periods: noise, and a transient that decays.

A record of P periods has P - 1 free lines between two harmonics. Noise is as strong on the line of
the fundamental as on its neighbours, and a transient's spectrum is smooth over them, while the
fundamental has one line alone. A transient that decays is a rational function of frequency, of one
pole nearby (T. McKelvey, G. Guerin, IFAC Proceedings 45, 2012,
doi:10.3182/20120711-3-BE-2027.00394; for polynomials R. Pintelon et al., Mech. Systems and Signal
Processing 24, 2010, doi:10.1016/j.ymssp.2009.08.009):

    Z(k) = (b_0 + b_1 x) / (1 + a x),    x = (k - P) / P.

b_0 is what it adds to the fundamental. Whether the lines show one, beyond what earlier periods say
of it (`ringing`), is not decided, but averaged over: both answers count by Akaike's weights, and
how far they are apart counts as uncertainty (S. T. Buckland, K. P. Burnham, N. H. Augustin,
Biometrics 53, 1997, doi:10.2307/2533961).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import ComplexArray, FloatArray, IndexArray
from eha_bench.metrics.ringing import Ringing

_LINES = 12  # nearest to the fundamental
_FEWEST = 5  # lines that a transient can be fitted to
_PARAMETERS = 6.0  # real ones of a transient
_SLOPES = np.linspace(0.0, 2.5, 11)  # noise may fall with frequency to these powers
_SLOPE_COSTS = 6.0  # degrees of freedom, by simulation
_CHOSEN = 1.04  # what variances are larger by, as the same lines tell the power and what is likely
_NEAR = 2.5  # times the fundamental: noise beyond follows another power of frequency
_PART = 16384  # samples at a time, for the processor's cache


@dataclass(frozen=True)
class BetweenLines:
    """What the free lines say of the line of the fundamental.

    Attributes:
        transient: phasor that a transient adds to the fundamental.
        transient_variance: of each part of `transient`.
        variance: of each part of a phasor, by noise.
        freedom: degrees of freedom of the variances (0: no free line).
    """

    transient: complex
    transient_variance: float
    variance: float
    freedom: float


def between_lines(
    time: FloatArray,
    residual: FloatArray,
    frequency: float,
    periods: int,
    highest: int,
    expected: Sequence[Ringing] = (),
) -> list[BetweenLines]:
    """Return what lies under the fundamental of each of k channels.

    Args:
        time: (n,) s, over whole periods.
        residual: (n, k) without offset, fundamental and harmonics.
        frequency: Hz, of the fundamental.
        periods: of it in the record.
        highest: harmonic that was taken off.
        expected: of the first channels, what earlier periods say of a transient.
    """
    before = [*expected, *[Ringing()] * (residual.shape[1] - len(expected))]
    lines = _free(time.size, periods, highest)
    if lines.size == 0:
        return [BetweenLines(one.phasor, one.sd**2, 0.0, 0.0) for one in before]
    spectra = _phasors(time, residual, frequency / periods, lines)
    return [_under(lines / periods, spectra[:, k], one) for k, one in enumerate(before)]


def _under(ratio: FloatArray, spectrum: ComplexArray, before: Ringing) -> BetweenLines:
    """Return what lies under the fundamental, by lines at (m,) shares of its frequency."""
    near = np.argsort(np.abs(ratio - 1.0), kind="stable")
    near = near[: max(int(np.count_nonzero(ratio <= _NEAR)), _FEWEST - 1)]
    freedom = max(2.0 * near.size - _SLOPE_COSTS, 1.0)
    variance = _CHOSEN * _noise(ratio[near], spectrum[near])
    none = BetweenLines(before.phasor, before.sd**2, variance, freedom)
    fitted = _transient(ratio - 1.0, spectrum) if ratio.size >= _FEWEST else None
    return none if fitted is None else _averaged(none, *fitted)


def _averaged(none: BetweenLines, one: BetweenLines, likelier: float) -> BetweenLines:
    """Return both answers by their weights, `likelier` being twice the logarithm of likelihoods."""
    odds = math.exp(0.5 * min(likelier - 2.0 * _PARAMETERS, 1e3))
    share = odds / (1.0 + odds)
    transient = share * one.transient + (1.0 - share) * none.transient
    variance = share * one.variance + (1.0 - share) * none.variance
    # of each part; the squares of what the two are apart, half to each
    apart = 0.5 * share * (1.0 - share) * abs(one.transient - none.transient) ** 2
    return BetweenLines(
        transient,
        share * one.transient_variance + (1.0 - share) * none.transient_variance + apart,
        variance,
        share * one.freedom + (1.0 - share) * none.freedom,
    )


def _free(samples: int, periods: int, highest: int) -> IndexArray:
    """Return the free lines nearest to the fundamental, in lines of the record."""
    lines = np.arange(1, min((samples - 1) // 2, 4 * periods + 64))
    free = lines[(lines % periods != 0) | (lines > highest * periods)]
    nearest = np.argsort(np.abs(free - periods), kind="stable")[:_LINES]
    return np.sort(free[nearest])


def _phasors(time: FloatArray, values: FloatArray, width: float, lines: IndexArray) -> ComplexArray:
    """Return the phasors (m, k) of (n, k) values on m lines, each a multiple of a width in Hz."""
    found = np.zeros((lines.size, values.shape[1]), dtype=np.complex128)
    for start in range(0, time.size, _PART):
        part = slice(start, start + _PART)
        step = np.exp(-2j * np.pi * width * time[part])
        turn = np.exp(-2j * np.pi * width * float(lines[0]) * time[part])
        place = 0
        for line in range(int(lines[0]), int(lines[-1]) + 1):
            if line == lines[place]:
                # no matrix product: threads cost more than they bring
                found[place] += (turn[:, None] * values[part]).sum(axis=0)
                place += 1
            turn *= step
    return found * (2.0 / time.size)


def _transient(x: FloatArray, spectrum: ComplexArray) -> tuple[BetweenLines, float] | None:
    """Return the transient of one pole, and by how much it is likelier than none; None for none."""
    count = x.size
    weights = np.ones(count)
    for _ in range(3):  # Sanathanan and Koerner: weights of the denominator found before
        design = np.column_stack([np.ones(count), x, -x * spectrum]) * weights[:, None]
        b0, b1, a = np.linalg.lstsq(design, spectrum * weights, rcond=None)[0]
        denominator = 1.0 + a * x
        if np.min(np.abs(denominator)) < 1e-3:
            return None
        weights = 1.0 / np.abs(denominator)
    smooth = (b0 + b1 * x) / denominator
    jacobian = np.column_stack([1.0 / denominator, x / denominator, -x * smooth / denominator])
    free = count - 3
    left = float(np.sum(np.abs(spectrum - smooth) ** 2))
    whole = float(np.sum(np.abs(spectrum) ** 2))
    if not 0.0 < left < whole:
        return None
    inverse = np.linalg.pinv(jacobian.conj().T @ jacobian)
    variance = _CHOSEN * 0.5 * left / free
    share = float(inverse[0, 0].real)
    found = BetweenLines(complex(b0), variance * share, variance, 2.0 * free)
    return found, 2.0 * count * math.log(whole / left)


def _noise(ratio: FloatArray, spectrum: ComplexArray) -> float:
    """Return the variance of each part of the fundamental's phasor by noise.

    `ratio` (k,): frequencies over the fundamental's. Noise that falls with some power of frequency
    is priced at the fundamental; powers count by how likely they make the lines.
    """
    power = np.abs(spectrum) ** 2
    scaled = power[None, :] * ratio[None, :] ** _SLOPES[:, None]
    level = scaled.mean(axis=1)
    if not np.all(level > 0.0):
        return 0.0
    likely = -ratio.size * np.log(level) + _SLOPES * float(np.sum(np.log(ratio)))
    weights = np.exp(likely - likely.max())
    return 0.5 * float(np.sum(weights * level) / np.sum(weights))
