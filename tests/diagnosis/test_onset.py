"""Logs that begin with a valve's command, of a machine that stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.onset import with_onset

TIME = np.arange(0.0, 2.0, 0.01)
COMMAND, POSITION, SUPPLY = "valve_command", "piston_position", "supply_pressure"


def log(standing: float, command: float = 4.0, quantum: float = 1e-4) -> Recording:
    """A rod that a command moves at 0.1 m/s, once it has stood for a while."""
    noise = np.random.default_rng(3).normal(0.0, 3e-5, TIME.size)
    position = 0.1 * np.clip(TIME - standing, 0.0, None) + noise
    values = {
        COMMAND: np.where(TIME < 1.5, command, -command),
        POSITION: np.round(position / quantum) * quantum,
        SUPPLY: np.full(TIME.size, 14e6),
    }
    return Recording(TIME + 3.0, values)


def onset(recording: Recording) -> Recording:
    (found,) = with_onset((recording,), [COMMAND], [POSITION])
    return found


def test_a_command_of_a_machine_that_stands_has_just_begun() -> None:
    before = log(standing=0.16)
    after = onset(before)
    assert len(after) == len(before) + 1
    assert after.time[0] == pytest.approx(3.0 - 0.01)
    assert after[COMMAND][0] == 0.0
    assert np.isnan(after[POSITION][0])
    assert np.isnan(after[SUPPLY][0])
    np.testing.assert_array_equal(after[COMMAND][1:], before[COMMAND])
    assert "the machine stands for 0.16 s yet" in after.notes[-1]


@pytest.mark.parametrize(
    "recording",
    [
        pytest.param(log(standing=0.0), id="moves already"),
        # within its resolution a slow rod seems to stand
        pytest.param(log(standing=0.0, quantum=2e-3), id="moves already, coarse"),
        pytest.param(log(standing=5.0), id="never moves"),
        pytest.param(log(standing=0.16, command=0.0), id="nothing is asked for"),
        pytest.param(log(standing=1.6), id="moves under another command"),
    ],
)
def test_what_does_not_show_an_onset_stays_as_it_is(recording: Recording) -> None:
    assert onset(recording) is recording


def test_several_topics_and_a_log_without_positions_stay_as_they_are() -> None:
    one = log(standing=0.16)
    assert with_onset((one, one), [COMMAND], [POSITION]) == (one, one)
    assert with_onset((one,), [COMMAND], ["rod_speed"]) == (one,)
    assert with_onset((one,), [], [POSITION]) == (one,)


@given(st.floats(0.06, 1.0), st.sampled_from([1e-4, 5e-4, 2e-3]))
def test_the_time_it_stands_is_told_within_two_steps_of_the_sensor(
    standing: float, quantum: float
) -> None:
    after = onset(log(standing, quantum=quantum))
    if np.isfinite(after.time[0]) and len(after) > TIME.size:
        told = float(after.notes[-1].split("stands for ")[1].split(" s")[0])
        assert told == pytest.approx(standing, abs=2.0 * quantum / 0.1 + 0.02)
