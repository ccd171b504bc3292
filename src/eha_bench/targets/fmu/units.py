"""Units of an FMU's variables: as its model description defines them, or as their name says."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from eha_bench.core.errors import UnitError
from eha_bench.core.units import factor_and_offset

if TYPE_CHECKING:
    from fmpy.model_description import BaseUnit, ModelDescription, ModelVariable

_EXPONENTS: dict[str, dict[str, int]] = {
    "": {},
    "A": {"A": 1},
    "K": {"K": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "rad": {},
    "rad/s": {"s": -1},
    "s": {"s": 1},
}
"""Exponents of the channels' SI units; FMI's angle counts for nothing, as many tools omit it."""

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
# Modelica writes N.m2/s where others write N*m^2/s
_POWER = re.compile(r"(?<=[A-Za-z])(-?\d)")


def declared_unit(variable: ModelVariable) -> str | None:
    """Return the unit that an FMU declares for a variable, None where it declares none."""
    unit = variable.unit
    if unit is None and variable.declaredType is not None:
        unit = variable.declaredType.unit
    return unit or None


def conversion(
    description: ModelDescription, variable: ModelVariable, written: str | None, si_unit: str
) -> tuple[float, float]:
    """Return (factor, offset) with SI value = factor * value + offset.

    Args:
        description: the FMU's, for its unit definitions.
        variable: the variable.
        written: unit that target.yaml gives, None where it gives none.
        si_unit: SI unit of the channel.

    Raises:
        UnitError: unknown unit, wrong dimension, or target.yaml contradicts the FMU.
    """
    declared = declared_unit(variable)
    if written is not None:
        mine = factor_and_offset(written, si_unit)
        theirs = _declared_conversion(description, declared, si_unit) if declared else mine
        if not _same(mine, theirs):
            raise UnitError(
                f"'{variable.name}' is in {declared} by the FMU, not in {written}",
                hint="leave `unit` out, or correct it",
            )
        return mine
    return _declared_conversion(description, declared, si_unit) if declared else (1.0, 0.0)


def _same(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return all(abs(a - b) <= 1e-6 * max(abs(a), abs(b)) for a, b in zip(one, other, strict=True))


def _declared_conversion(
    description: ModelDescription, unit: str | None, si_unit: str
) -> tuple[float, float]:
    """Return the conversion of a declared unit: by its definition, or else by its name."""
    for definition in description.unitDefinitions:
        if definition.name == unit and definition.baseUnit is not None:
            return _by_definition(definition.baseUnit, str(unit), si_unit)
    name = _POWER.sub(r"^\1", str(unit).replace(".", "*"))
    return factor_and_offset("" if name == "1" else name, si_unit)


def _by_definition(base: BaseUnit, unit: str, si_unit: str) -> tuple[float, float]:
    wanted = _EXPONENTS.get(si_unit)
    if wanted is None:
        return factor_and_offset(unit, si_unit)
    found = {name: int(getattr(base, name)) for name in _BASES if int(getattr(base, name))}
    if found != wanted:
        raise UnitError(
            f"unit '{unit}' of the FMU has the wrong dimension",
            hint=f"expected a unit of the dimension of {si_unit or 'a pure number'}",
        )
    return float(base.factor), float(base.offset)
