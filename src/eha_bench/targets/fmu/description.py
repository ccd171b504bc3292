"""What an FMU says of itself: read before anything runs, and checked against target.yaml."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.extras import way_to_install
from eha_bench.core.near_miss import suggest
from eha_bench.core.units import base_unit, parse, unit_in
from eha_bench.targets.fmu.units import conversion, declared_unit

if TYPE_CHECKING:
    from fmpy.model_description import CoSimulation, ModelDescription, ModelVariable

Places = Callable[..., Place]

_NUMBERS = {
    "Real", "Float32", "Float64", "Integer", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32",
    "Int64", "UInt64", "Boolean", "Enumeration",
}  # fmt: skip
_SETTABLE = ("input", "parameter", "structuralParameter")
_WORDS = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True)
class Variable:
    """A scalar variable of an FMU and how its values become SI.

    Attributes:
        name: as in the model description.
        reference: FMI's value reference.
        kind: FMI's type: Real (FMI 2), Float64, Boolean ...
        factor, offset: SI value = factor * value + offset.
    """

    name: str
    reference: int
    kind: str
    factor: float = 1.0
    offset: float = 0.0

    def raw(self, value: float) -> float:
        """Return the FMU's value for one in SI."""
        return (value - self.offset) / self.factor


@dataclass(frozen=True)
class Binary:
    """What it takes to load an FMU's binary: FMI's version, names, and if it may live twice."""

    version: int
    guid: str
    identifier: str
    once: bool


class Description:
    """The model description of an FMU, with the sentences for what target.yaml gets wrong."""

    def __init__(self, path: Path, where: Place) -> None:
        """Read it.

        Raises:
            InputError: FMPy is not installed, or this is not a FMU that can be run here.
        """
        try:
            import fmpy
            from fmpy.model_description import read_model_description
        except ImportError as error:
            raise InputError(
                "an FMU needs FMPy", where=where, hint=way_to_install("fmu")
            ) from error
        self.path, self._where = path, where
        try:
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
            self.content: ModelDescription = read_model_description(str(path), validate=False)
        except FileNotFoundError as error:
            raise InputError(f"no such file: {path}", where=where) from error
        except Exception as error:  # FMPy raises bare exceptions, lxml and zipfile their own
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{path} is not an FMU ({reason})", where=where) from error
        found: CoSimulation | None = self.content.coSimulation
        if not str(self.content.fmiVersion).startswith(("2.", "3.")):
            raise InputError(f"{path} is FMI {self.content.fmiVersion}", where=where,
                             hint="export it as FMI 2 or 3")  # fmt: skip
        if found is None:
            raise InputError(
                f"{path} is for model exchange only",
                where=where,
                hint="export it for co-simulation",
            )
        self.interface: CoSimulation = found
        folder = fmpy.platform if self.version == 2 else fmpy.platform_tuple
        if not any(name.startswith(f"binaries/{folder}/") for name in names):
            have = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n[9:]})
            raise InputError(
                f"{path} has no binary for this machine ({folder})",
                where=where,
                hint=f"it has: {', '.join(have) or 'none'}; export it on, or for, this platform",
            )
        self._variables = {variable.name: variable for variable in self.content.modelVariables}
        _ = self.fixed_step  # says what is wrong with it

    @property
    def version(self) -> int:
        """FMI's major version: 2 or 3."""
        return int(str(self.content.fmiVersion)[0])

    @property
    def binary(self) -> Binary:
        """What it takes to load the binary."""
        found = self.interface
        once = bool(found.canBeInstantiatedOnlyOncePerProcess)
        return Binary(self.version, str(self.content.guid), str(found.modelIdentifier), once)

    @cached_property
    def fixed_step(self) -> float | None:
        """The only communication step that the FMU can take, s; None where any will do."""
        if self.interface.canHandleVariableCommunicationStepSize:
            return None
        fixed = self.interface.fixedInternalStepSize
        experiment = self.content.defaultExperiment
        declared = fixed or (experiment.stepSize if experiment is not None else None)
        if declared is None:
            return None
        try:
            step = float(declared)
        except ValueError:
            step = math.nan
        if not 0.0 < step < math.inf:
            raise InputError(
                f"{self.path} can take one communication step only, and gives it as '{declared}' s",
                where=self._where,
                hint="export it with a step above 0, or with one that may vary",
            )
        return step

    def output(self, name: str, unit: str | None, si_unit: str, places: Places) -> Variable:
        """Return a variable that may be read.

        Raises:
            InputError: no such variable, no number, or another unit.
        """
        return self._converted(
            self._numeric_variable(name, places("variable")), unit, si_unit, places
        )

    def unit_of(self, name: str) -> str:
        """Return the unit that the FMU declares for a variable, or nothing."""
        variable = self._variables.get(name)
        return (declared_unit(variable) if variable is not None else None) or ""

    def input(self, name: str, unit: str | None, si_unit: str, places: Places) -> Variable:
        """Return a variable that may be set while the FMU runs.

        Raises:
            InputError: as `output`, or the FMU does not take it as an input.
        """
        variable = self._numeric_variable(name, places("variable"))
        if variable.causality != "input":
            inputs = [v.name for v in self._variables.values() if v.causality == "input"]
            raise InputError(
                f"'{name}' is not an input of the FMU but its {variable.causality or 'local'}",
                where=places("variable"),
                hint=f"its inputs: {', '.join(inputs) or 'none'}",
            )
        return self._converted(variable, unit, si_unit, places)

    def start(self, name: str, unit: str | None, si_unit: str | None, places: Places) -> Variable:
        """Return a variable whose start value may be set; `si_unit` None leaves its values alone.

        Raises:
            InputError: as `output`, or its start value cannot be set.
        """
        variable = self._numeric_variable(name, places("variable"))
        settable = variable.causality in _SETTABLE or variable.initial in ("exact", "approx")
        if not settable or variable.variability == "constant":
            raise InputError(
                f"'{name}' takes no start value (causality {variable.causality or 'local'})",
                where=places("variable"),
                hint="parameters, inputs and variables with initial exact or approx do",
            )
        if si_unit is None:
            return _plain(variable)
        return self._converted(variable, unit, si_unit, places)

    def value(self, name: str, given: float | bool | str, places: Places) -> tuple[Variable, float]:
        """Return a variable and the start value for it, in the FMU's own unit.

        Raises:
            InputError: as `start`, or the text has another unit than the FMU declares.
        """
        target = self.start(name, None, None, places)
        if not isinstance(given, str):
            return target, float(given)
        if given.lower() in _WORDS:
            return target, _WORDS[given.lower()]
        variable = self._variables[name]
        unit = declared_unit(variable)
        try:
            named = unit_in(given)
            si_unit = base_unit(named) if named else ""
            factor, offset = conversion(self.content, variable, None, si_unit)
            return target, (parse(given, si_unit) - offset) / factor
        except UnitError as error:
            says = f"the FMU takes '{name}' in {unit}" if unit else "the FMU declares no unit"
            raise InputError(
                error.what, where=places(), hint=f"{says}; a bare number is in its unit"
            ) from error

    def _numeric_variable(self, name: str, where: Place) -> ModelVariable:
        variable = self._variables.get(name)
        if variable is None:
            hint = suggest(name, self._variables)
            raise InputError(f"the FMU has no variable '{name}'", where=where, hint=hint)
        if variable.type not in _NUMBERS:
            raise InputError(f"'{name}' is a {variable.type}, not a number", where=where)
        if variable.dimensions:
            raise InputError(f"'{name}' is an array; only scalars are mapped", where=where)
        return variable

    def _converted(
        self, variable: ModelVariable, unit: str | None, si_unit: str, places: Places
    ) -> Variable:
        try:
            factor, offset = conversion(self.content, variable, unit, si_unit)
        except UnitError as error:
            where = places("unit" if unit is not None else "variable")
            raise InputError(error.what, where=where, hint=error.hint) from error
        return _plain(variable, factor, offset)


def _plain(variable: ModelVariable, factor: float = 1.0, offset: float = 0.0) -> Variable:
    return Variable(
        str(variable.name), int(variable.valueReference), str(variable.type), factor, offset
    )
