"""What answers a tick is distinguished by age; what does not come is missed."""

import math
import time
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest

from eha_bench.rig.status import StatusFrames
from eha_bench.targets.can.drive import CanDrive, Frame, frame
from eha_bench.targets.can.link import Link
from eha_bench.targets.can.load import load_drive
from eha_bench.targets.can.pacing import LoopHealth

from .conftest import Writer

READING = {"current": 3.0, "pressure_a": 2e6, "pressure_b": 1e6}


class FakeBus:
    """Answers a Sync with frames that a test lays ready."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []
        self.waiting: deque[Frame] = deque()
        self.answers: deque[list[Frame]] = deque()

    def send(self, sent: Frame) -> None:
        self.sent.append(sent)
        if sent.id == 0x80 and self.answers:
            self.waiting.extend(self.answers.popleft())

    def receive(self, timeout: float) -> Any:
        if not self.waiting:
            time.sleep(min(timeout, 1e-3))
            return None
        found = self.waiting.popleft()
        return SimpleNamespace(arbitration_id=found.id, data=found.data)


def answers(drive: CanDrive, counter: int, state: str = "enabled") -> list[Frame]:
    return StatusFrames(drive).frames(READING, counter, state, stop_closed=True)


def link_to(drive: CanDrive) -> tuple[Link, FakeBus, LoopHealth]:
    bus = FakeBus()
    messages = len(drive.status) if drive.sync else 0
    return Link(drive, bus, 1e-3), bus, LoopHealth(100, 1e-3, messages)


def tick(link: Link, health: LoopHealth, now: float | None = None) -> bool:
    """Exchange a tick's frames; the answers have long to come: a busy machine must not decide."""
    at = time.monotonic() if now is None else now
    health.tick(at, 0.0, 0)
    return link.exchange(at, time.monotonic() + 0.2, health)


def test_answers_in_time_are_read_with_the_stamp_of_their_tick(eha_drive: CanDrive) -> None:
    link, bus, health = link_to(eha_drive)
    bus.answers.append(answers(eha_drive, 1))
    assert tick(link, health)
    assert link.state == "enabled"
    assert link.emergency_closed
    assert link.readings["pressure_difference"] == pytest.approx(1e6, abs=6e3)
    assert (health.on_time, health.late, health.lost) == (2, 0, 0)
    assert len(set(link.stamps.values())) == 1


def test_what_comes_a_tick_later_is_late_and_older(eha_drive: CanDrive) -> None:
    link, bus, health = link_to(eha_drive)
    first, second = answers(eha_drive, 1)
    bus.answers.extend([[first], [second, *answers(eha_drive, 2)]])
    assert not tick(link, health)
    assert tick(link, health)
    assert (health.on_time, health.late, health.lost) == (3, 1, 0)
    bus.answers.append([])
    tick(link, health)
    assert health.lost == 2


def test_a_late_answer_never_replaces_a_newer_one(eha_drive: CanDrive) -> None:
    link, bus, health = link_to(eha_drive)
    begun = time.monotonic()
    for number in range(1, 5):
        bus.answers.append(answers(eha_drive, number))
        tick(link, health, begun + number * 1e-3)
    before = dict(link.stamps)
    bus.answers.append(answers(eha_drive, 2))
    tick(link, health, begun + 5e-3)
    assert link.stamps == before


def test_the_drive_has_to_be_alive_sound_and_released(eha_drive: CanDrive) -> None:
    link, bus, health = link_to(eha_drive)
    assert "no heartbeat" in link.alive(time.monotonic())
    assert eha_drive.heartbeat is not None
    beat = frame(eha_drive.heartbeat, {"Alive": 1, "FaultCode": 2})
    bus.answers.append([beat, *answers(eha_drive, 1)])
    tick(link, health)
    assert link.alive(time.monotonic()) == ""
    bus.answers.append(answers(eha_drive, 2, "fault"))
    tick(link, health)
    assert "code 2 (over-pressure)" in link.alive(time.monotonic())
    stopped = StatusFrames(eha_drive).frames(READING, 3, "enabled", stop_closed=False)
    bus.answers.append(stopped)
    tick(link, health)
    assert link.alive(time.monotonic()) == "the emergency stop is open"


def test_a_heartbeat_with_the_wrong_state_is_none(cia402: CanDrive) -> None:
    link, bus, health = link_to(cia402)
    assert cia402.heartbeat is not None
    bus.answers.append([frame(cia402.heartbeat, {"NmtState": 127}), *answers(cia402, 1)])
    tick(link, health)
    assert "says 127 instead of 5" in link.alive(time.monotonic())
    assert math.isinf(link.heartbeat_at)


def test_a_drive_without_sync_is_counted_by_its_own_numbers(target: Writer) -> None:
    drive = load_drive(target("sync: null\n"))
    link, bus, health = link_to(drive)
    for number in (1, 2, 5):
        bus.waiting.extend(answers(drive, number))
        assert tick(link, health)
    assert not bus.sent
    assert (health.on_time, health.late, health.lost) == (6, 0, 4)
    assert health.frames == 10
    assert link.readings["current"] == pytest.approx(3.0, abs=2e-3)


def test_frames_of_others_and_short_ones_are_passed_over(eha_drive: CanDrive) -> None:
    link, bus, health = link_to(eha_drive)
    bus.answers.append([Frame(0x7AA, b"1"), Frame(0x181, b"\0"), *answers(eha_drive, 1)])
    assert tick(link, health)
