"""A real log: the linear drive EMPS, scored by whatever its own reference did."""

import math

import numpy as np
import pytest

from eha_bench.metrics import score
from eha_bench.recordings import read
from eha_bench.suites import load_suite

SUITE = """\
name: emps
trials:
  - id: emps
    mode: piston_position
    sample_rate: 1 kHz
    signal: {kind: recorded}
    scores: [tracking_p95, tracking_rms_lag_compensated, rise_time, amplitude_ratio, energy]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "channels"),
    [
        ("DATA_EMPS.mat", "channels.yaml"),
        ("DATA_EMPS_PULSES.mat", "channels_with_pulses.yaml"),
    ],
)
def test_a_measured_drive_is_scored(shared_data, repository, tmp_path, log, channels):
    (tmp_path / "suite.yaml").write_text(SUITE)
    (trial,) = load_suite(tmp_path / "suite.yaml").trials
    recording = read(
        shared_data / "emps" / log, channels=repository / "examples" / "emps" / channels
    )
    found = {item.metric: item.measure for item in score(recording, trial)}
    error = recording["reference"] - recording["piston_position"]
    assert found["tracking_rms"].value == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-9)
    assert found["tracking_max"].value == pytest.approx(np.max(np.abs(error)), rel=1e-9)
    assert found["tracking_p95"].value == pytest.approx(np.percentile(np.abs(error), 95), rel=1e-9)
    # most of the error is the controller's lag
    assert found["tracking_rms_lag_compensated"].value < 0.2 * found["tracking_rms"].value
    assert found["loop_overruns"].value == 0.0
    for name, reason in {
        "rise_time": "no edge",
        "amplitude_ratio": "no sine",
        "energy": "torque_constant",
    }.items():
        assert math.isnan(found[name].value)
        assert reason in found[name].reason
