"""`read_topics`: a recording for each topic at its own stamps, nothing resampled."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eha_bench.recordings import read, read_topics


def test_topics_of_a_plain_log_keep_their_own_stamps(shared_data: Path) -> None:
    folder = shared_data / "rig_samples" / "M"
    log, channels = folder / "locked_stairs.mcap", folder / "channels_0.yaml"
    parts = read_topics(log, channels=channels)
    by_name = {name: item for item in parts for name in item.values}
    whole = read(log, channels=channels)
    assert {*by_name} == {*whole.values}
    state, pressure = by_name["motor_speed"], by_name["pressure_a"]
    assert by_name["current"] is state
    # half the rate, and the pressure 0.25 ms later
    assert 1900 < len(state) < 2000
    assert 3900 < len(pressure) < 4000
    assert 0.2e-3 < pressure.time[0] - by_name["current_command"].time[0] < 0.32e-3
    assert min(item.time[0] for item in parts) == 0.0
    for name, item in by_name.items():
        assert np.isfinite(item[name]).all()
        assert item.unit(name) == whole.unit(name)
    # the clock of `read` is one of theirs
    assert len(whole) <= max(map(len, parts))


def test_topics_that_tick_together_are_one_recording(shared_data: Path) -> None:
    folder = shared_data / "rig_samples" / "D"
    log, channels = folder / "locked_stairs.mcap", folder / "channels_0.yaml"
    (alone,) = read_topics(log, channels=channels)
    whole = read(log, channels=channels)
    assert np.array_equal(alone.time, whole.time)
    assert alone.notes == whole.notes
    for name in whole.values:
        assert np.array_equal(alone[name], whole[name])
