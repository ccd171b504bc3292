"""Trials that ask for whatever the recording's own reference did."""

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics import score
from eha_bench.metrics.recorded import bind

RECORDED = Trial("any", FromRecording(), ControlMode.PRESSURE, Setup(), 86_400.0)
TIME = np.arange(3000) / 1000.0


def recording(reference: np.ndarray, measured: np.ndarray, start: float = 0.0) -> Recording:
    return Recording(
        TIME + start, {"reference": reference, "pressure_difference": measured}, source="log"
    )


def test_jumps_of_the_reference_become_edges() -> None:
    reference = np.select([TIME < 0.5, TIME < 1.5], [0.0, 10e6], 4e6)
    measured = np.where(
        TIME < 1.5,
        10e6 * (1 - np.exp(-np.maximum(TIME - 0.5, 0) / 0.02)),
        4e6 + 6e6 * np.exp(-np.maximum(TIME - 1.5, 0) / 0.02),
    )
    log = recording(reference, measured, start=7.25)
    _, trial = bind(log, RECORDED)
    assert [(round(e.time, 9), e.before, e.after) for e in trial.signal.edges] == [
        (0.5, 0.0, 10e6), (1.5, 10e6, 4e6),
    ]  # fmt: skip
    rise = next(s for s in score(log, RECORDED) if s.metric == "rise_time")
    assert rise.value == pytest.approx(0.02 * np.log(9), rel=0.01)


def test_a_sine_becomes_a_tone() -> None:
    reference = 14e6 + 14e6 * np.sin(2 * np.pi * 6.7 * TIME)
    measured = 14e6 + 12e6 * np.sin(2 * np.pi * 6.7 * TIME - 0.4)
    found = {s.metric: s.value for s in score(recording(reference, measured), RECORDED)}
    assert found["amplitude_ratio"] == pytest.approx(12 / 14, rel=1e-3)
    assert found["phase_lag"] == pytest.approx(0.4, abs=1e-3)


def test_anything_else_is_scored_for_tracking_only() -> None:
    reference = np.cumsum(np.random.default_rng(0).standard_normal(TIME.size)) * 1e4
    found = {s.metric: s for s in score(recording(reference, reference + 2e5), RECORDED)}
    assert found["tracking_rms"].value == pytest.approx(2e5, rel=1e-6)
    assert "rise_time" not in found
    assert "amplitude_ratio" not in found


def test_without_a_reference_every_score_says_so() -> None:
    log = Recording(TIME, {"pressure_difference": np.zeros_like(TIME)})
    scores = score(log, Trial(**{**vars(RECORDED), "scores": (("rise_time", ""),)}))
    named = [s for s in scores if s.channel]
    assert {s.metric for s in named} >= {"rise_time", "tracking_rms"}
    assert all(np.isnan(s.value) and "reference" in s.measure.reason for s in named)
