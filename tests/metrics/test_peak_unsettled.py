"""A peak is scored also where the response never settles."""

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics import score

TRIAL = Trial("any", FromRecording(), ControlMode.PRESSURE, Setup(), 86_400.0)
TIME = np.arange(1000) / 1000.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_peak_of_a_drifting_response_is_its_farthest_excursion(sign: float) -> None:
    after = np.maximum(TIME - 0.1, 0.0)
    # rises to 12 MPa at 0.3 s (a parabola), falls ever after: no final level
    measured = sign * np.where(TIME < 0.1, 0.0, 12e6 - 300e6 * (after - 0.2) ** 2)
    noise = 3e4 * np.random.default_rng(1).standard_normal(TIME.size)
    log = Recording(
        TIME,
        {
            "reference": np.where(TIME < 0.1, 0.0, sign * 10e6),
            "pressure_difference": np.where(TIME < 0.5, measured, measured[500])
            + noise
            - sign * 8e6 * np.maximum(TIME - 0.5, 0.0),
        },
    )
    found = {s.metric: s for s in score(log, TRIAL)}
    assert np.isnan(found["rise_time"].value)
    assert found["peak"].value == pytest.approx(sign * 12e6, abs=6e4)
    assert found["peak"].measure.low <= found["peak"].value <= found["peak"].measure.high
    assert "not settled" in found["peak"].measure.reason


def test_a_clipped_peak_of_a_drifting_response_is_open() -> None:
    after = np.maximum(TIME - 0.1, 0.0)
    measured = np.where(TIME < 0.1, 0.0, 12e6 - 300e6 * (after - 0.2) ** 2)
    noise = 3e4 * np.random.default_rng(1).standard_normal(TIME.size)
    values = np.where(TIME < 0.5, measured, measured[500]) + noise - 8e6 * np.maximum(TIME - 0.5, 0)
    log = Recording(
        TIME,
        {
            "reference": np.where(TIME < 0.1, 0.0, 10e6),
            "pressure_difference": np.minimum(values, 11e6),
        },
    )
    found = {s.metric: s.measure for s in score(log, TRIAL)}["peak"]
    assert found.low < 11e6 < found.high == np.inf
    assert "at least this" in found.reason
