"""The gain at low frequency, which bandwidth and resonance are relative to."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.budget import Budget
from eha_bench.metrics.band_interpolation import point_weights
from eha_bench.metrics.coverage import between, type_a
from eha_bench.metrics.frequency_response import FrequencyResponse
from eha_bench.metrics.metric import NotScored

_LOW_BAND = 2.5  # times the lowest frequency: what the gain at 0 Hz is extrapolated from ...
_FEWEST = 5  # ... and as many points at least ...
_WIDEST = 6.0  # ... up to so many times the lowest frequency
_ORDERS = (1, 2, 3)
_PENALTY = 6.0  # per order: noise alone would pass for bend in one case of seventy
_HIDDEN = 0.5  # of the noise of that difference
_VAGUE = 0.1  # of how far extrapolation leads: where it is known to no better, it is not believed
_FAR = 0.2  # of the lowest point's gain: farther away, extrapolation is not believed


def low_frequency_gain(response: FrequencyResponse) -> tuple[float, Budget]:
    """Return the logarithm of the gain extrapolated to 0 Hz, and what moves it.

    1 / |G|^2 is even in frequency: a polynomial in f^2 through the lowest points, of the least
    order that explains them. What the next order would make of it counts as uncertainty of the
    extrapolation. Where that leads far from the lowest point, the lowest
    point stands.
    """
    frequency, gain = response.frequency, response.gain
    if response.left_out and response.left_out[0][0] < 0.5 * frequency[0]:
        raise NotScored(
            "the gain at low frequency is not known: "
            f"{response.left_out[0][0]:.4g} Hz is left out ({response.left_out[0][1]}), "
            f"the lowest frequency that can be relied upon is {frequency[0]:.4g} Hz"
        )
    sd = np.nan_to_num(response.relative_sd)
    freedom = min(point.freedom for point in response.points) or math.inf
    first = float(np.log(max(float(gain[0]), 1e-300)))
    alone = type_a("noise", float(sd[0]) ** 2, freedom)
    count = max(int(np.count_nonzero(frequency <= _LOW_BAND * frequency[0])), _FEWEST)
    count = min(count, int(np.count_nonzero(frequency <= _WIDEST * frequency[0])))
    if count < 3:
        return first, alone
    inverse = (gain[0] / np.maximum(gain[:count], 1e-300)) ** 2
    own = 2.0 * sd[:count] * inverse
    fits = [_at_zero(frequency[:count], inverse, own, order) for order in _ORDERS if order < count]
    chosen = min(range(len(fits)), key=lambda k: fits[k][2])
    operator = fits[chosen][0]
    at_zero = float(operator @ inverse)
    variance = float(np.sum((operator * own) ** 2))
    bend = 0.0
    if chosen + 1 < len(fits):
        # with some of its noise: what that hides of the bend may be there all the same
        difference = fits[chosen + 1][0] - operator
        noise = math.sqrt(float(np.sum((difference * own) ** 2)))
        bend = math.hypot(float(difference @ inverse), _HIDDEN * noise)
    budget = type_a("noise", variance, freedom) + between("interpolation", bend)
    far = abs(at_zero - 1.0)
    if far > _FAR + 3.0 * math.sqrt(variance) and budget.standard > _VAGUE * far:
        if at_zero < _FAR:  # it rises without end, as an integrator's does
            return first, alone
        return first, alone + between("interpolation", 0.5 * abs(math.log(at_zero)))
    half = 0.5 / at_zero
    return first - 0.5 * math.log(at_zero), budget.scaled(half)


def _at_zero(
    frequency: FloatArray, values: FloatArray, sd: FloatArray, order: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return the weights of (n,) values at 0 Hz, the rest, and chi^2 with its penalty."""
    x = (frequency / frequency[-1]) ** 2
    weights = point_weights(sd)
    design = np.vander(x, order + 1, increasing=True)
    operator = np.linalg.pinv(design * weights[:, None]) * weights
    rest = values - design @ (operator @ values)
    floor = np.maximum(sd, 1e-9 * float(np.max(np.abs(values))))
    chi = float(np.sum((rest / floor) ** 2))
    return operator[0], rest, chi + _PENALTY * order
