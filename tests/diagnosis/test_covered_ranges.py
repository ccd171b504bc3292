"""Where recordings have been, and whether machines were at rest where they begin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.outcome.covered_ranges import covered_ranges
from eha_bench.posterior.covered import Covered

TIME = np.arange(0.0, 2.0, 0.002)
SLOW = 6.0 + 3.0 * np.sin(2.0 * np.pi * 0.5 * TIME)
FOLLOWED = 1.4e6 * SLOW


@pytest.mark.parametrize(
    ("command", "pressure", "at_rest"),
    [
        (SLOW, FOLLOWED * (1.0 - np.exp(-TIME / 0.02)), False),  # what drives it had been off
        (SLOW, FOLLOWED, True),
        # what moves is what the command asks for
        (np.where(TIME < 0.05, 0.0, SLOW), np.where(TIME < 0.05, 0.0, FOLLOWED), True),
        (np.full(TIME.size, 6.0), np.full(TIME.size, 8.4e6), True),
    ],
)
def test_a_recording_that_moves_at_once_did_not_begin_at_rest(
    command: np.ndarray, pressure: np.ndarray, at_rest: bool
) -> None:
    values = pressure[:, None]
    recording = Recording(TIME, {})
    supply = 7e6 + 1e4 * np.random.default_rng(1).standard_normal(TIME.size)
    inputs = {"current_command": command, "supply_pressure": supply}
    run = Run("a", Path("a.mcap"), None, True, False, Use.TRAIN, lambda: recording)
    measured = Measured(run, TIME, inputs, ("pressure_a",), values, np.isfinite(values))
    found = covered_ranges([measured], {"pressure_a": 2e4}, {})
    assert found.setups[0].at_rest is at_rest
    assert found.setups[0].starts["pressure_a"] == pytest.approx(pressure[:5].mean())
    assert Covered.from_dict(found.to_dict()) == found
