"""What an exported FMU does: a plant behind the variables of FMI."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType
from typing import Any

from eha_bench.core.channels import CHANNELS
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.session import Session
from eha_bench.targets.simulator import DEFAULT_STEP

SWITCHES = ("piston_locked", "bypass_open")


class ExportedPlant:
    """The variables of the FMU as attributes, and the simulation behind them.

    PythonFMU reads and writes an FMU's variables by the functions that `register` gives it.

    Attributes:
        inputs: what may be set while it runs: the command, and disturbances.
        outputs: what its sensors read, and what follows from that.
        values: of all variables now, by name, SI.
    """

    def __init__(self, model: Model) -> None:
        """Start with what the model says, at rest.

        Raises:
            InputError: no input commands that plant.
        """
        plant = model.plant
        plant.check_session()
        self._plant, self._model = plant, model
        resting = {name: plant.resting_inputs.get(name, 0.0) for name in plant.inputs}
        # an input that is unknown where it is not logged has no start value in FMI
        given = {name: value for name, value in resting.items() if math.isfinite(value)}
        self.inputs = tuple(given)
        self._pressures = {"pressure_a", "pressure_b"} <= set(plant.outputs)
        derived = ("pressure_difference",) if self._pressures else ()
        read = (*plant.outputs, *derived, *plant.derived_channels)
        self.outputs = tuple(name for name in read if name not in given)
        self._starts = tuple(name for name in plant.states if name in self.outputs)
        rest = dict.fromkeys(self._starts, 0.0) | dict(plant.rest(model.vector()))
        can = {"piston_locked": plant.can_lock, "bypass_open": plant.has_bypass}
        self.values: dict[str, float] = {
            **given,
            **{own.name: model.value(own.name) for own in plant.layout.parameters},
            **{f"start_{name}": rest[name] for name in self._starts},
            "integration_step": DEFAULT_STEP,
            **{name: 0.0 for name in SWITCHES if can[name]},
            **dict.fromkeys(self.outputs, 0.0),
        }
        self._session: Session | None = None

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every variable, nothing for the switches."""
        plant = self._plant
        known = {**plant.units, "pressure_difference": "Pa"}
        found = {parameter.name: parameter.unit for parameter in plant.layout.parameters}
        found |= {name: known[name] for name in (*self.inputs, *self.outputs)}
        found |= {f"start_{name}": known[name] for name in self._starts}
        return found | {"integration_step": "s", **dict.fromkeys(SWITCHES, "")}

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
        self._session = Session(
            self._plant,
            self._model.with_parameters({name: values[name] for name in names}).vector(),
            {name: values[f"start_{name}"] for name in self._starts},
            locked=bool(values.get("piston_locked", 0.0)),
            bypass_open=bool(values.get("bypass_open", 0.0)),
            step=values["integration_step"],
        )
        self._show(self._session)

    def advance(self, length: float) -> None:
        """Go on by a communication step, s."""
        if self._session is None:
            self.begin()
        session = self._session
        assert session is not None
        session.give({name: self.values[name] for name in self.inputs})
        session.advance(session.now + length, self.values[self._plant.command])
        self._show(session)

    def _show(self, session: Session) -> None:
        reading = dict(zip(session.channels, session.truth.tolist(), strict=True))
        if self._pressures:
            reading["pressure_difference"] = reading["pressure_a"] - reading["pressure_b"]
        self.values.update({name: reading[name] for name in self.outputs})


def equip(slave: Any, fmi: ModuleType, version: int) -> ExportedPlant:
    """Give a slave of PythonFMU its variables; return what they stand for.

    Args:
        slave: the slave, constructed.
        fmi: the module `pythonfmu` or `pythonfmu3`.
        version: FMI's, 2 or 3.
    """
    exported = ExportedPlant(load_model(Path(slave.resources) / "model.yaml"))
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
                description=exported.description(name),
                getter=lambda: bool(exported.values[name]) if switch else exported.values[name],
                setter=lambda value: exported.values.__setitem__(name, float(value)),
            )
        )

    if version == 3:  # FMI 3 asks for the independent variable by name
        slave.time = 0.0
        slave.register_variable(
            real("time", causality=causality.independent, variability=variability.continuous)
        )
    for name in exported.values:
        if name in exported.inputs:
            register(name, real, causality.input, variability.continuous, None)
        elif name in exported.outputs:
            changes = variability.continuous
            register(name, real, causality.output, changes, initial.calculated)
        else:
            kind = fmi.Boolean if name in SWITCHES else real
            register(name, kind, causality.parameter, variability.fixed, initial.exact)
    return exported
