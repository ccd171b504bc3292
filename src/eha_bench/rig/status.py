"""What the rig's drive sends: status, heartbeat, fault code, the fixture's answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eha_bench.targets.can.drive import (
    CanDrive,
    Coding,
    Condition,
    Frame,
    choices,
    coding,
    nothing,
    reach,
)


class StatusFrames:
    """Encodes what the target file says that the drive reports.

    Attributes:
        fixture_done: number of the last request that the fixture has done.
        fixture_position: how the start position stands in the fixture's message.
    """

    def __init__(self, drive: CanDrive) -> None:
        self._drive = drive
        self.fixture_done = 0
        self._alive = 0
        self._sent_code = 0
        self.fixture_position: Coding | None = None
        if drive.fixture is not None and drive.file.fixture is not None:
            self.fixture_position = coding(drive.fixture, drive.file.fixture.position, "m")
        self._blank = {
            identifier: {signal.name: nothing(signal) for signal in status.message.signals}
            for identifier, status in drive.status.items()
        }

    def frames(
        self, reading: Mapping[str, float], counter: int, state: str, stop_closed: bool
    ) -> list[Frame]:
        """Return every status frame; readings by channel in SI."""
        drive = self._drive
        found = []
        for identifier, status in drive.status.items():
            signals: dict[str, Any] = dict(self._blank[identifier])
            for channel, code in status.channels.items():
                signals[code.signal] = code.from_si(reading.get(channel, 0.0))
            if status.counter:
                signals[status.counter] = counter % status.modulus
            if drive.state.message is status.message:
                signals[drive.state.signal] = drive.file.state.values[state]
            stop = drive.emergency_stop
            if stop is not None and stop.message is status.message:
                value = stop.value if stop_closed else ~stop.value & stop.mask
                high = int(reach(status.message.get_signal_by_name(stop.signal))[1])
                signals[stop.signal] = int(signals[stop.signal]) | (value & high)
            data = status.message.encode(signals, strict=False)
            found.append(Frame(identifier, data, status.message.is_extended_frame))
        return found

    def by_itself(self, now: float, code: int) -> list[Frame]:
        """Return the frames that need no Sync: heartbeat, fault code, fixture; now in s."""
        drive = self._drive
        wanted: dict[int, dict[str, float]] = {}
        if drive.heartbeat is not None:
            heartbeat = drive.file.heartbeat
            signals = wanted.setdefault(drive.heartbeat.frame_id, {})
            if heartbeat is not None and heartbeat.signal and heartbeat.value is not None:
                signals[heartbeat.signal] = heartbeat.value
            elif "Alive" in {signal.name for signal in drive.heartbeat.signals}:
                self._alive = (self._alive + 1) % 256
                signals["Alive"] = self._alive
        fault = drive.fault_code
        if fault is not None and self._reports(fault, code):
            wanted.setdefault(fault.message.frame_id, {})[fault.signal] = code
        if drive.fixture_done is not None:
            done = drive.fixture_done
            wanted.setdefault(done.message.frame_id, {})[done.signal] = self.fixture_done
        found = []
        for identifier, values in wanted.items():
            message = drive.messages[identifier]
            signals = {s.name: nothing(s) for s in message.signals}
            signals.update(values)
            if "Uptime" in signals:
                signals["Uptime"] = now % 6000.0
            data = message.encode(signals, strict=False)
            found.append(Frame(identifier, data, message.is_extended_frame))
        return found

    def _reports(self, fault: Condition, code: int) -> bool:
        """Whether the code goes out: always with the heartbeat, alone only when it changes."""
        changed, self._sent_code = code != self._sent_code, code
        return changed or fault.message is self._drive.heartbeat

    def code_of(self, reason: str) -> int:
        """Return the number that the DBC's texts give a reason; 255 for one that has none."""
        fault = self._drive.fault_code
        if fault is None:
            return 255
        numbers = [number for number, text in choices(fault).items() if text == reason]
        return numbers[0] if numbers else 255
