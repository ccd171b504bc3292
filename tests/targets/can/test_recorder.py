"""The recording is written by a process of its own and survives that of the loop."""

import io
import json
import os
import struct
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.core.errors import RecordingError
from eha_bench.targets.can import recorder
from eha_bench.targets.can.recorder import Recorder

UNITS = {"reference": "Pa", "current": "A"}


def test_ticks_arrive_with_metadata_of_both_ends(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = Recorder()
    try:
        writer.open(path, UNITS, 10**18, {"trial": "step"}, {"suite.yaml": b"name: x\n"})
        for tick in range(50):
            writer.append(tick * 1e-3, [1e6, 0.1 * tick])
        assert writer.close({"trial": "step", "ending": "complete"}) == ""
    finally:
        writer.stop()
    found = eb.read(path)
    assert len(found) == 50
    assert found["current"][-1] == pytest.approx(4.9)
    assert found.metadata["ending"] == "complete"
    assert found.attachments["suite.yaml"] == b"name: x\n"


def test_a_file_that_cannot_be_written_is_said_and_stops_the_ticks(tmp_path: Path) -> None:
    writer = Recorder()
    try:
        writer.open(tmp_path / "none" / "run.mcap", UNITS, 0, {}, {})
        assert "cannot be written" in writer.close({})
        with pytest.raises(RecordingError):
            writer.append(0.0, [0.0, 0.0])
    finally:
        writer.stop()


def _told(path: Path, ticks: int) -> bytes:
    order = {
        "path": str(path), "channels": UNITS, "epoch_ns": 0, "metadata": {}, "attachments": {},
    }  # fmt: skip
    data = json.dumps(order).encode()
    rows = b"".join(struct.pack("<I3d", 0, tick * 1e-3, 1.0, 2.0) for tick in range(ticks))
    return struct.pack("<I", len(data)) + data + rows


@pytest.mark.parametrize("cut", [0, 5, 20])
def test_a_bench_that_vanishes_leaves_a_closed_recording_that_says_so(
    tmp_path: Path, cut: int
) -> None:
    """The pipe may end anywhere, also in the middle of a tick."""
    path, told = tmp_path / "run.mcap", _told(tmp_path / "run.mcap", 30)
    recorder.serve(io.BytesIO(told[: len(told) - cut]), io.BytesIO())
    found = eb.read(path)
    assert len(found) == 30 - bool(cut)
    assert found.metadata["ending"] == "fault"
    assert "bench ended" in found.metadata["ending_reason"]


def test_an_own_process_ignores_the_loops_signals() -> None:
    writer = Recorder()
    try:
        group = os.getpgid(writer._process.pid)
        assert group != os.getpgid(0)
    finally:
        writer.stop()
    assert writer._process.returncode == 0
