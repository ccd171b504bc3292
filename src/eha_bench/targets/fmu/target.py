"""The target `fmu`: trials on a co-simulation FMU, under the same controllers and scores."""

from __future__ import annotations

import hashlib
import math
import weakref
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.control.controller import Context
from eha_bench.control.controller_file import load_controllers
from eha_bench.core import yaml_file
from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Place, TargetFault, UnitError
from eha_bench.core.linkage import Linkage
from eha_bench.core.near_miss import likely
from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.core.temporary_folder import TemporaryFolder
from eha_bench.core.trial import COMMANDS, Bypass, Piston, Setup, Trial
from eha_bench.core.units import base_unit
from eha_bench.plants.model import Model, model_from
from eha_bench.targets.channel_check import check_channels
from eha_bench.targets.closed_loop import ClosedLoop
from eha_bench.targets.fmu.description import Description, Places, Variable
from eha_bench.targets.fmu.process import Process
from eha_bench.targets.fmu.session import FmuSession
from eha_bench.targets.fmu.target_file import FmuFile, VariableFile
from eha_bench.targets.sensors import check_sensors
from eha_bench.targets.target import Ending, Identity, Outcome, Stopping, Target, never

POSITIONS = ("joint_angle", "piston_position")
"""Channels at whose first reference a free piston starts; so it does at other positions, too."""
_MISSPELT = 0.8


class FmuTarget(Target):
    """Runs trials on a plant in an FMU (FMI 2 or 3, co-simulation)."""

    def __init__(self, path: Path, content: Any) -> None:
        """Read target.yaml, the FMU's model description, and what else the file names.

        Raises:
            InputError: with file, line and key.
        """
        self._path, self._content = path, content
        self._process: Process | None = None
        file = self._file = yaml_file.validate(FmuFile, content, str(path))
        folder = path.resolve().parent
        self._description = Description(folder / file.fmu, self._place("fmu"))
        self._outputs = {
            channel: self._description.output(
                entry.variable,
                entry.unit,
                self._si_unit(channel, entry),
                self._at("outputs", channel),
            )
            for channel, entry in file.outputs.items()
        }
        self._commanded = self._commanded_channel()
        self._command = self._command_variable()
        self._parameters = dict(
            self._description.value(name, given, self._at_value("parameters", name))
            for name, given in file.parameters.items()
        )
        self._initial = {
            channel: self._description.start(
                entry.variable,
                entry.unit,
                self._si_unit(channel, entry, "initial"),
                self._at("initial", channel),
            )
            for channel, entry in file.initial.items()
        }
        self._piston = self._setup_variable("piston")
        self._bypass = self._setup_variable("bypass")
        model = self._beside("model", file.model)
        self._model: Model | None = model_from(model) if model else None
        self._linkage = _linkage(self._model)
        check_sensors(
            file.sensors, self._channels, self.units, lambda name: self._place("sensors", name)
        )
        controller = self._beside("controller", file.controller)
        self._controllers = load_controllers(controller or shipped_file("controllers/paper.yaml"))

    # --- target.yaml ----------------------------------------------------------

    def _place(self, *keys: str) -> Place:
        line = yaml_file.line_of(self._content, keys)
        return Place(file=str(self._path), line=line, key=".".join(keys))

    def _beside(self, key: str, name: str) -> Path | None:
        """Return the file that a key names, relative to target.yaml; None where it names none."""
        folder = self._path.resolve().parent
        return yaml_file.named_file(folder, name, self._place(key)) if name else None

    def _at(self, *keys: str) -> Places:
        return lambda *more: self._place(*keys, *more)

    def _at_value(self, *keys: str) -> Places:
        return lambda *_: self._place(*keys)

    def _si_unit(self, channel: str, entry: VariableFile, key: str = "outputs") -> str:
        """Return the SI unit of a channel; one that is not on the list has that of its variable."""
        if channel in CHANNELS:
            return unit_of(channel)
        try:
            return base_unit(entry.unit or self._description.unit_of(entry.variable))
        except UnitError as error:
            where = self._place(key, channel)
            raise InputError(error.what, where=where, hint="give the variable's `unit`") from error

    def _command_variable(self) -> Variable:
        """Return what the bench commands: the one input that is named."""
        entry = self._file.inputs[self._commanded]
        where = self._at("inputs", self._commanded)
        unit = self._si_unit(self._commanded, entry, "inputs")
        return self._description.input(entry.variable, entry.unit, unit, where)

    def _commanded_channel(self) -> str:
        """Return the name of what the bench commands.

        Raises:
            InputError: none is named, or another one than a command.
        """
        names = tuple(self._file.inputs)
        if not names:
            raise InputError(
                "the FMU needs an input that is commanded",
                where=self._place("inputs"),
                hint="e.g. current_command: {variable: ..., unit: A}",
            )
        command = next((name for name in COMMANDS if name in names), names[0])
        for name in names:
            measured = name in CHANNELS and name not in COMMANDS
            near = "" if name in COMMANDS else likely(name, COMMANDS, likeness=_MISSPELT)
            if name != command or measured or near:
                only = command if name != command else ", ".join((*COMMANDS, "its own"))
                raise InputError(
                    f"'{name}' is not commanded by the bench",
                    where=self._place("inputs", name),
                    hint=near or f"only {only} is; give anything else its value under `parameters`",
                )
        return command

    def _setup_variable(self, what: str) -> Variable | None:
        entry = getattr(self._file.setup, what)
        if entry is None:
            return None
        return self._description.start(entry.variable, None, None, self._at("setup", what))

    # --- what it is -------------------------------------------------------------

    @property
    def identity(self) -> Identity:
        """Digests of FMU and target.yaml, of model and controller; the small ones as files."""
        files = {
            "target.yaml": self._path.read_bytes(),
            "controller.yaml": self._controllers.text.encode(),
        }
        digests = {
            "target_sha256": hashlib.sha256(files["target.yaml"]).hexdigest(),
            "fmu_sha256": self._fmu_sha256,
            "controller_sha256": self._controllers.sha256,
        }
        if self._model is not None:
            files["model.yaml"] = self._model.to_yaml().encode()
            digests["model_sha256"] = self._model.sha256
        return Identity(f"fmu:{self._path.stem}", digests, files)

    @cached_property
    def _fmu_sha256(self) -> str:
        return hashlib.sha256(self._description.path.read_bytes()).hexdigest()

    @property
    def _channels(self) -> tuple[str, ...]:
        """What is recorded: the mapped outputs, and the joint's angle where it follows of them."""
        derived = self._linkage is not None and "piston_position" in self._outputs
        joint = ("joint_angle",) if derived and "joint_angle" not in self._outputs else ()
        return (*self._outputs, *joint)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of everything that a trial may name."""
        outputs = self._file.outputs
        found = {name: self._si_unit(name, entry) for name, entry in outputs.items()}
        command = self._file.inputs[self._commanded]
        found[self._commanded] = self._si_unit(self._commanded, command, "inputs")
        derived = (*self._channels, *_derived_channels(self._channels))
        return found | {name: unit_of(name) for name in derived if name not in found}

    def _constants(self) -> dict[str, str]:
        """Return what the model says of the plant, SI, as metadata: some metrics need it."""
        if self._model is None:
            return {}
        names = (parameter.name for parameter in self._model.plant.layout.parameters)
        return {f"model.{name}": repr(self._model.value(name)) for name in names}

    @property
    def concurrent(self) -> bool:
        """Every copy has a separate process for the FMU."""
        return True

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes as the path of its file."""
        return _again, (self._path.resolve(),)

    # --- before anything runs -----------------------------------------------------

    def check(self, trial: Trial) -> None:
        """Raise an InputError if the FMU cannot be set up so, or the controller lacks a channel."""
        check_channels(trial, self.units, "the FMU", self._commanded)
        self._start_values(trial.setup, trial)
        period = 1.0 / trial.sample_rate
        fixed = self._description.fixed_step
        if (
            fixed is not None
            and abs(period / fixed - round(period / fixed)) > 1e-6 * period / fixed
        ):
            raise InputError(
                f"trial '{trial.id}' ticks every {period * 1e3:g} ms, and the FMU steps by "
                f"{fixed * 1e3:g} ms only",
                where=self._place("fmu"),
                hint="choose a sample_rate whose period is a multiple of the FMU's step",
            )
        reading = dict.fromkeys((*self._channels, *_derived_channels(self._channels)), 0.0)
        for limit in trial.safety:
            if limit.channel not in reading:
                raise InputError(
                    f"trial '{trial.id}' has a safety limit on {limit.channel}, which the FMU does "
                    "not give",
                    where=self._place("outputs"),
                )
        if self._linkage is not None and "joint_angle" in reading:
            reading["joint_angle"] = self._linkage.angle_at(0.0)
        controller = self._controllers.make(trial.mode, self._context(trial))
        try:
            controller.step(float(trial.reference(np.zeros(1))[0]), reading)
        except KeyError as error:
            raise InputError(
                f"trial '{trial.id}': its controller reads {error}, which the FMU does not give",
                where=self._place("outputs"),
                hint=f"map a variable to that channel; there are: {', '.join(reading)}",
            ) from error

    def _context(self, trial: Trial) -> Context:
        units = self.units
        return Context(
            period=1.0 / trial.sample_rate,
            command_limit=self._command_limit,
            linkage=self._linkage,
            command=self._commanded,
            command_unit=units[self._commanded],
            channel=trial.channel,
            unit=units.get(trial.channel, trial.mode.unit),
        )

    @property
    def _command_limit(self) -> float:
        """What the model says that the plant follows; inf where it says nothing of this command."""
        model = self._model
        if model is None or model.plant.command != self._commanded:
            return math.inf
        return model.plant.command_limit(model.vector())

    def _start_values(self, setup: Setup, trial: Trial) -> dict[Variable, float]:
        """Return raw start values: the file's parameters, the trial's setup and first values."""
        values = dict(self._parameters)
        if self._piston is not None and self._file.setup.piston is not None:
            entry = self._file.setup.piston
            values[self._piston] = entry.locked if setup.piston is Piston.LOCKED else entry.free
        elif setup.piston is Piston.LOCKED:
            raise self._cannot(trial, "locks the piston", "setup.piston")
        if self._bypass is not None and self._file.setup.bypass is not None:
            valve = self._file.setup.bypass
            values[self._bypass] = valve.open if setup.bypass is Bypass.OPEN else valve.closed
        elif setup.bypass is Bypass.OPEN:
            raise self._cannot(trial, "opens the bypass", "setup.bypass")
        for channel, value in self._first_values(setup, trial).items():
            if channel not in self._initial:
                raise self._cannot(trial, f"starts at a {channel}", f"initial.{channel}")
            values[self._initial[channel]] = self._initial[channel].raw(value)
        return values

    def _first_values(self, setup: Setup, trial: Trial) -> dict[str, float]:
        """Return the first values a trial asks for, or that its reference starts with."""
        found = dict(setup.initial)
        first = float(trial.reference(np.zeros(1))[0])
        own = trial.channel in self._initial and self.units[trial.channel] in ("m", "rad")
        if not found and setup.piston is Piston.FREE and (own or trial.channel in POSITIONS):
            found[trial.channel] = first
        angle = found.get("joint_angle")
        if angle is not None and "joint_angle" not in self._initial:
            if self._linkage is None or "piston_position" not in self._initial:
                return found
            del found["joint_angle"]
            found["piston_position"] = self._linkage.position_at(angle)
        return found

    def _cannot(self, trial: Trial, wants: str, key: str) -> InputError:
        return InputError(
            f"trial '{trial.id}' {wants}, and the target has no FMU input for it",
            where=Place(file=str(self._path)),
            hint=f"name the FMU's variable under `{key}`",
        )

    # --- the run --------------------------------------------------------------------

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat on a fresh instance; what the FMU reports as an error is a fault."""
        clock = trial.clock()
        loop = ClosedLoop(
            trial,
            repeat,
            self._channels,
            self._controllers.make(trial.mode, self._context(trial)),
            self._file.sensors,
            self._constants(),
            {name: unit for name, unit in self.units.items() if name not in CHANNELS},
            self._commanded,
        )  # fmt: skip
        try:
            library = self._process_of(stopping)
        except TargetFault as fault:
            return _no_recording(Ending.FAULT, str(fault))
        except KeyboardInterrupt:
            return _no_recording(Ending.INTERRUPTED, "interrupted")
        try:
            return loop.run(self._session(library, trial, clock), stopping)
        except TargetFault as fault:  # it came to no first reading
            return _no_recording(Ending.FAULT, str(fault))
        except KeyboardInterrupt:
            return _no_recording(Ending.INTERRUPTED, "interrupted")
        finally:
            library.stop()

    def _process_of(self, stopping: Stopping) -> Process:
        """Return the FMU's process; a new one where the last one crashed."""
        if self._process is None or not self._process.alive:
            self._process = Process(
                self._description.binary, self._folder.path, self._file.answers_within, stopping
            )
            weakref.finalize(self, self._process.close)
        self._process.stopping = stopping
        return self._process

    @cached_property
    def _folder(self) -> TemporaryFolder:
        import fmpy

        folder = TemporaryFolder("eha-bench-fmu-")
        fmpy.extract(str(self._description.path), str(folder.path))
        return folder

    def _session(self, library: Process, trial: Trial, clock: FloatArray) -> FmuSession:
        library.start(float(clock[-1] - clock[0]), self._start_values(trial.setup, trial))
        return FmuSession(
            library, self._command, tuple(self._outputs.values()), tuple(self._outputs),
            self._linkage if len(self._channels) > len(self._outputs) else None,
            float(clock[0]), self._largest_step(),
        )  # fmt: skip

    def _largest_step(self) -> float:
        steps = [self._file.step, self._description.fixed_step]
        return min((step for step in steps if step is not None), default=math.inf)


def _no_recording(ending: Ending, reason: str) -> Outcome:
    return Outcome(Recording(np.empty(0), {}), ending, reason)


def _derived_channels(channels: tuple[str, ...]) -> tuple[str, ...]:
    both = "pressure_a" in channels and "pressure_b" in channels
    return ("pressure_difference",) if both else ()


def _linkage(model: Model | None) -> Linkage | None:
    """Return the joint that a model describes, None where it has none."""
    return None if model is None else model.plant.linkage(model.vector())


def _again(path: Path) -> FmuTarget:
    return FmuTarget(path, yaml_file.load(path))


def from_file(path: Path, content: Any) -> FmuTarget:
    """Entry point of `target: fmu`."""
    return FmuTarget(path, content)
