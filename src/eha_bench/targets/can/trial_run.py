"""One repeat of a trial on the bus: set up, check, enable, run, and always the safe state."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.control.controller import as_command
from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.error_text import error_text
from eha_bench.core.errors import EhaBenchError, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Bypass, Piston
from eha_bench.targets.can.bus import BusLost
from eha_bench.targets.can.guard import Guard
from eha_bench.targets.can.link import DriveAbsent, Link
from eha_bench.targets.can.pacing import LoopHealth, Pacer
from eha_bench.targets.can.plan import DrivePlan
from eha_bench.targets.can.start_checks import StartCheck
from eha_bench.targets.target import Ending, Outcome, Stopping

POSITION_UNITS = ("m", "rad")
"""Units of what a drive positions: it rests where it is, not at 0."""


_SAFE_FRAMES: Final = 5
"""How often the torque is taken off at least: one of the frames may be lost."""
_SAFE_TIMEOUT: Final = 0.1
_LEAST_PERIOD: Final = 1e-3


Append = Callable[[float, list[float]], None]


@dataclass
class _Stop(Exception):
    """The run ends now."""

    ending: Ending
    reason: str


@dataclass
class TrialRun:
    """A repeat in progress.

    Attributes:
        plan: what to run.
        link: the bus.
        health: of the loop.
        scheduling: how the thread runs, for the recording.
        append: takes every tick: time in s, and the values in the order of `channels`.
        arm: called when the torque is about to come on.
        watch: called every few milliseconds while the torque is on; raises what has to end the run.
    """

    plan: DrivePlan
    link: Link
    stopping: Stopping
    health: LoopHealth
    scheduling: str
    append: Append
    arm: Callable[[], None]
    watch: Callable[[], None]
    armed: bool = False
    safe: str = ""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the recording."""
        return (*self.plan.columns, *self.link.drive.channels)

    @property
    def units(self) -> dict[str, str]:
        """SI units of the recording's channels."""
        trial, units = self.plan.trial, self.link.drive.units
        reference = units.get(trial.channel, trial.mode.unit)
        return {name: units.get(name, unit_of(name)) for name in self.channels} | {
            "reference": reference
        }

    @property
    def period(self) -> float:
        """Time between two ticks, s."""
        return 1.0 / self.plan.trial.sample_rate

    def run(self) -> Outcome:
        """Run, take the torque off whatever happens, and return what was recorded."""
        clock = self.plan.trial.clock()
        reference = self.plan.trial.reference(clock)
        table = np.full((clock.size, 1 + len(self.channels)), np.nan)
        loop = _Loop(self, reference, table)
        ending, reason = Ending.COMPLETE, ""
        try:
            self._prepare()
            self._enable()
            loop.run()
        except _Stop as stop:
            ending, reason = stop.ending, stop.reason
        except DriveAbsent as error:
            ending, reason = Ending.INFRASTRUCTURE, str(error)
        except KeyboardInterrupt:
            ending, reason = Ending.INTERRUPTED, "interrupted"
        except (BusLost, RecordingError) as error:
            ending, reason = Ending.FAULT, str(error)
        except EhaBenchError as error:
            ending, reason = Ending.FAULT, str(error)
        except (Exception, SystemExit) as error:  # a plug-in controller may raise anything
            ending, reason = Ending.FAULT, error_text(error)
        finally:
            self.safe = self.make_safe()
        if self.link.state == "fault" and ending is not Ending.COMPLETE:
            reason = self._with_fault_code(reason)
        if self.safe and self.armed:
            ending = Ending.FAULT if ending is Ending.COMPLETE else ending
            reason = "; ".join(part for part in (reason, self.safe) if part)
        return Outcome(self._recording(table[: loop.rows], clock), ending, reason)

    # --- phases ------------------------------------------------------------

    def _prepare(self) -> None:
        """Bring the rig into the trial's setup and look at it before any torque.

        Raises:
            DriveAbsent: it does not answer.
            TargetFault: it is not fit to be run.
        """
        setup = self.plan.trial.setup
        check = StartCheck(self.plan, self.link, self._idle)
        check.answers()
        check.fit()
        check.setup(
            locked=setup.piston is Piston.LOCKED,
            bypass=setup.bypass is Bypass.OPEN,
            position=self.plan.position,
        )
        check.sensors()

    def _idle(self, length: float, done: Callable[[], bool]) -> bool:
        """Exchange frames without a command until `done` or for `length` s."""
        pacer = Pacer(max(self.period, _LEAST_PERIOD))
        tick, until = 0, time.monotonic() + length
        while not done():
            now = pacer.wait(tick)
            if self.stopping():
                raise _Stop(Ending.INTERRUPTED, "interrupted")
            if now > until:
                return False
            self.link.exchange(now, now + self.period * self.link.drive.file.loop.reply)
            tick = pacer.due_tick(time.monotonic()) + 1
        return True

    def _enable(self) -> None:
        """Take the drive through its words to `enabled`, with nothing asked of it."""
        file = self.link.drive.file
        self.arm()
        self.armed = True
        pacer = Pacer(self.period)
        tick, until = 0, time.monotonic() + file.start.enable
        zero = self._rest()
        for step in file.control_word.enable:
            while self.link.state != step.state:
                now = pacer.wait(tick, self.watch)
                self.watch()
                self.link.exchange(now, now + self.period * file.loop.reply)
                if self.link.state == step.state:
                    break
                wrong = self.link.alive(now)
                if not wrong and now > until:
                    wrong = f"it stays '{self.link.state}' instead of '{step.state}'"
                if wrong:
                    raise _Stop(Ending.FAULT, f"the drive cannot be enabled: {wrong}")
                if self.stopping():
                    raise _Stop(Ending.INTERRUPTED, "interrupted")
                self.link.command(self.plan.mode, zero, step.word)
                tick = pacer.due_tick(time.monotonic()) + 1

    def _rest(self) -> float:
        """Return the command at which nothing moves: none, or where what is positioned is."""
        mode = self.plan.mode
        if not self.plan.command and self.link.drive.units[mode.channel] in POSITION_UNITS:
            return self.link.readings.get(mode.channel, 0.0)
        return 0.0

    # --- what ends a run ---------------------------------------------------

    def make_safe(self) -> str:
        """Command zero torque and disable until the drive says so; return what went wrong."""
        drive = self.link.drive
        modes = {self.plan.mode, *([drive.command] if drive.command else [])}
        until = time.monotonic() + _SAFE_TIMEOUT
        sent, failed = 0, ""
        confirmed = False
        while time.monotonic() < until and not (confirmed and sent >= _SAFE_FRAMES):
            now = time.monotonic()
            try:
                for mode in modes:
                    zero = self._rest() if mode != drive.command else 0.0
                    self.link.command(mode, zero, drive.file.control_word.disable)
                sent += 1
                self.link.exchange(now, now + _LEAST_PERIOD)
            except (BusLost, KeyboardInterrupt) as error:
                failed = str(error) or "interrupted"
                if isinstance(error, BusLost):
                    break
            else:
                confirmed = self.link.state not in ("enabled", "") and sent > 1
                time.sleep(max(0.0, now + _LEAST_PERIOD - time.monotonic()))
        if confirmed:
            return ""
        if failed:
            return (
                f"the safe state could not be commanded ({failed}); the drive's watchdog takes over"
            )
        return "the drive did not confirm that its torque is off; its watchdog takes over"

    def _with_fault_code(self, reason: str) -> str:
        """Return the reason with the drive's own code, which may come with its next heartbeat."""
        if not self.link.fault_code and self.link.drive.fault_code is not None:
            try:
                self._idle(0.3, lambda: self.link.fault_code != 0)
            except (EhaBenchError, _Stop):
                return reason
        if self.link.named_code == self.link.fault_code:
            return reason
        return f"{reason}, code {self.link.drive.named_fault(self.link.fault_code)}"

    def _recording(self, table: FloatArray, clock: FloatArray) -> Recording:
        loop = self.link.drive.file.loop
        return Recording(
            time=table[:, 0],
            values={name: table[:, 1 + n] for n, name in enumerate(self.channels)},
            units=self.units,
            metadata={
                **self.metadata(clock),
                **self.health.metadata((loop.overruns, loop.lost, loop.late)),
                "loop_scheduling": self.scheduling,
                "safe_state": self.safe or "confirmed by the drive",
            },
        )

    def metadata(self, clock: FloatArray) -> dict[str, str]:
        """Return what is known before the run."""
        return {
            "signal_start": repr(float(abs(clock[0]))),
            "control": self.link.drive.file.control.value,
            **self.plan.constants,
        }


class _Loop:
    """The ticks of a trial."""

    def __init__(self, run: TrialRun, reference: FloatArray, table: FloatArray) -> None:
        self._run = run
        self._reference = reference.tolist()
        self._table = table
        self._guard = Guard(run.plan.limits, run.plan.trial.safety, run.plan.linkage, run.period)
        self.rows = 0

    def run(self) -> None:
        """Run every tick.

        Raises:
            _Stop: something ends the run before its time.
        """
        run = self._run
        file = run.link.drive.file
        period, reply = run.period, run.period * file.loop.reply
        names = run.link.drive.channels
        readings = run.link.readings
        both = len(run.plan.columns) == 2
        controller, mode = run.plan.controller, run.plan.mode
        limit = run.plan.command_limit
        pacer = Pacer(period, file.loop.spin)
        pacer.begin(time.monotonic() + period)
        word = file.control_word.enable[-1].word
        tick, last, commanded = 0, -1, 0.0
        size = len(self._reference)
        while tick < size:
            now = pacer.wait(tick, run.watch)
            run.health.tick(now, now - pacer.start - tick * period, tick - last - 1)
            last = tick
            run.link.exchange(now, now + reply, run.health)
            wrong = self._wrong(time.monotonic(), commanded, both)
            if not wrong and run.stopping():
                self._record(now - pacer.start, tick, 0.0, both, names)
                raise _Stop(Ending.INTERRUPTED, "interrupted")
            if wrong:
                self._record(now - pacer.start, tick, 0.0, both, names)
                raise _Stop(*wrong)
            value = self._reference[tick]
            if controller is not None:
                value = as_command(controller.step(value, readings))
                if not math.isfinite(value):
                    reason = f"the controller asked for {value} at {now - pacer.start:.4f} s"
                    raise _Stop(Ending.FAULT, reason)
            if both:
                value = min(max(value, -limit), limit)
                commanded = value
            run.link.command(mode, value, word)
            self._record(now - pacer.start, tick, value, both, names)
            tick = max(tick + 1, pacer.due_tick(time.monotonic()))

    def _wrong(self, now: float, commanded: float, follows: bool) -> tuple[Ending, str] | None:
        """Return what ends the run now: the drive first, since its own reason is the better one."""
        link = self._run.link
        wrong = link.alive(now)
        if wrong:
            return Ending.FAULT, wrong
        wrong = self._guard.check(now, link.readings, link.stamps)
        if wrong:
            return Ending.SAFETY_STOP, wrong
        if link.state != "enabled":
            return Ending.FAULT, f"the drive is '{link.state}' instead of 'enabled'"
        wrong = self._guard.follows(now, link.readings, link.stamps, commanded) if follows else ""
        return (Ending.SAFETY_STOP, wrong) if wrong else None

    def _record(
        self, at: float, tick: int, value: float, both: bool, names: tuple[str, ...]
    ) -> None:
        readings = self._run.link.readings
        row = [self._reference[tick], value] if both else [self._reference[tick]]
        row += [readings.get(name, math.nan) for name in names]
        self._table[self.rows, 0] = at
        self._table[self.rows, 1:] = row
        self.rows += 1
        self._run.append(at, row)
