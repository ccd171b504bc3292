"""A drive as its DBC and its target.yaml describe it: frames to channels and back.

Bench and rig read the same description, the one from this side of the bus and the other from that
side, so that a drive stands in files only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.trial import COMMANDS, ControlMode
from eha_bench.targets.can.target_file import CanTargetFile

if TYPE_CHECKING:
    from cantools.database.can.message import Message
    from cantools.database.can.signal import Signal


@dataclass(frozen=True)
class Frame:
    """A frame on its way: identifier, data, whether the identifier has 29 bits."""

    id: int
    data: bytes
    extended: bool = False


@dataclass(frozen=True)
class Coding:
    """How one quantity stands in a signal: SI = factor * physical + offset.

    Attributes:
        signal: name in the DBC.
        factor, offset: from the physical value of the DBC to SI.
        low, high: what the signal can hold, physical value of the DBC.
    """

    signal: str
    factor: float = 1.0
    offset: float = 0.0
    low: float = -math.inf
    high: float = math.inf

    def to_si(self, physical: float) -> float:
        """Return the value in SI."""
        return self.factor * physical + self.offset

    def from_si(self, value: float) -> float:
        """Return the physical value, within what the signal can hold."""
        return min(max((value - self.offset) / self.factor, self.low), self.high)


@dataclass(frozen=True)
class StatusMessage:
    """A message in which the drive says what it measures.

    Attributes:
        message: of the DBC.
        channels: channel -> how it is coded.
        counter: signal that repeats the Sync's counter, "" for none.
        modulus: at which that counter begins again.
    """

    message: Message
    channels: Mapping[str, Coding]
    counter: str = ""
    modulus: int = 1


@dataclass(frozen=True)
class CommandMessage:
    """The message that carries the reference of one control mode."""

    message: Message
    coding: Coding
    fixed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Condition:
    """A signal that is looked at: `raw & mask` against a value."""

    message: Message
    signal: str
    mask: int = 0xFFFFFFFF
    value: int = 0

    def of(self, signals: Mapping[str, Any]) -> int:
        """Return the masked value."""
        return int(signals[self.signal]) & self.mask

    def holds(self, signals: Mapping[str, Any]) -> bool:
        """Whether the signal has the value."""
        return self.of(signals) == self.value


@dataclass(frozen=True)
class CanDrive:
    """Everything that is particular to a drive, bound to the messages of its DBC.

    Attributes:
        path: the target.yaml.
        units: SI unit of every channel and of every mode's channel.
        file: its content.
        messages: every message of the DBC by identifier.
        status: messages with channels, state or emergency stop, by identifier; every one of them
            is expected at every tick.
        commands: by control mode.
        sync: the message that starts a tick; None for a drive that sends by its own clock.
        state: where the drive says its state; `states` names the masked values.
        model, controller: files that the target names, None where it names none.
        dbc: the DBC file.
    """

    path: Path
    file: CanTargetFile
    units: Mapping[str, str]
    messages: Mapping[int, Message]
    status: Mapping[int, StatusMessage]
    commands: Mapping[ControlMode, CommandMessage]
    sync: Message | None
    state: Condition
    states: Mapping[int, str]
    emergency_stop: Condition | None
    heartbeat: Message | None
    fault_code: Condition | None
    fixture: Message | None
    fixture_done: Condition | None
    model: Path | None
    controller: Path | None
    dbc: Path

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that the drive measures, in the order of the file."""
        return tuple(self.file.channels)

    @property
    def command(self) -> ControlMode | None:
        """The mode in which the drive passes a command on: a current, a voltage, a valve's command.

        It is none that is measured: a mode whose channel is measured is closed by the drive.
        """
        for mode in self.commands:
            if mode == ControlMode.CURRENT or mode.channel in COMMANDS:
                return mode
        own = (mode for mode in self.commands if not mode.known)
        return next((mode for mode in own if mode.channel not in self.channels), None)

    def command_frame(self, mode: ControlMode, value: float, word: int) -> Frame:
        """Return the frame that asks for `value` (SI, of the mode) with a control word."""
        command = self.commands[mode]
        signals = {
            **command.fixed,
            self.file.control_word.signal: word,
            command.coding.signal: command.coding.from_si(value),
        }
        return frame(command.message, signals)

    def sync_frame(self, tick: int) -> Frame | None:
        """Return the frame that starts a tick, None for a drive that needs none."""
        if self.sync is None:
            return None
        name = self.file.sync.counter if self.file.sync else ""
        signals = {}
        if name:
            signals[name] = tick % (1 << self.sync.get_signal_by_name(name).length)
        return frame(self.sync, signals)

    def fixture_frame(self, request: int, locked: bool, bypass: bool, position: float) -> Frame:
        """Return the frame that asks the fixture for a setup; position in m from mid-stroke."""
        fixture, message = self.file.fixture, self.fixture
        assert fixture is not None
        assert message is not None
        where = coding(message, fixture.position, "m")
        return frame(
            message,
            {
                fixture.request: request,
                fixture.piston.signal: fixture.piston.locked if locked else fixture.piston.free,
                fixture.bypass.signal: fixture.bypass.open if bypass else fixture.bypass.closed,
                where.signal: where.from_si(position),
            },
        )

    def decode(self, identifier: int, data: bytes) -> dict[str, Any] | None:
        """Return the physical values of a frame's signals; None if it is none of the drive's."""
        message = self.messages.get(identifier)
        if message is None or len(data) < message.length:
            return None
        return decode(message, data)

    def named_fault(self, code: int) -> str:
        """Return a fault code with the DBC's text for it."""
        if self.fault_code is None:
            return str(code)
        text = choices(self.fault_code).get(code, "")
        return f"{code} ({text})" if text else str(code)


def decode(message: Message, data: bytes) -> dict[str, Any]:
    """Return the physical values of a message's signals by name."""
    found = message.decode(data, decode_choices=False)
    assert isinstance(found, dict)
    return found


def frame(message: Message, signals: Mapping[str, float]) -> Frame:
    """Return a message as a frame; signals that are not given are 0, as far as they may be."""
    if message.is_multiplexed():
        filled = dict(signals)
        for name in message.signal_tree:
            if isinstance(name, str):
                filled.setdefault(name, nothing(message.get_signal_by_name(name)))
    else:
        filled = {s.name: signals.get(s.name, nothing(s)) for s in message.signals}
    data = message.encode(filled, strict=False)
    return Frame(message.frame_id, data, message.is_extended_frame)


def nothing(signal: Signal) -> float:
    """Return 0, or what of the signal's range is nearest to it."""
    low, high = reach(signal)
    return min(max(0.0, low), high)


def choices(place: Condition) -> dict[int, str]:
    """Return the texts that the DBC gives to a signal's values."""
    found = place.message.get_signal_by_name(place.signal).choices
    return {int(number): str(text) for number, text in (found or {}).items()}


def reach(signal: Signal) -> tuple[float, float]:
    """Return the smallest and largest physical value that a signal can hold."""
    if signal.is_float:
        ends = (-math.inf, math.inf)
    elif signal.is_signed:
        ends = (-(2.0 ** (signal.length - 1)), 2.0 ** (signal.length - 1) - 1)
    else:
        ends = (0.0, 2.0**signal.length - 1)
    scaled = sorted(end * float(signal.scale) + float(signal.offset) for end in ends)
    low = scaled[0] if signal.minimum is None else max(scaled[0], float(signal.minimum))
    high = scaled[1] if signal.maximum is None else min(scaled[1], float(signal.maximum))
    # a DBC writes [0|0] where it says nothing
    return (low, high) if low < high else (scaled[0], scaled[1])


def coding(message: Message, place: Any, si_unit: str) -> Coding:
    """Return how a quantity of unit `si_unit` stands in a signal.

    Raises:
        UnitError: the unit is unknown or of the wrong dimension.
    """
    from eha_bench.core.units import factor_and_offset

    factor, offset = factor_and_offset(place.unit, si_unit) if place.unit else (1.0, 0.0)
    low, high = reach(message.get_signal_by_name(place.signal))
    return Coding(place.signal, factor * place.scale, factor * place.offset + offset, low, high)
