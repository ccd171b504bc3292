"""Readings beyond all sensors: single ones are marks, and a channel of them is no sensor's."""

import numpy as np
import pytest

from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.beyond_sensors import refuse_beyond_sensors, without_marks

LARGEST = float(np.finfo(np.float64).max)


def test_marks_are_missing_in_their_channel_alone() -> None:
    speed = np.linspace(1.0, 2.0, 100)
    speed[[3, 4, 70]] = LARGEST, -LARGEST, LARGEST
    read = Recording(np.arange(100) / 1e3, {"motor_speed": speed, "current": np.ones(100)})
    found = without_marks(read)
    assert np.flatnonzero(np.isnan(found["motor_speed"])).tolist() == [3, 4, 70]
    assert np.array_equal(found["current"], read["current"])
    (note,) = found.notes
    assert "'motor_speed' beyond all sensors (1.8e+308 rad/s), taken as missing: 3" in note
    refuse_beyond_sensors(found, found, Place())


@pytest.mark.parametrize("share", [0.0, 0.05, 0.95], ids=["all", "most", "all but zeros"])
def test_a_channel_with_hardly_any_other_reading_is_refused(share: float) -> None:
    pressure = np.full(100, 3e199)
    pressure[: int(100 * share)] = 1.0 if share < 0.5 else 0.0
    read = Recording(np.arange(100) / 1e3, {"pressure_a": pressure})
    found = without_marks(read)
    assert found is read
    with pytest.raises(RecordingError, match=r"'pressure_a' reads 3e\+199 Pa, as no sensor does"):
        refuse_beyond_sensors(found, ["pressure_a"], Place())
