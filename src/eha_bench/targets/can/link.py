"""One exchange a tick: the Sync goes out, the drive's answers come in, distinguished by age."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

from eha_bench.core.errors import TargetFault
from eha_bench.core.trial import ControlMode
from eha_bench.targets.can.bus import Bus
from eha_bench.targets.can.drive import CanDrive, Frame, StatusMessage, decode, frame
from eha_bench.targets.can.pacing import LoopHealth

_MOST_FRAMES = 200


class Link:
    """The bus and what was last read from it.

    Attributes:
        readings: last value by channel, SI.
        stamps: when it was read, s of time.monotonic; that of the tick whose Sync it answers.
        state: the drive's last reported state, "" before the first frame.
        named_code: the fault code that `alive` gave last.
        emergency_closed: whether the emergency stop is closed; True where the drive has none.
    """

    def __init__(self, drive: CanDrive, bus: Bus, period: float) -> None:
        self.drive = drive
        self._bus = bus
        self._period = period
        self.readings: dict[str, float] = {}
        self.stamps: dict[str, float] = {}
        self.state = ""
        self.fault_code = 0
        self.named_code = 0
        self.emergency_closed = drive.emergency_stop is None
        self.heartbeat_at = -math.inf
        self.heartbeat_value: int | None = None
        self.fixture_done: int | None = None
        self._tick = 0
        self._tick_at = time.monotonic()
        self._missing = set(drive.status)
        self._numbers: dict[int, int] = {}

    def send(self, message: Frame) -> None:
        """Send a frame."""
        self._bus.send(message)

    def command(self, mode: ControlMode, value: float, word: int) -> None:
        """Send the command of a mode with a control word; value in SI."""
        self._bus.send(self.drive.command_frame(mode, value, word))

    def begin(self) -> None:
        """Send what the drive needs to hear once."""
        for item in self.drive.file.begin:
            message = next(m for m in self.drive.messages.values() if m.name == item.message)
            self._bus.send(frame(message, item.signals))

    def exchange(self, now: float, until: float, health: LoopHealth | None = None) -> bool:
        """Start a tick and read what answers it; return whether everything did in time.

        Args:
            now: time of the tick, s of time.monotonic.
            until: how long the answers are waited for, s of time.monotonic.
            health: counts frames that are on time or late.

        Raises:
            BusLost: the bus does not work.
        """
        for _ in range(_MOST_FRAMES):  # what came since the last tick
            message = self._bus.receive(0.0)
            if message is None:
                break
            self._take(message.arbitration_id, bytes(message.data), health)
        self._tick += 1
        self._tick_at = now
        sync = self.drive.sync_frame(self._tick)
        if sync is None:
            return True
        self._missing = set(self.drive.status)
        self._bus.send(sync)
        while self._missing:
            wait = until - time.monotonic()
            if wait <= 0:
                break
            message = self._bus.receive(wait)
            if message is not None:
                self._take(message.arbitration_id, bytes(message.data), health)
        if not self._missing and health is not None:
            health.latency_max = max(health.latency_max, time.monotonic() - now)
        return not self._missing

    def _take(self, identifier: int, data: bytes, health: LoopHealth | None) -> None:
        message = self.drive.messages.get(identifier)
        if message is None or len(data) < message.length:
            return
        signals = decode(message, data)
        status = self.drive.status.get(identifier)
        if status is not None:
            stamp = self._stamp(identifier, status, signals, health)
            if stamp is not None:
                for channel, coding in status.channels.items():
                    self.readings[channel] = coding.to_si(float(signals[coding.signal]))
                    self.stamps[channel] = stamp
                self._take_state(message, signals)
                self._derive()
        heartbeat = self.drive.file.heartbeat
        if heartbeat is not None and message is self.drive.heartbeat:
            value = int(signals[heartbeat.signal]) if heartbeat.signal else None
            self.heartbeat_value = value
            if heartbeat.value is None or value == heartbeat.value:
                self.heartbeat_at = time.monotonic()
        fault = self.drive.fault_code
        if fault is not None and message is fault.message:
            self.fault_code = fault.of(signals)
        done = self.drive.fixture_done
        if done is not None and message is done.message:
            self.fixture_done = done.of(signals)

    def _stamp(
        self,
        identifier: int,
        status: StatusMessage,
        signals: dict[str, float],
        health: LoopHealth | None,
    ) -> float | None:
        """Return when a status frame was measured; None where a newer one is known."""
        age = 0
        if self.drive.sync is None:
            self._count_gaps(identifier, status, signals, health)
        elif status.counter:
            age = (self._tick - int(signals[status.counter])) % status.modulus
        elif identifier not in self._missing:
            age = 1
        if age == 0:
            if health is not None:
                health.on_time += 1
            self._missing.discard(identifier)
            return self._tick_at if self.drive.sync is not None else time.monotonic()
        if health is not None:
            health.late += 1
        stamp = self._tick_at - age * self._period
        newest = max((self.stamps.get(name, -math.inf) for name in status.channels), default=stamp)
        return stamp if stamp >= newest else None

    def _count_gaps(
        self,
        identifier: int,
        status: StatusMessage,
        signals: Mapping[str, float],
        health: LoopHealth | None,
    ) -> None:
        """Count what is missing between two frames of a drive that numbers them by itself."""
        if not status.counter:
            return
        number = int(signals[status.counter])
        before = self._numbers.get(identifier)
        self._numbers[identifier] = number
        if before is not None and health is not None:
            health.gaps += (number - before - 1) % status.modulus

    def _take_state(self, message: object, signals: dict[str, float]) -> None:
        if message is self.drive.state.message:
            self.state = self.drive.states.get(self.drive.state.of(signals), "unknown")
        stop = self.drive.emergency_stop
        if stop is not None and message is stop.message:
            self.emergency_closed = stop.holds(signals)

    def _derive(self) -> None:
        if "pressure_a" in self.readings and "pressure_b" in self.readings:
            difference = self.readings["pressure_a"] - self.readings["pressure_b"]
            self.readings["pressure_difference"] = difference

    def alive(self, now: float) -> str:
        """Return why the drive is not taken to be alive and ready, or an empty text."""
        heartbeat = self.drive.file.heartbeat
        if heartbeat is not None and now - self.heartbeat_at > heartbeat.timeout:
            if self.heartbeat_value is not None and heartbeat.value not in (
                None,
                self.heartbeat_value,
            ):
                return f"the heartbeat says {self.heartbeat_value} instead of {heartbeat.value}"
            return f"no heartbeat for more than {heartbeat.timeout * 1e3:.0f} ms"
        if self.state == "fault":
            self.named_code = self.fault_code
            return f"the drive is in fault, code {self.drive.named_fault(self.fault_code)}"
        if not self.emergency_closed:
            return "the emergency stop is open"
        return ""


class DriveAbsent(TargetFault):
    """The drive does not answer: nothing was run, and it can be tried again."""
