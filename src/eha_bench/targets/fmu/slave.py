"""What an exported FMU does: the knee EHA behind the variables of FMI."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError
from eha_bench.core.linkage import Linkage
from eha_bench.plants.eha_knee.open_session import OpenSession
from eha_bench.plants.eha_knee.plant import EhaKnee
from eha_bench.plants.model import Model, load_model
from eha_bench.targets.simulator import DEFAULT_STEP

DERIVED = ("pressure_difference", "joint_angle")
STARTS = ("motor_speed", "pressure_a", "pressure_b", "piston_position", "piston_velocity")


class Knee:
    """The variables of the FMU as attributes, and the simulation behind them.

    PythonFMU reads and writes an FMU's variables by the functions that `register` gives it.
    """

    def __init__(self, model: Model) -> None:
        """Start with what the model says, at rest.

        Raises:
            InputError: not a knee EHA.
        """
        plant = model.plant
        if not isinstance(plant, EhaKnee):
            raise InputError(
                f"only eha_knee is exported, not {model.plant_id}",
                hint="its simulation runs step by step, as co-simulation needs",
            )
        self._plant, self._model = plant, model
        rest = model.value("initial_pressure")
        self.values: dict[str, float] = {
            "current_command": 0.0,
            "force": 0.0,
            **{own.name: model.value(own.name) for own in plant.layout.parameters},
            **{f"start_{name}": 0.0 for name in STARTS},
            "start_pressure_a": rest,
            "start_pressure_b": rest,
            "integration_step": DEFAULT_STEP,
            "piston_locked": 0.0,
            "bypass_open": 0.0,
            **dict.fromkeys((*plant.outputs, *DERIVED), 0.0),
        }
        self._session: OpenSession | None = None

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every variable, nothing for the switches."""
        found = {parameter.name: parameter.unit for parameter in self._plant.layout.parameters}
        found |= {name: unit_of(name) for name in ("current_command", "force", *self.outputs)}
        return found | {f"start_{name}": unit_of(name) for name in STARTS} | {
            "integration_step": "s", "piston_locked": "", "bypass_open": "",
        }  # fmt: skip

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return (*self._plant.outputs, *DERIVED)

    def description(self, name: str) -> str:
        """Return a sentence on a variable."""
        own = self._plant.layout.by_key.get(name)
        if own is not None:
            return f"{own.symbol} of the paper" if own.symbol else "of the model"
        if name.startswith("start_"):
            return f"what the sensor of {name[6:]} reads at first"
        known = CHANNELS.get(name)
        return known.description if known else name.replace("_", " ")

    def begin(self) -> None:
        """Start the simulation from the values that stand now."""
        values = self.values
        names = [parameter.name for parameter in self._plant.layout.parameters]
        vector = self._model.with_parameters({name: values[name] for name in names}).vector()
        self._linkage = Linkage(
            values["link_a"], values["link_b"], values["link_c0"],
            values["volume_a"] / values["piston_area_a"],
        )  # fmt: skip
        self._session = OpenSession(
            self._plant,
            vector,
            {name: values[f"start_{name}"] for name in STARTS},
            locked=bool(values["piston_locked"]),
            bypass_open=bool(values["bypass_open"]),
            step=values["integration_step"],
        )
        self._show(self._session)

    def advance(self, length: float) -> None:
        """Go on by a communication step, s."""
        if self._session is None:
            self.begin()
        assert self._session is not None
        self._session.advance(length, self.values["current_command"], self.values["force"])
        self._show(self._session)

    def _show(self, session: OpenSession) -> None:
        reading = dict(zip(self._plant.outputs, session.reading.tolist(), strict=True))
        reading["pressure_difference"] = reading["pressure_a"] - reading["pressure_b"]
        angle = self._linkage.angle(np.array([reading["piston_position"]]))
        reading["joint_angle"] = float(angle[0])
        self.values.update(reading)


def equip(slave: Any, fmi: ModuleType, version: int) -> Knee:
    """Give a slave of PythonFMU its variables; return what they stand for.

    Args:
        slave: the slave, constructed.
        fmi: the module `pythonfmu` or `pythonfmu3`.
        version: FMI's, 2 or 3.
    """
    knee = Knee(load_model(Path(slave.resources) / "model.yaml"))
    prefix = f"Fmi{version}"
    causality, variability, initial = (
        getattr(fmi.enums, f"{prefix}{kind}") for kind in ("Causality", "Variability", "Initial")
    )
    real = fmi.Real if version == 2 else fmi.Float64

    def register(name: str, kind: Any, role: Any, changes: Any, first: Any) -> None:
        switch = kind is fmi.Boolean
        slave.register_variable(
            kind(
                name,
                causality=role,
                variability=changes,
                initial=first,
                description=knee.description(name),
                getter=lambda: bool(knee.values[name]) if switch else knee.values[name],
                setter=lambda value: knee.values.__setitem__(name, float(value)),
            )
        )

    if version == 3:  # FMI 3 asks for the independent variable by name
        slave.time = 0.0
        slave.register_variable(
            real("time", causality=causality.independent, variability=variability.continuous)
        )
    for name in knee.values:
        if name in ("current_command", "force"):
            register(name, real, causality.input, variability.continuous, None)
        elif name in knee.outputs:
            changes = variability.continuous
            register(name, real, causality.output, changes, initial.calculated)
        else:
            kind = fmi.Boolean if name in ("piston_locked", "bypass_open") else real
            register(name, kind, causality.parameter, variability.fixed, initial.exact)
    return knee
