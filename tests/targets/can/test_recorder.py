"""The recording is written by a process of its own and survives that of the loop."""

import io
import json
import os
import signal
import struct
import time
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.core.errors import RecordingError
from eha_bench.targets.can.heartbeat import Heartbeat, Silence
from eha_bench.targets.can.pacing import Pacer
from eha_bench.targets.can.recorder import Recorder
from eha_bench.targets.can.recorder_process import serve

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
    heard, said = os.pipe()
    os.write(said, told[: len(told) - cut])
    os.close(said)
    serve(heard, io.BytesIO(), lambda: None)
    os.close(heard)
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


@pytest.mark.parametrize("period", [0.5e-3, 1e-3, 2e-3, 3e-3])
def test_a_stall_is_noticed_within_a_tenth_of_a_second(period: float) -> None:
    for phase in range(20):
        silence, stalled_at = Silence(0.0), 0.2 + phase * 1e-3
        for tick in range(1000):
            now = tick * period
            found = silence.of(int(min(now, stalled_at) / 0.01), now)
            assert not found or now > stalled_at
            if found:
                break
        assert 0.05 < now - stalled_at < 0.1


def test_one_that_looks_late_itself_finds_no_stall() -> None:
    silence, now = Silence(0.0), 0.0
    for count in range(20):
        now += 0.3  # both were held up; the other end comes a moment later
        assert not any(silence.of(count - 1, now + look * 1e-3) for look in range(9))
        now += 9e-3
        assert silence.of(count, now) == 0.0


def test_a_heartbeat_is_seen_through_another_descriptor() -> None:
    one = Heartbeat.make()
    other = Heartbeat(os.dup(one.descriptor))
    for beat in range(1, 4):
        one.beat()
        assert other.count == beat
    one.close()
    other.close()


def _recording(folder: Path, rate: int) -> tuple[Recorder, Pacer]:
    """A recorder that has recorded for 0.2 s; begun anew where a busy machine held it up itself."""
    for attempt in range(5):
        writer = Recorder()
        writer.open(folder / f"run{attempt}.mcap", {"current": "A"}, 10**18, {}, {})
        pacer = Pacer(1 / rate)
        try:
            for tick in range(1, rate // 5):
                pacer.wait(tick, writer.watch)
                writer.append(tick / rate, [1.0])
        except RecordingError:
            writer.stop()
            continue
        return writer, pacer
    raise AssertionError("the machine holds a recorder up all the time")


@pytest.mark.parametrize("rate", [1000, 20])
def test_a_recorder_that_stalls_is_said_and_left_quickly(tmp_path: Path, rate: int) -> None:
    """Whatever the loop's rate; what a quiet machine needs for it is in docs/rig.md."""
    writer, pacer = _recording(tmp_path, rate)
    try:
        os.kill(writer.pid, signal.SIGSTOP)
        start = time.monotonic()
        with pytest.raises(RecordingError, match="recorder has stalled"):
            pacer.wait(4 * rate, writer.watch)
        noticed = time.monotonic() - start
        assert "stalled" in writer.close({})
    finally:
        start = time.monotonic()
        writer.stop()
    assert time.monotonic() - start < 2
    assert 0.05 < noticed < 0.4  # 0.1 s and what a busy machine adds


def record_noise(writer: Recorder, channels: int) -> None:
    pacer = Pacer(1e-3)
    for tick in range(1, 3000):
        pacer.wait(tick)
        writer.append(tick * 1e-3, [hash((tick, number)) * 1e-9 for number in range(channels)])


def test_a_disk_that_does_not_answer_is_a_stall(tmp_path: Path) -> None:
    """A pipe that nobody empties takes no more bytes, as such a disk does."""
    path = tmp_path / "run.mcap"
    os.mkfifo(path)
    writer = Recorder()
    disk = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    values = {f"c{number}": "A" for number in range(100)}
    try:
        writer.open(path, values, 10**18, {}, {})
        with pytest.raises(RecordingError, match="recorder has stalled"):
            record_noise(writer, len(values))
        assert "stalled" in writer.close({})
    finally:
        start = time.monotonic()
        writer.stop()
        os.close(disk)
    assert time.monotonic() - start < 2
