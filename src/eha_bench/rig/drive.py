"""The drive that the rig plays: commands in, torque on the actuator, status out, safe by itself.

It watches over itself as a real one does: no command for longer than its watchdog allows, a
pressure, speed or current beyond its own limits, or an open emergency stop take the torque off,
and it stays in fault until it is reset.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.control.controller import Context, Controller
from eha_bench.control.controller_file import ControllerSet
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.trial import ControlMode
from eha_bench.rig.faults import FaultKind, Faults
from eha_bench.rig.log import RigLog
from eha_bench.rig.real_plant import RealPlant
from eha_bench.rig.status import StatusFrames
from eha_bench.rig.words import DriveStates
from eha_bench.targets.can.drive import CanDrive, CommandMessage, Frame, decode

_PERIOD: Final = 1e-3
_IDLE: Final = 5e-3
_HEARTBEAT: Final = 0.05
_UNASKED: Final = 0.1
"""Without a Sync for so long, s, the status goes out with the heartbeat."""
_CATCH_UP: Final = 1.3


@dataclass(frozen=True)
class DriveLimits:
    """The drive's own limits, SI.

    Attributes:
        watchdog: time without a command by which the torque is off, s.
        pressure: in either chamber, Pa.
        speed: of the motor, rad/s.
    """

    watchdog: float = 20e-3
    pressure: float = 46e6
    speed: float = 600.0


class RigDrive:
    """A drive with its actuator, moved on by frames and by time; all times are s, its own clock."""

    def __init__(
        self,
        drive: CanDrive,
        plant: RealPlant,
        controllers: ControllerSet,
        faults: Faults,
        log: RigLog,
        limits: DriveLimits | None = None,
        seed: int = 0,
    ) -> None:
        self._drive = drive
        self._plant = plant
        self._controllers = controllers
        self._faults = faults
        self._log = log
        self._limits = limits or DriveLimits()
        self._random = np.random.default_rng(seed + 1)
        self._words = DriveStates(drive)
        self._status = StatusFrames(drive)
        self._by_message: dict[int, list[tuple[ControlMode, CommandMessage]]] = {}
        for mode, command in drive.commands.items():
            self._by_message.setdefault(command.message.frame_id, []).append((mode, command))
        self._mode = drive.command or ControlMode.CURRENT
        self._reference = 0.0
        self._given = 0.0
        self._controller: Controller | None = None
        self._controlled_at = -math.inf
        self._last_command = -math.inf
        self._sample: dict[str, float] = plant.sample()
        self._sampled_at = 0.0
        self._cycle_due = 0.0
        self._heartbeat_due = 0.0
        self._alive = 0
        self._synced_at = -math.inf
        self._waited = self._commands = 0.0
        self._fault_code = 0
        self._late: deque[tuple[float, Frame]] = deque()
        self._out: list[Frame] = []

    @property
    def state(self) -> str:
        """The drive's state."""
        return self._words.state

    @property
    def due(self) -> float:
        """When the drive has to be looked at again at the latest."""
        found = min(self._cycle_due, self._heartbeat_due)
        if self._words.watched:
            found = min(found, self._patience)
        return min(found, self._late[0][0]) if self._late else found

    @property
    def _patience(self) -> float:
        """When the torque goes off for want of a command: a cycle early, to be off in time."""
        return self._last_command + max(self._limits.watchdog - _PERIOD, _PERIOD)

    def take_out(self) -> list[Frame]:
        """Return what is to be sent now."""
        out, self._out = self._out, []
        return out

    # --- frames -------------------------------------------------------------

    def receive(self, frame: Frame, now: float) -> None:
        """Take a frame from the bus."""
        self._begin_faults(now)
        if self._faults.active(FaultKind.BUS_OFF):
            return
        drive = self._drive
        if drive.sync is not None and frame.id == drive.sync.frame_id:
            self._answer(frame, now)
        elif frame.id in self._by_message:
            self._command(frame, now)
        elif drive.fixture is not None and frame.id == drive.fixture.frame_id:
            self._set_up(frame)

    def _answer(self, frame: Frame, now: float) -> None:
        """Answer a Sync: everything is sampled at this moment."""
        assert self._drive.sync is not None
        signals = decode(self._drive.sync, frame.data)
        sync = self._drive.file.sync
        self._look(now)
        self._synced_at = now
        self._send_status(int(signals[sync.counter]) if sync and sync.counter else 0, now)

    def _send_status(self, counter: int, now: float) -> None:
        state, stop = self._words.state, self._stop_is_closed()
        late = self._faults.active(FaultKind.LATE)
        lost = self._faults.active(FaultKind.LOST)
        for frame in self._status.frames(self._sample, counter, state, stop):
            if lost is not None and self._random.random() < lost.value:
                continue
            if late is not None:
                self._late.append((now + late.value, frame))
            else:
                self._send(frame)

    def _command(self, frame: Frame, now: float) -> None:
        self._advance(now)
        found = self._demand(frame)
        if found is None:
            self._fail("command outside its range", now)
            return
        mode, reference, word = found
        self._last_command = now
        if self._words.enabled and self._drive.sync is not None:
            self._waited += now - self._synced_at
            self._commands += 1
        was = self._words.state
        if self._stop_is_closed() or word in (
            self._drive.file.control_word.disable,
            self._drive.file.control_word.reset,
        ):
            self._words.take(word)
        if self._words.state != was:
            self._follow_state_change(was, now, f"control word {word}")
        if mode != self._mode or self._controller is None:
            self._begin_mode(mode)
        self._reference = reference
        if not self._words.enabled:
            self._given = 0.0
        elif mode == self._drive.command:
            self._given = reference
        elif now - self._controlled_at >= 0.5 * _PERIOD:
            self._control(now)

    def _demand(self, frame: Frame) -> tuple[ControlMode, float, int] | None:
        """Return mode, reference (SI) and control word of a command; None for nonsense."""
        commands = self._by_message[frame.id]
        message = commands[0][1].message
        if len(frame.data) < message.length:
            return None
        try:
            signals = decode(message, frame.data)
        except Exception:  # a multiplexer value that the DBC does not know
            return None
        for mode, command in commands:
            fixed = all(signals.get(name) == value for name, value in command.fixed.items())
            coding = command.coding
            if fixed and coding.signal in signals:
                physical = float(signals[coding.signal])
                if not coding.low <= physical <= coding.high:
                    return None
                word = int(signals[self._drive.file.control_word.signal])
                return mode, coding.to_si(physical), word
        return None

    def _set_up(self, frame: Frame) -> None:
        """Let the fixture do what is asked, as long as the torque is off."""
        fixture, message = self._drive.file.fixture, self._drive.fixture
        assert fixture is not None
        assert message is not None
        if self._words.enabled:
            return
        signals = decode(message, frame.data)
        request = int(signals[fixture.request])
        locked = int(signals[fixture.piston.signal]) == fixture.piston.locked
        bypass = int(signals[fixture.bypass.signal]) == fixture.bypass.open
        place = self._status.fixture_position
        assert place is not None
        position = place.to_si(float(signals[place.signal]))
        low, high = self._plant.position_range.get("piston_position", (-math.inf, math.inf))
        if low < position < high and self._plant.can(locked=locked, bypass_open=bypass):
            self._plant.set_up({"piston_position": position}, locked=locked, bypass_open=bypass)
            self._status.fixture_done = request
            self._sampled_at = -math.inf
            self._heartbeat_due = -math.inf

    # --- time -----------------------------------------------------------------

    def pass_time(self, now: float) -> None:
        """Do what is due by now."""
        self._begin_faults(now)
        while self._late and self._late[0][0] <= now:
            self._send(self._late.popleft()[1])
        self._watch(now)
        if now >= self._cycle_due:
            self._look(now)
            if self._drive.sync is None:
                self._alive += 1
                self._send_status(self._alive, now)
            period = _PERIOD if self._words.watched or self._drive.sync is None else _IDLE
            self._cycle_due = max(self._cycle_due + period, now)
        due = now - self._controlled_at >= _CATCH_UP * _PERIOD
        if self._words.enabled and self._controller is not None and due:
            self._control(now)
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + _HEARTBEAT
            if self._drive.sync is not None and now - self._synced_at > _UNASKED:
                self._look(now)  # for whoever only listens
                self._send_status(0, now)
            for frame in self._status.by_itself(now, self._fault_code):
                self._send(frame)

    def _watch(self, now: float) -> None:
        """Take the torque off at the very moment at which the watchdog runs out."""
        limit = self._patience
        if self._words.watched and now >= limit:
            self._advance(max(limit, self._plant.now))
            self._fail("no command for too long", limit)

    def _look(self, now: float) -> None:
        """Read the sensors, and keep the drive's own limits."""
        self._advance(now)
        if now - self._sampled_at >= 0.2 * _PERIOD:
            self._sample = self._faults.faulty_readings(self._plant.sample())
            self._sampled_at = now
        truth = self._plant.truth
        if not self._words.enabled:
            return
        pressures = (truth.get("pressure_a", 0.0), truth.get("pressure_b", 0.0))
        if max(pressures) > self._limits.pressure:
            self._fail("over-pressure", now)
        elif abs(truth.get("motor_speed", 0.0)) > self._limits.speed:
            self._fail("over-speed", now)
        elif abs(truth.get("current", 0.0)) > self._plant.most_current:
            self._fail("over-current", now)
        elif not self._stop_is_closed():
            self._fail("emergency stop", now)

    def _advance(self, now: float) -> None:
        before = self._plant.now
        self._plant.advance(now, self._given if self._words.enabled else 0.0)
        raised = self._faults.active(FaultKind.OVER_PRESSURE)
        if raised is not None and self._words.enabled:
            self._plant.shift("pressure_a", raised.value * max(now - before, 0.0))

    def _control(self, now: float) -> None:
        """Let the drive's own controller act, in set-point mode."""
        if self._controller is None:
            return
        if now - self._sampled_at >= 0.5 * _PERIOD:
            self._look(now)
        reading = dict(self._sample)
        if {"pressure_a", "pressure_b"} <= reading.keys():
            reading["pressure_difference"] = reading["pressure_a"] - reading["pressure_b"]
        wanted = self._controller.step(self._reference, reading)
        self._given = wanted if math.isfinite(wanted) else 0.0
        self._controlled_at = now

    def _begin_mode(self, mode: ControlMode) -> None:
        self._mode, self._controller = mode, None
        if mode != self._drive.command:
            context = Context(
                _PERIOD,
                self._plant.command_limit,
                self._plant.linkage,
                self._plant.command,
                self._plant.command_unit,
                mode.channel,
                mode.unit,
            )
            try:
                self._controller = self._controllers.make(mode, context)
            except EhaBenchError as error:
                self._fail(str(error), self._plant.now)

    # --- faults and the log ------------------------------------------------------

    def _begin_faults(self, now: float) -> None:
        for text in self._faults.update(now):
            self._log.write(now, "injected", fault=text)

    def _stop_is_closed(self) -> bool:
        return self._faults.active(FaultKind.EMERGENCY_STOP) is None

    def _fail(self, reason: str, at: float) -> None:
        if self._words.state == "fault":
            return
        was = self._words.state
        self._words.fail()
        self._fault_code = self._status.code_of(reason)
        self._heartbeat_due = -math.inf
        self._follow_state_change(was, at, reason)

    def _follow_state_change(self, was: str, at: float, reason: str) -> None:
        state = self._words.state
        if state == "enabled":
            self._begin_mode(self._mode)
            self._faults.torque_on(at)
            self._log.write(at, "torque on", reason=reason)
        else:
            self._given, self._controller = 0.0, None
        if was == "fault":
            self._fault_code = 0
        facts: Mapping[str, object] = {"last_command": round(self._last_command, 6)}
        if was == "enabled":
            if self._commands:
                facts = {**facts, "dead_time": round(self._waited / self._commands, 6)}
            self._waited = self._commands = 0.0
            self._log.write(at, "torque off", reason=reason, **facts)
        self._log.write(at, "state", was=was, now=state, reason=reason)

    def _send(self, frame: Frame) -> None:
        if not (self._faults.active(FaultKind.SILENT) or self._faults.active(FaultKind.BUS_OFF)):
            self._out.append(frame)
