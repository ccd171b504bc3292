"""The live writer keeps what it was given, whatever ends the run."""

import math
import time as clock
from pathlib import Path

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.recordings import LiveWriter

CHANNELS = {"pressure_a": "Pa", "current": "A", "my probe": "V"}
EPOCH = 1_760_000_000_000_000_000


def test_ticks_come_back_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    rows = [(k / 1000 - 0.5, (math.sin(k), k * 0.1, math.nan)) for k in range(2000)]
    with LiveWriter(
        path, CHANNELS, epoch_ns=EPOCH, metadata={"trial": "x"}, attachments={"s.yaml": b"s"}
    ) as writer:
        for time, values in rows:
            writer.append(time, values)
        writer.add_metadata({"ended": "in order"})
        assert len(writer) == 2000
    back = recordings.read(path)
    assert back.time.tolist() == [time for time, _ in rows]
    assert back["current"].tolist() == [values[1] for _, values in rows]
    assert np.isnan(back["my probe"]).all()
    assert back.units["my probe"] == "V"
    assert dict(back.metadata) == {"trial": "x", "ended": "in order"}
    assert dict(back.attachments) == {"s.yaml": b"s"}
    assert back.epoch_ns == EPOCH
    assert not any("torn" in note or "closed" in note for note in back.notes)


def test_an_unclosed_file_reads_up_to_the_last_flush(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = LiveWriter(path, ["current"], epoch_ns=0)
    for k in range(100):
        writer.append(k / 1000, [float(k)])
    writer.flush()
    writer.append(0.1, [100.0])
    back = recordings.read(path)
    assert back["current"].tolist() == [float(k) for k in range(100)]
    assert any("not closed" in note for note in back.notes)
    writer.close()
    assert len(recordings.read(path)) == 101


def test_waiting_ticks_are_written_although_none_follows(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with LiveWriter(path, ["current"], epoch_ns=0) as writer:
        writer.append(0.0, [1.0])
        clock.sleep(0.3)
        assert len(recordings.read(path)) == 1


def interrupted_run(path: Path) -> None:
    with LiveWriter(path, ["current"], epoch_ns=0) as writer:
        writer.append(0.0, [1.0])
        raise KeyboardInterrupt


def test_an_exception_leaves_a_closed_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with pytest.raises(KeyboardInterrupt):
        interrupted_run(path)
    assert recordings.read(path).notes == ()


def test_wrong_ticks_are_refused(tmp_path: Path) -> None:
    with LiveWriter(tmp_path / "a.mcap", ["current"], epoch_ns=0) as writer:
        writer.append(1.0, [1.0])
        with pytest.raises(RecordingError, match="does not increase"):
            writer.append(1.0, [1.0])
        with pytest.raises(RecordingError, match="does not increase"):
            writer.append(math.nan, [1.0])
        with pytest.raises(RecordingError, match="2 values for 1 channels"):
            writer.append(2.0, [1.0, 2.0])
        writer.append(3.0, [3.0])
    with pytest.raises(RecordingError, match="closed"):
        writer.append(4.0, [1.0])
    assert recordings.read(tmp_path / "a.mcap")["current"].tolist() == [1.0, 3.0]
    with pytest.raises(RecordingError, match="cannot be written"):
        LiveWriter(tmp_path / "none" / "a.mcap", ["current"], epoch_ns=0)
