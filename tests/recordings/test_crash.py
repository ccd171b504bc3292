"""What is on the disk when the process is killed, or when the disk is full."""

import os
import random
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from eha_bench import recordings
from eha_bench.core.errors import RecordingError, TargetFault
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status
from eha_bench.recordings import LiveWriter
from forked import Forked

AT_RISK = 0.25

# Writes at 1 kHz and says by the clock of all processes when each tick was handed over.
WRITER = """
import struct, sys, time, mmap
from eha_bench.recordings import LiveWriter
page = open(sys.argv[2], "r+b")
shared = mmap.mmap(page.fileno(), 4096)
with LiveWriter(sys.argv[1], ["current", "pressure_a"], epoch_ns=0) as writer:
    begin = time.monotonic()
    tick = 0
    while True:
        now = time.monotonic() - begin
        while tick <= now * 1000:
            writer.append(tick / 1000, (time.monotonic(), tick))
            tick += 1
            shared[:8] = struct.pack("<q", tick)
        time.sleep(0.0005)
"""


def killed_run(
    forked: Forked, folder: Path, number: int, choice: random.Random
) -> tuple[Path, float, int]:
    """Start a writer and kill it; return its file, when it was killed, and its ticks."""
    path, page = folder / f"{number}.mcap", folder / f"{number}.page"
    page.write_bytes(bytes(4096))
    process = forked.start(path, page, folder=folder, code=WRITER)
    try:
        deadline = time.monotonic() + 60
        while not int.from_bytes(page.read_bytes()[:8], "little"):
            assert time.monotonic() < deadline, "the writer did not start"
            time.sleep(0.005)
        # more than two of the periods after which it saves
        time.sleep(choice.uniform(0.0, 0.6))
    finally:
        moment = time.monotonic()
        process.kill()
    return path, moment, int.from_bytes(page.read_bytes()[:8], "little")


def check_killed_runs(forked: Forked, folder: Path, count: int) -> None:
    choice = random.Random(5)
    for number in range(count):
        path, moment, ticks = killed_run(forked, folder, number, choice)
        handed_over = moment - AT_RISK
        try:
            back = recordings.read(path)
        except RecordingError:
            back = None
        saved = 0 if back is None else len(back)
        if back is not None:
            assert back["pressure_a"].tolist() == list(range(saved))
            lost_from = back["current"][-1]
        # a tick that is not there must be younger than the promised window
        if saved < ticks and back is not None:
            assert lost_from >= handed_over - 0.005, f"run {number}: {moment - lost_from} s lost"
        elif back is None:
            assert ticks <= AT_RISK * 1000 + 50


@pytest.mark.slow
def test_kill_9(forked: Forked, tmp_path: Path) -> None:
    check_killed_runs(forked, tmp_path, 3)


@pytest.mark.slow(20)
def test_kill_9_at_50_random_moments(forked: Forked, tmp_path: Path) -> None:
    check_killed_runs(forked, tmp_path, 50)


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Let no file grow beyond `size` bytes, as if the disk were full then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    earlier = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, earlier)


def run_until_full(path: Path) -> int:
    """Append until it fails; return how many ticks were handed over."""
    generator = random.Random(1)
    with LiveWriter(path, [f"c{k}" for k in range(8)], epoch_ns=0) as writer:
        for tick in range(1_000_000):
            writer.append(tick / 1000, [generator.random() for _ in range(8)])
    return tick


def test_a_full_disk_stops_the_run_and_keeps_what_is_there(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with room_for(200_000), pytest.raises(RecordingError, match=r"cannot be written.*can be read"):
        run_until_full(path)
    back = recordings.read(path)
    assert len(back) > 1000
    assert back.time[-1] == pytest.approx((len(back) - 1) / 1000)
    assert any("torn" in note or "not closed" in note for note in back.notes)
    generator = random.Random(1)
    expected = [[generator.random() for _ in range(8)] for _ in range(len(back))]
    assert back["c7"].tolist() == [row[7] for row in expected]


def test_a_full_disk_leaves_no_half_written_file(tmp_path: Path) -> None:
    import numpy as np

    noise = np.random.default_rng(0).normal(size=50_000)
    recording = Recording(np.arange(50_000) / 1000, {"current": noise})
    with room_for(100_000), pytest.raises(RecordingError, match="cannot be written"):
        recordings.write(tmp_path / "a.mcap", recording)
    assert list(tmp_path.iterdir()) == []


SUITE = """
name: full
defaults:
  setup: {piston: locked}
trials:
  - {id: short, mode: current, duration: 0.1 s, signal: {kind: step, final: 5 A}}
  - {id: long, mode: current, duration: 4 s, signal: {kind: sine, amplitude: 5 A, frequency: 1 Hz}}
"""


def test_a_disk_that_fills_during_a_run_stops_it_and_keeps_what_is_there(tmp_path: Path) -> None:
    import eha_bench as eb

    (tmp_path / "full.yaml").write_text(SUITE)
    out = tmp_path / "out"
    with room_for(60_000), pytest.raises(TargetFault, match=r"cannot be written.*report cannot"):
        eb.run(tmp_path / "full.yaml", target="simulator", out=out)
    assert [file.name for file in (out / "recordings").iterdir()] == ["short-0.mcap"]
    kept = recordings.read(out / "recordings" / "short-0.mcap")
    assert kept.time[-1] == pytest.approx(0.1, abs=0.0015)
    result = Result.read(out / "result.json")
    assert [(trial.id, trial.status) for trial in result.trials] == [
        ("short", Status.PASSED),
        ("long", Status.FAULT),
    ]
    assert "the recording cannot be written" in result.trials[1].reason
    assert result.provenance["stopped_by"] == "fault"
    again = eb.run(tmp_path / "full.yaml", target="simulator", out=out, resume=True)
    assert again.status is Status.PASSED


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_no_room_at_all() -> None:
    with pytest.raises(RecordingError, match="No space left"):
        LiveWriter("/dev/full", ["current"], epoch_ns=0)


def test_fsync_is_an_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: (synced.append(number), real(number))[1])
    with LiveWriter(tmp_path / "a.mcap", ["current"], epoch_ns=0, fsync=True) as writer:
        writer.append(0.0, [1.0])
        deadline = time.monotonic() + 5
        while not synced and time.monotonic() < deadline:
            time.sleep(0.01)
        assert synced
    count = len(synced)
    with LiveWriter(tmp_path / "b.mcap", ["current"], epoch_ns=0) as writer:
        writer.append(0.0, [1.0])
    assert len(synced) == count
