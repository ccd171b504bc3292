"""The simulator: a model under a controller, with a rig's sensors, tick by tick."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from eha_bench.control.controller import Context, Controller, NoGains
from eha_bench.control.controller_file import ControllerSet, load_controllers
from eha_bench.control.open_loop import OpenLoop
from eha_bench.core import yaml_file
from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Place
from eha_bench.core.limit import Bounds
from eha_bench.core.shipped import shipped_file
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel
from eha_bench.plants.model import Model, model_from
from eha_bench.plants.session import Session
from eha_bench.targets.channel_check import check_channels
from eha_bench.targets.closed_loop import ClosedLoop
from eha_bench.targets.sensors import RIG_SENSORS, SimulatedSensor, check_sensors
from eha_bench.targets.target import Identity, Outcome, Stopping, Target, never

# a quarter of the step at which the load's oscillation on the oil spring is integrated to 1e-4
DEFAULT_STEP = 12.5e-6
DEFAULT_CONTROLLERS = "controllers/paper.yaml"
_CLOSER = 101
"""Moments between two samples at which it is looked whether a reference jumps."""


class SimulatorFile(StrictModel):
    """A target.yaml for the simulator."""

    target: Annotated[str, Field(pattern="^simulator$")]
    model: Annotated[str, Field(description="model.yaml, relative to this file")]
    controller: Annotated[str, Field(description="controller.yaml, relative to this file")] = ""
    sensors: Annotated[
        dict[str, SimulatedSensor] | None,
        Field(description="by channel; a rig's sensors by default"),
    ] = None
    step: Annotated[
        float, Unit("s"), Field(gt=0, le=1e-3, description="largest integration step")
    ] = DEFAULT_STEP


class Simulator(Target):
    """Runs trials on a model in simulated time."""

    def __init__(
        self,
        model: Model,
        controllers: ControllerSet,
        *,
        sensors: dict[str, SimulatedSensor] | None = None,
        step: float = DEFAULT_STEP,
        name: str = "simulator",
    ) -> None:
        plant = model.plant
        plant.check_session(command=next(iter(plant.imposable_motions), ""))
        self._plant = plant
        self._model = model
        self._vector = model.vector()
        self._controllers = controllers
        self._sensors = RIG_SENSORS if sensors is None else sensors
        self._step = step
        self._name = name

    @property
    def identity(self) -> Identity:
        """Digests of model and controller, and both as files."""
        return Identity(
            self._name,
            {"model_sha256": self._model.sha256, "controller_sha256": self._controllers.sha256},
            {
                "model.yaml": self._model.to_yaml().encode(),
                "controller.yaml": self._controllers.text.encode(),
            },
        )

    @property
    def concurrent(self) -> bool:
        """A simulation has no hardware to share."""
        return True

    @property
    def model(self) -> Model:
        """What is simulated."""
        return self._model

    @property
    def controllers(self) -> ControllerSet:
        """What closes the loop."""
        return self._controllers

    @property
    def sensors(self) -> dict[str, SimulatedSensor]:
        """What is read, and how well, by channel."""
        return self._sensors

    def varied(
        self,
        model: Model | None = None,
        controllers: ControllerSet | None = None,
        sensors: dict[str, SimulatedSensor] | None = None,
    ) -> Simulator:
        """Return the same simulator with another model, other controllers or other sensors."""
        return Simulator(
            model or self._model,
            controllers or self._controllers,
            sensors=self._sensors if sensors is None else sensors,
            step=self._step,
            name=self._name,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes without the compiled kernel, which each has itself."""
        return _again, (self._model, self._controllers, self._sensors, self._step, self._name)

    def reach(self, channel: str) -> Bounds:
        """How far the model's positions go."""
        low, high = self._plant.position_range(self._vector).get(channel, (-math.inf, math.inf))
        return Bounds(low, high)

    def imposes(self, trial: Trial) -> bool:
        """Whether a trial imposes a motion: no controller closes a loop there."""
        return self._command(trial) in self._plant.imposable_motions

    def check(self, trial: Trial) -> None:
        """Refuse a trial that cannot be run.

        Raises:
            InputError: there is no controller for its mode, or one for a motion that it imposes; no
                such start; or an imposed position that jumps.
        """
        command = self._command(trial)
        held = {*self._plant.inputs} - {command}
        try:
            self._plant.check_session(
                command=command,
                locked=trial.setup.piston is Piston.LOCKED,
                bypass_open=trial.setup.bypass is Bypass.OPEN,
            )
        except InputError as error:
            what = f"trial '{trial.id}' cannot be run: {error.what}"
            raise InputError(what, where=trial.mode.where, hint=error.hint) from error
        check_channels(trial, self.units, self._plant.id, command, held)
        if self.imposes(trial):
            self._check_imposed(trial)
        self._controller(trial)
        self._initial(trial)

    def _check_imposed(self, trial: Trial) -> None:
        """Refuse what an imposed motion cannot be."""
        mode, file = trial.mode.name, self._controllers.name
        if mode in self._controllers.by_mode and file != str(shipped_file(DEFAULT_CONTROLLERS)):
            raise InputError(
                f"trial '{trial.id}' imposes {mode}, and the controller for that mode would do "
                "nothing",
                where=Place(file=file, key=mode),
                hint=f"remove the block '{mode}:', or give the model an input that is commanded",
            )
        if trial.mode.channel not in self._plant.roles.rate_of:
            return
        jump = _jump_of(trial)
        if jump is not None:
            raise InputError(
                f"trial '{trial.id}' lets the imposed {mode} jump at {jump:.4g} s, which no part "
                "can follow",
                where=trial.mode.where,
                hint="use a signal that does not jump, such as a ramp, a sine or a chirp",
            )

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat; the same trial, repeat and files give the same recording."""
        command = self._command(trial)
        session = Session(
            self._plant,
            self._vector,
            self._initial(trial),
            locked=trial.setup.piston is Piston.LOCKED,
            bypass_open=trial.setup.bypass is Bypass.OPEN,
            step=self._step,
            start=float(trial.clock()[0]),
            command=command,
        )
        loop = ClosedLoop(
            trial,
            repeat,
            session.channels,
            self._controller(trial),
            self._sensors,
            self._constants(),
            {name: unit for name, unit in self.units.items() if name not in CHANNELS},
            "" if self.imposes(trial) else command,
        )
        return loop.run(session, stopping)

    def _controller(self, trial: Trial) -> Controller:
        """Return what closes the trial's loop; a motion that is imposed has none to close.

        Raises:
            InputError: the revision has no controller for that mode.
        """
        context = self._context(trial)
        if self.imposes(trial):
            return OpenLoop(NoGains(), context)
        return self._controllers.make(trial.mode, context)

    def _constants(self) -> dict[str, str]:
        """Return the plant's parameters, SI, as metadata: identification needs some of them."""
        names = (parameter.name for parameter in self._plant.layout.parameters)
        return {f"model.{name}": repr(self._model.value(name)) for name in names}

    def _context(self, trial: Trial) -> Context:
        plant, vector, command = self._plant, self._vector, self._command(trial)
        own = command == plant.command
        return Context(
            period=1.0 / trial.sample_rate,
            command_limit=plant.command_limit(vector) if own else math.inf,
            linkage=plant.linkage(vector),
            command=command,
            command_unit=plant.units[command],
            channel=trial.channel,
            unit=self.units.get(trial.channel, trial.mode.unit),
        )

    def _command(self, trial: Trial) -> str:
        """Return what a trial gives: the plant's command, or what a loop inside it follows.

        A motion where nothing commands the plant, "" where that cannot be imposed.
        """
        asked, plant = trial.mode.channel, self._plant
        return asked if asked in (*plant.references, *plant.imposable_motions) else plant.command

    @property
    def units(self) -> dict[str, str]:
        """SI unit of everything that a trial may name."""
        plant = self._plant
        names = (plant.command, *plant.references, *plant.outputs, *plant.derived_channels)
        found = {name: plant.units[name] for name in names if name}
        if {"pressure_a", "pressure_b"} <= found.keys():
            found["pressure_difference"] = unit_of("pressure_difference")
        return found

    def _initial(self, trial: Trial) -> dict[str, float]:
        """Return the state a trial starts from: where it says, or where its reference starts.

        Raises:
            InputError: the plant has no such state, or the start is outside its range.
        """
        plant, ranges = self._plant, self._plant.position_range(self._vector)
        asked, places = dict(trial.setup.initial), trial.setup.places
        follows = trial.channel in plant.references and plant.followed_by(trial.channel)
        moved = follows or trial.channel
        led = moved in ranges or (self.imposes(trial) and moved in plant.roles.rate_of)
        if not asked and trial.setup.piston is Piston.FREE and led:
            asked[moved] = float(trial.reference(np.zeros(1))[0])
        initial = {name: value for name, value in asked.items() if name in plant.states}
        for name, value in asked.items():
            if name not in initial:
                behind = plant.behind(self._vector, {**initial, name: value})
                if not behind:
                    raise InputError(
                        f"trial '{trial.id}' starts at a {name}, which is not a state of "
                        f"{plant.id}",
                        where=places.get(name),
                        hint=f"it has: {', '.join((*plant.states, *ranges))}",
                    )
                initial |= behind
        for name, value in {**asked, **initial}.items():
            low, high = ranges.get(name, (-math.inf, math.inf))
            if value <= low or value >= high:
                unit = plant.units[name]
                raise InputError(
                    f"trial '{trial.id}' starts at a {name} of {value:g} {unit}, outside its range",
                    where=places.get(name),
                    hint=f"it can be between {low:.4g} and {high:.4g} {unit}",
                )
        return plant.unbent(initial)


def _jump_of(trial: Trial) -> float | None:
    """Return when a reference jumps most, s on the trial's clock; None where it never does.

    Between two samples a jump stays as large however closely one looks.
    """
    clock = trial.clock()
    steps = np.abs(np.diff(trial.reference(clock)))
    if not steps.size or not steps.max() > 0.0:
        return None
    at = int(steps.argmax())
    closer = trial.reference(np.linspace(clock[at], clock[at + 1], _CLOSER))
    return float(clock[at + 1]) if np.abs(np.diff(closer)).max() > 0.5 * steps[at] else None


def _again(
    model: Model,
    controllers: ControllerSet,
    sensors: dict[str, SimulatedSensor],
    step: float,
    name: str,
) -> Simulator:
    return Simulator(model, controllers, sensors=sensors, step=step, name=name)


def simulator_from_file(path: Path) -> Simulator:
    """Return the simulator that a target.yaml describes.

    Raises:
        InputError: with file, line and key.
    """
    content = yaml_file.load(path)
    file = yaml_file.validate(SimulatorFile, content, str(path), kind="target")
    model = model_from(yaml_file.file_beside(path, content, "model"))

    def place_of(channel: str) -> Place:
        line = yaml_file.line_of(content, ["sensors", channel])
        return Place(file=str(path), line=line, key=f"sensors.{channel}")

    plant = model.plant
    recorded = (*plant.outputs, *plant.derived_channels)
    check_sensors(file.sensors or {}, recorded, plant.units, place_of)
    own = yaml_file.file_beside(path, content, "controller") if file.controller else None
    return Simulator(
        model,
        load_controllers(own or shipped_file(DEFAULT_CONTROLLERS)),
        sensors=file.sensors,
        step=file.step,
        name=f"simulator:{path.stem}",
    )


def default_simulator(model: Path | None = None, controller: Path | None = None) -> Simulator:
    """Return the simulator with the shipped model and controller, or those given."""
    chosen = model or shipped_file("models/paper.yaml")
    return Simulator(
        model_from(chosen), load_controllers(controller or shipped_file(DEFAULT_CONTROLLERS))
    )


def from_file(path: Path, content: Any) -> Simulator:
    """Entry point of `target: simulator`."""
    del content
    return simulator_from_file(path)
