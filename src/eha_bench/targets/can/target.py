"""The target `can`: trials on a drive behind a CAN adapter, safe whatever happens."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from eha_bench.control.controller import Context
from eha_bench.control.controller_file import ControllerSet, load_controllers
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place, TargetFault
from eha_bench.core.linkage import Linkage
from eha_bench.core.shipped import shipped_file
from eha_bench.core.trial import ControlMode, Piston, Trial, command_of, passes_on
from eha_bench.plants.model import Model, model_from
from eha_bench.targets.can.adapter import adapter_of
from eha_bench.targets.can.balance import TorqueModel
from eha_bench.targets.can.bus import Bus, check_channel
from eha_bench.targets.can.drive import CanDrive
from eha_bench.targets.can.guard import GuardLimits
from eha_bench.targets.can.hold import Hold
from eha_bench.targets.can.link import Link
from eha_bench.targets.can.load import load_drive
from eha_bench.targets.can.pacing import LoopHealth, RealTime
from eha_bench.targets.can.plan import DrivePlan
from eha_bench.targets.can.preview import preview
from eha_bench.targets.can.recorder import Recorder
from eha_bench.targets.can.target_file import ControlPlace
from eha_bench.targets.can.trial_run import TrialRun
from eha_bench.targets.channel_check import check_channels
from eha_bench.targets.target import Ending, Identity, Journal, Outcome, Stopping, Target, never


class CanTarget(Target):
    """Runs trials on the drive that a DBC and a target.yaml describe."""

    def __init__(self, drive: CanDrive) -> None:
        """Read what the target names; the bus is opened on entering.

        Raises:
            InputError: model, controller or limits are wrong.
        """
        self._drive = drive
        self._model = model_from(drive.model) if drive.model else None
        self._controllers = _controllers(drive)
        self._limits = GuardLimits.of(drive, _torque_model(drive, self._model))
        self._linkage = _linkage(self._model)
        self._hold = Hold(drive.file.name, adapter_of(drive.file.bus))
        self._bus: Bus | None = None
        self._recorder: Recorder | None = None
        self._journal: Journal | None = None
        self._run: TrialRun | None = None

    @property
    def drive(self) -> CanDrive:
        """The drive's description."""
        return self._drive

    @property
    def identity(self) -> Identity:
        """Digests of target and DBC, of model and controller; all of them as files."""
        files = {"target.yaml": self._drive.path.read_bytes(), "drive.dbc": self._dbc()}
        digests = {
            "target_sha256": hashlib.sha256(files["target.yaml"]).hexdigest(),
            "dbc_sha256": hashlib.sha256(files["drive.dbc"]).hexdigest(),
        }
        if self._model is not None:
            files["model.yaml"] = self._model.to_yaml().encode()
            digests["model_sha256"] = self._model.sha256
        if self._drive.file.control is ControlPlace.HOST:
            files["controller.yaml"] = self._controllers.text.encode()
            digests["controller_sha256"] = self._controllers.sha256
        return Identity(f"can:{self._drive.file.name}", digests, files)

    def _dbc(self) -> bytes:
        return self._drive.dbc.read_bytes()

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of what the drive reports, and of what is derived from that."""
        drive = self._drive
        return {**drive.units, **{name: unit_of(name) for name in _derived_channels(drive)}}

    # --- before anything moves ----------------------------------------------

    def check(self, trial: Trial) -> None:
        """Raise an InputError if the drive, the fixture or the controller cannot run the trial."""
        drive = self._drive
        check_channels(trial, self.units, f"the drive {drive.file.name}", _command(drive))
        plan = self._plan(trial)
        fixed = self._drive.file.setup
        if self._drive.file.fixture is None and fixed is not None:
            found = (trial.setup.piston, trial.setup.bypass)
            if found != (fixed.piston, fixed.bypass):
                raise InputError(
                    f"trial '{trial.id}' needs the piston {found[0].value} and the bypass "
                    f"{found[1].value}; the rig is set up with {fixed.piston.value} and "
                    f"{fixed.bypass.value}",
                    where=Place(file=str(self._drive.path), key="setup"),
                    hint="set the rig up again and say so under `setup:`",
                )
        measured = {*self._drive.channels, "pressure_difference"}
        for limit in trial.safety:
            if limit.channel not in measured:
                raise InputError(
                    f"trial '{trial.id}' has a safety limit on {limit.channel}, which the drive "
                    "does not measure",
                    where=Place(file=str(self._drive.path), key="channels"),
                )
        del plan

    def preview(self, trial: Trial) -> tuple[str, ...]:
        """Return the frames that a run would send."""
        plan = self._plan(trial)
        return preview(
            self._drive, plan.mode, trial, plan.position, plan.command_limit, self._limits
        )

    def _plan(self, trial: Trial) -> DrivePlan:
        host = self._drive.file.control is ControlPlace.HOST
        mode = (self._drive.command or ControlMode.CURRENT) if host else self._mode_of(trial)
        where = Place(file=str(self._drive.path), key="commands")
        if mode not in self._drive.commands:
            raise InputError(f"the drive has no command for mode '{mode.name}'", where=where)
        direct = mode == self._drive.command
        limit = self._command_limit(mode) if direct else math.inf
        controller = None
        if not host:
            self._check_range(trial)
        if host:
            context = Context(
                1.0 / trial.sample_rate,
                limit,
                self._linkage,
                command_of(mode),
                mode.unit,
                trial.channel,
                self._drive.units.get(trial.channel, trial.mode.unit),
            )
            controller = self._controllers.make(trial.mode, context)
        return DrivePlan(
            trial, mode, controller, command_of(mode) if direct else "", limit,
            self._position(trial), self._linkage, self._limits, self._constants(),
        )  # fmt: skip

    def _mode_of(self, trial: Trial) -> ControlMode:
        """Return the mode of the drive's that a trial asks for, where it names the command too."""
        own = self._drive.command
        return own if own and passes_on(trial.mode, command_of(own)) else trial.mode

    def _check_range(self, trial: Trial) -> None:
        """Refuse a reference that the drive's command cannot hold."""
        values = trial.reference(trial.clock())
        coding = self._drive.commands[self._mode_of(trial)].coding
        ends = sorted(coding.to_si(end) for end in (coding.low, coding.high))
        if not ends[0] <= values.min() <= values.max() <= ends[1]:
            raise InputError(
                f"trial '{trial.id}' asks for {values.min():g} .. {values.max():g} "
                f"{trial.mode.unit}, and signal {coding.signal} holds {ends[0]:g} .. {ends[1]:g}",
                where=Place(file=str(self._drive.dbc)),
            )

    def _command_limit(self, mode: ControlMode) -> float:
        """Return what may be asked for: by the model, the limits and what the signal can hold."""
        found: list[float] = []
        if self._model is not None and self._model.plant.command == command_of(mode):
            found.append(self._model.plant.command_limit(self._model.vector()))
        command = self._drive.commands[mode]
        found.append(abs(command.coding.to_si(command.coding.high)))
        found += [item.high for item in self._limits.channels if item.channel == mode.channel]
        return min(found, default=math.inf)

    def _constants(self) -> dict[str, str]:
        """Return the nominal parameters, SI, as metadata: identification needs some of them."""
        if self._model is None:
            return {}
        names = (parameter.name for parameter in self._model.plant.layout.parameters)
        return {f"model.{name}": repr(self._model.value(name)) for name in names}

    def _position(self, trial: Trial) -> float:
        """Return where the rod starts: where the trial says, or where its reference starts."""
        initial = dict(trial.setup.initial)
        angle = initial.get("joint_angle")
        first = float(trial.reference(np.zeros(1))[0])
        if not initial and trial.setup.piston is Piston.FREE:
            if trial.channel == "joint_angle":
                angle = first
            elif trial.channel == "piston_position":
                return first
        if angle is None:
            return initial.get("piston_position", 0.0)
        if self._linkage is None:
            raise InputError(
                f"trial '{trial.id}' starts at a joint angle, and the rig's joint is not known",
                where=Place(file=str(self._drive.path), key="model"),
                hint="name a model.yaml with link_a, link_b, and link_c0 or link_length",
            )
        return self._linkage.position_at(angle)

    # --- the run --------------------------------------------------------------

    def __enter__(self) -> Self:
        """Lock the rig, refuse a latched one, open the bus, start the recorder.

        Raises:
            TargetFault: the rig is in use or latched, or the bus cannot be opened.
        """
        check_channel(self._drive.file.bus)
        self._hold.take()
        try:
            self._hold.check()
            self._recorder = Recorder(real_time=self._drive.file.loop.priority > 0)
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the drive in its safe state and let go of the rig."""
        try:
            self.make_safe()
        finally:
            self._release()

    def make_safe(self) -> None:
        """Take the torque off, once more; the latch stays if that was needed."""
        if self._run is not None and self._bus is not None:
            self._run.make_safe()

    def _release(self) -> None:
        self._run = None
        if self._bus is not None:
            self._bus.close()
            self._bus = None
        if self._recorder is not None:
            self._recorder.stop()
            self._recorder = None
        self._hold.let_go()

    def keep_journal(self, journal: Journal) -> None:
        """Write the next run there, tick by tick."""
        self._journal = journal

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat on the rig; a rig that is not held yet is held for this run alone."""
        if self._recorder is None:
            with self:
                return self.run(trial, repeat, stopping)
        del repeat  # the rig's noise is its own
        plan = self._plan(trial)
        file = self._drive.file.loop
        period = 1.0 / trial.sample_rate
        try:
            if self._bus is None:
                self._bus = Bus(self._drive.file.bus)
                Link(self._drive, self._bus, period).begin()
            link = Link(self._drive, self._bus, period)
        except TargetFault as error:
            return self._not_there(trial, str(error))
        health = LoopHealth(
            trial.clock().size, period, len(self._drive.status) if self._drive.sync else 0
        )
        with RealTime(file.priority) as real_time:
            run = TrialRun(
                plan, link, stopping, health, real_time.scheduling, self._recorder.append,
                lambda: self._hold.arm(trial.id), self._recorder.watch,
            )  # fmt: skip
            self._run = run
            epoch = time.time_ns()
            self._open_journal(run, epoch)
            outcome = run.run()
            self._run = None
        failed = self._close_journal(outcome)
        if failed and outcome.ending is Ending.COMPLETE:
            outcome = Outcome(outcome.recording, Ending.FAULT, failed)
        self._settle_latch(run, outcome)
        if outcome.ending is not Ending.COMPLETE:
            # an adapter that came back is opened again
            self._bus.close()
            self._bus = None
        return outcome

    def _not_there(self, trial: Trial, reason: str) -> Outcome:
        from eha_bench.core.recording import Recording

        del trial
        return Outcome(Recording(np.zeros(0), {}), Ending.INFRASTRUCTURE, reason)

    def _open_journal(self, run: TrialRun, epoch_ns: int) -> None:
        journal, recorder = self._journal, self._recorder
        assert recorder is not None
        if journal is None:
            run.append = _nowhere
            return
        units = run.units
        metadata = {**journal.metadata, **run.metadata(run.plan.trial.clock())}
        recorder.open(journal.path, units, epoch_ns, metadata, journal.attachments)

    def _close_journal(self, outcome: Outcome) -> str:
        journal, recorder = self._journal, self._recorder
        malformed = self._bus.malformed if self._bus is not None else 0
        assert recorder is not None
        self._journal = None
        if journal is None:
            return ""
        return recorder.close(
            {
                **journal.metadata,
                **outcome.recording.metadata,
                **({"adapter_lines_malformed": str(malformed)} if malformed else {}),
                "ending": outcome.ending.value,
                "ending_reason": outcome.reason,
            }
        )

    def _settle_latch(self, run: TrialRun, outcome: Outcome) -> None:
        """Latch the rig if the run did not end well; a person's Ctrl-C is no reason for it."""
        if not run.armed:
            return
        if outcome.ending in (Ending.COMPLETE, Ending.INTERRUPTED) and not run.safe:
            self._hold.disarm()
            return
        trial = run.plan.trial.id
        with suppress(TargetFault):  # it stays armed, which latches it as well
            self._hold.set(f"{outcome.ending.value} in trial '{trial}': {outcome.reason}")

    # --- for people -------------------------------------------------------------

    def clear(self, by: str) -> str:
        """Clear the latch and the drive's fault for a person; return what was cleared.

        Raises:
            TargetFault: the rig is in use, does not answer, or stays in fault.
        """
        self._hold.take()
        try:
            done = self._clear_drive()
            latch = self._hold.clear(by)
            if latch is not None:
                done = f"{done}; the latch reads: {latch}"
            return done
        finally:
            self._release()

    def _clear_drive(self) -> str:
        self._bus = Bus(self._drive.file.bus)
        link = Link(self._drive, self._bus, 2e-3)
        link.begin()
        drive, until = self._drive, time.monotonic() + self._drive.file.start.timeout
        mode = next(iter(drive.commands))
        was = ""
        while time.monotonic() < until:
            now = time.monotonic()
            link.exchange(now, now + 2e-3)
            was = was or link.state
            if link.state and link.state != "fault":
                return f"the drive is '{link.state}'" + (", it was in fault" * (was == "fault"))
            if link.state == "fault":
                link.command(mode, 0.0, drive.file.control_word.disable)
                link.command(mode, 0.0, drive.file.control_word.reset)
            time.sleep(2e-3)
        if link.state == "fault":
            raise TargetFault("the drive stays in fault", hint="its cause is still there")
        raise TargetFault("the drive does not answer", hint="check its supply and the bus")


def _controllers(drive: CanDrive) -> ControllerSet:
    return load_controllers(drive.controller or shipped_file("controllers/paper.yaml"))


def _torque_model(drive: CanDrive, model: Model | None) -> TorqueModel | None:
    """Return what the balances need of the nominal model; None where none is checked."""
    balance = drive.file.balance
    if balance.torque is None and balance.motion is None:
        return None
    names = ("torque_constant", "pump_displacement", "viscous_torque", "rotor_inertia")
    if model is None or any(name not in model.plant.layout.by_key for name in names):
        raise InputError(
            "a balance needs the rig's nominal model",
            where=Place(file=str(drive.path), key="balance"),
            hint=f"name a model.yaml of a plant with {', '.join(names)} under `model:`",
        )
    return TorqueModel(*(model.value(name) for name in names))


def _linkage(model: Model | None) -> Linkage | None:
    """Return the joint that a model describes, None where it has none."""
    return None if model is None else model.plant.linkage(model.vector())


def _nowhere(time: float, values: Sequence[float]) -> None:
    """Keep no journal of a tick."""


def _derived_channels(drive: CanDrive) -> tuple[str, ...]:
    both = {"pressure_a", "pressure_b"} <= set(drive.channels)
    return ("pressure_difference",) if both else ()


def _command(drive: CanDrive) -> str:
    return "" if drive.command is None else command_of(drive.command)


def from_file(path: Path, content: Any) -> CanTarget:
    """Entry point of `target: can`."""
    del content
    return CanTarget(load_drive(path))
