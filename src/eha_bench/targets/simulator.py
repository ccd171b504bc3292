"""The simulator: a model under a controller, with a rig's sensors, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from eha_bench.control.controller import Context
from eha_bench.control.controller_file import ControllerSet, load_controllers
from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.linkage import Linkage
from eha_bench.core.shipped import shipped
from eha_bench.core.trial import Bypass, ControlMode, Piston, Trial
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel
from eha_bench.plants.eha_knee.plant import EhaKnee, Session
from eha_bench.plants.model import Model, load_model
from eha_bench.targets.closed_loop import ClosedLoop
from eha_bench.targets.sensors import RIG_SENSORS, Sensor
from eha_bench.targets.target import Identity, Outcome, Stopping, Target, never

FloatArray = NDArray[np.float64]

# a quarter of the step at which the load's oscillation on the oil spring is integrated to 1e-4
DEFAULT_STEP = 12.5e-6


class SimulatorFile(StrictModel):
    """A target.yaml for the simulator."""

    target: Annotated[str, Field(pattern="^simulator$")]
    model: Annotated[str, Field(description="model.yaml, relative to this file")]
    controller: Annotated[str, Field(description="controller.yaml, relative to this file")] = ""
    sensors: Annotated[
        dict[str, Sensor] | None, Field(description="by channel; a rig's sensors by default")
    ] = None
    step: Annotated[
        float, Unit("s"), Field(gt=0, le=1e-3, description="largest integration step")
    ] = DEFAULT_STEP


class Simulator(Target):
    """Runs trials on a model of the knee EHA in simulated time."""

    def __init__(
        self,
        model: Model,
        controllers: ControllerSet,
        *,
        sensors: dict[str, Sensor] | None = None,
        step: float = DEFAULT_STEP,
        name: str = "simulator",
    ) -> None:
        plant = model.plant
        if not isinstance(plant, EhaKnee):
            raise InputError(
                f"the simulator runs suites on eha_knee, not on {model.plant_id}",
                hint="a model of that plant is for datasets: give it to `eha-bench predict`, "
                "`calibrate` or `diagnose`",
            )
        self._plant = plant
        self._model = model
        self._controllers = controllers
        self._sensors = RIG_SENSORS if sensors is None else sensors
        self._step = step
        self._name = name
        volume, area = model.value("volume_a"), model.value("piston_area_a")
        self._linkage = Linkage(
            model.value("link_a"), model.value("link_b"), model.value("link_c0"), volume / area
        )

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

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes without the compiled kernel, which each has of its own."""
        return _again, (self._model, self._controllers, self._sensors, self._step, self._name)

    def check(self, trial: Trial) -> None:
        """Raise an InputError if there is no controller for the mode, or no such position."""
        self._controllers.make(trial.mode, self._context(trial))
        self._initial(trial)

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run one repeat; the same trial, repeat and files give the same recording."""
        loop = ClosedLoop(
            trial,
            repeat,
            (*self._plant.outputs, "joint_angle"),
            self._controllers.make(trial.mode, self._context(trial)),
            self._sensors,
            self._constants(),
        )
        session = self._plant.session(
            self._model.vector(),
            trial.clock(),
            self._initial(trial),
            locked=trial.setup.piston is Piston.LOCKED,
            bypass_open=trial.setup.bypass is Bypass.OPEN,
            step=self._step,
        )
        return loop.run(_Knee(session, self._linkage), stopping)

    def _constants(self) -> dict[str, str]:
        """Return the plant's parameters, SI, as metadata: identification needs some of them."""
        names = (parameter.name for parameter in self._plant.layout.parameters)
        return {f"model.{name}": repr(self._model.value(name)) for name in names}

    def _context(self, trial: Trial) -> Context:
        limit = self._model.value("current_limit")
        return Context(1.0 / trial.sample_rate, limit, self._linkage)

    def _initial(self, trial: Trial) -> dict[str, float]:
        """Return the state a trial starts from: where it says, or where its reference starts."""
        initial = dict(trial.setup.initial)
        angle = initial.pop("joint_angle", None)
        first = float(trial.reference(np.zeros(1))[0])
        if not initial and angle is None and trial.setup.piston is Piston.FREE:
            if trial.mode is ControlMode.JOINT_ANGLE:
                angle = first
            elif trial.mode is ControlMode.PISTON_POSITION:
                initial["piston_position"] = first
        if angle is not None:
            initial["piston_position"] = self._linkage.position_at(angle)
        position = initial.get("piston_position", 0.0)
        if abs(position) >= self._linkage.half_stroke:
            raise InputError(
                f"trial '{trial.id}' starts at {position * 1e3:.1f} mm, outside the stroke",
                hint=f"the rod moves within +-{self._linkage.half_stroke * 1e3:.1f} mm",
            )
        return initial


def _again(
    model: Model, controllers: ControllerSet, sensors: dict[str, Sensor], step: float, name: str
) -> Simulator:
    return Simulator(model, controllers, sensors=sensors, step=step, name=name)


@dataclass(frozen=True)
class _Knee:
    """A session of the plant with the encoder at the joint."""

    session: Session
    linkage: Linkage

    @property
    def truth(self) -> FloatArray:
        reading = self.session.reading
        return np.append(reading, self.linkage.angle_at(float(reading[4])))

    def advance(self, command: float) -> None:
        self.session.advance(command)


def simulator_from_file(path: Path) -> Simulator:
    """Return the simulator that a target.yaml describes.

    Raises:
        InputError: with file, line and key.
    """
    content = yaml_file.load(path)
    file = yaml_file.validate(SimulatorFile, content, str(path))
    folder = path.resolve().parent
    for channel, sensor in (file.sensors or {}).items():
        line = yaml_file.line_of(content, ["sensors", channel])
        try:
            sensor.in_si(channel)
        except UnitError as error:
            where = Place(file=str(path), line=line, key=f"sensors.{channel}")
            raise InputError(error.what, where=where, hint=error.hint) from error

    def beside(key: str, name: str) -> Path:
        where = Place(file=str(path), line=yaml_file.line_of(content, [key]), key=key)
        return yaml_file.named_file(folder, name, where)

    model = beside("model", file.model)
    own = beside("controller", file.controller) if file.controller else None
    return Simulator(
        load_model(model),
        load_controllers(own or shipped("controllers/paper.yaml")),
        sensors=file.sensors,
        step=file.step,
        name=f"simulator:{path.stem}",
    )


def default_simulator(model: Path | None = None, controller: Path | None = None) -> Simulator:
    """Return the simulator with the shipped model and controller, or those given."""
    chosen = model or shipped("models/paper.yaml")
    return Simulator(
        load_model(chosen), load_controllers(controller or shipped("controllers/paper.yaml"))
    )


def from_file(path: Path, content: Any) -> Simulator:
    """Entry point of `target: simulator`."""
    del content
    return simulator_from_file(path)
