"""A resonance between the points of a frequency response."""

import numpy as np
import pytest

from eha_bench.metrics.bandwidth import ResonanceFrequency, ResonancePeak
from eha_bench.metrics.frequency_response import FrequencyResponse
from eha_bench.metrics.response_point import ResponsePoint

NATURAL, DAMPING = 10.0, 0.2
PEAK = NATURAL * np.sqrt(1.0 - 2.0 * DAMPING**2)
GAIN = 1.0 / (2.0 * DAMPING * np.sqrt(1.0 - DAMPING**2))


def response(frequency):
    s = 1j * frequency / NATURAL
    values = 1.0 / (s * s + 2.0 * DAMPING * s + 1.0)
    return FrequencyResponse(
        tuple(
            ResponsePoint(float(f), complex(g), 2.0 * (1e-6 * abs(g)) ** 2, 20.0, 1.0)
            for f, g in zip(frequency, values, strict=True)
        ),
        (),
        "stepped sine",
        "",
    )


@pytest.mark.parametrize("beyond", [1, 2, 3, 6])
def test_a_resonance_is_found_with_one_point_beyond_it(beyond):
    frequency = np.concatenate([np.geomspace(0.5, 9.4, 16), 10.2 + np.arange(beyond)])
    found = response(frequency)
    assert int(np.argmax(found.gain)) == 15
    assert ResonanceFrequency().of(found).value == pytest.approx(PEAK, rel=2e-3)
    assert ResonancePeak().of(found).value == pytest.approx(GAIN, rel=2e-3)
