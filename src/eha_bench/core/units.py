"""The one place where units are converted: text with a unit becomes a number in SI.

Inside eha_bench every value is SI. `Unit` marks a pydantic field whose YAML value may be a bare
number (already SI) or text such as `15 MPa`; the wrong dimension is a `UnitError`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, cast

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from eha_bench.core.common_units import BASE, COMMON
from eha_bench.core.errors import UnitError

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)$", re.DOTALL)
_HERTZ = re.compile(r"h(ert)?z", re.IGNORECASE)
_COMMA = re.compile(r"\s*[+-]?\d+,\d")

# What a unit may be written with. Pint evaluates arithmetic, so that 9**9**9 would never come back.
_UNIT = re.compile(r"[^\W\d_][\w°µμΩ%^*/().\s·⋅²³⁻¹-]{0,80}|[°%]\w*|1\s*/[\w^*/().\s-]{1,80}|")
_POWER = re.compile(r"(?:\*\*|\^)[\s(+-]*\d{2}|\d\s*\)?\s*(?:\*\*|\^)")

# To Pint an angle is a pure number, and a hertz one per second: 1 Hz would be 1 rad/s, 1 rpm be
# 0.105 Hz, and 50 deg an overshoot. Where the product's own units could be confused, the exponent
# of the angle has to be this one.
_ANGLE = {"": 0, "rad": 1, "Hz": 0}
_TURNS = {"r/min": "rpm", "U/min": "rpm"}
"""Revolutions a minute as drives and data sheets write them, of which Pint knows another unit."""
_PER_MINUTE = re.compile(r"1?\s*/\s*min(ute)?|min(ute)?\s*((\^|\*\*)?\s*\(?-1\)?|⁻¹)")


@cache
def _registry() -> pint.UnitRegistry[Any]:
    # imported here: pint takes half a second, and most files use only the common units
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    registry.define("Nm = newton * meter")
    registry.define("rev = revolution")
    return registry


@cache
def factor_and_offset(unit: str, si_unit: str) -> tuple[float, float]:
    """Return (factor, offset) with SI value = factor * value + offset.

    Raises:
        UnitError: the unit is unknown, or its dimension is not that of `si_unit`.
    """
    common = COMMON.get(unit)
    if common is not None and common[0] == si_unit:
        return common[1:]
    if si_unit == "rad/s" and _PER_MINUTE.fullmatch(unit):
        raise UnitError(
            f"'{unit}' does not say whether it counts revolutions or radians",
            hint="write rpm for revolutions a minute, or rad/min",
        )
    registry = _registry()
    try:
        target = _parsed(si_unit, "")
    except UnitError:
        raise UnitError(
            f"'{si_unit}', the unit that is expected here, is not one itself",
            hint="correct it where the parameter is declared",
        ) from None
    source = _parsed(unit, _expected_dimension(si_unit))
    if source.dimensionality != target.dimensionality or not _same_kind(source, unit, si_unit):
        raise UnitError(f"unit '{unit}' has the wrong dimension", hint=_expected_dimension(si_unit))
    zero = float(registry.Quantity(0.0, source).to(target).magnitude)
    one = float(registry.Quantity(1.0, source).to(target).magnitude)
    return one - zero, zero


def _parsed(unit: str, hint: str) -> Any:
    import pint

    if not _UNIT.fullmatch(unit) or _POWER.search(unit):
        raise UnitError(f"'{unit}' is not a unit", hint=hint)
    try:
        return _registry().Unit(_TURNS.get(unit, unit).replace("%", "percent") or "dimensionless")
    except (pint.PintError, AttributeError, TypeError, ValueError, AssertionError) as error:
        raise UnitError(f"unknown unit '{unit}'", hint=hint) from error
    except Exception as error:  # pint's tokenizer lets errors of Python's own parser through
        raise UnitError(f"'{unit}' is not a unit", hint=hint) from error


def _same_kind(source: Any, unit: str, si_unit: str) -> bool:
    """Return False where an angle would pass for a number, or a frequency for a speed."""
    if si_unit == "rad/s":
        return "hertz" not in str(source)
    wanted = _ANGLE.get(si_unit)
    found = dict(_registry().get_root_units(source)[1]._units).get("radian", 0)
    return wanted is None or not unit or found == wanted


_DERIVED = ("Pa", "N", "N*m", "V", "W", "ohm", "H", "Hz")


@cache
def base_unit(unit: str) -> str:
    """Return the SI unit of the same kind as `unit`, e.g. Pa for bar, rad for deg, rad/s for rpm.

    Raises:
        UnitError: the unit is unknown.
    """
    common = COMMON.get(unit)
    if common is not None and common[0] in BASE:
        return common[0]
    registry = _registry()
    base = registry.get_base_units(_parsed(unit, ""))[1]
    for name in _DERIVED:
        if registry.get_base_units(name)[1] == base:
            # a rate of decay in 1/s is no frequency
            return "1/s" if name == "Hz" and not _HERTZ.search(unit) else name
    return f"{base:~C}".replace("**", "^")


def base_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the base units (meter, kilogram, ..., radian) that an SI unit is of.

    Raises:
        UnitError: the unit is unknown.
    """
    base = _registry().get_base_units(_parsed(unit, ""))[1]
    return {name: int(cast("float", power)) for name, power in base._units.items()}


def _expected_dimension(si_unit: str) -> str:
    return f"expected a unit of the dimension of {si_unit}" if si_unit else "expected a pure number"


def parse(text: str | float, si_unit: str) -> float:
    """Convert `15 MPa` (or a bare number, taken as SI) to a finite float in `si_unit`.

    Raises:
        UnitError: not a finite number, unknown unit, or the wrong dimension.
    """
    if isinstance(text, bool):
        raise UnitError(f"'{text}' is not a quantity", hint=_expected_dimension(si_unit))
    if isinstance(text, (int, float)):
        value = _float(text)
    else:
        match = _NUMBER.match(text)
        if match is None:
            raise UnitError(
                f"'{text}' is not a number with a unit", hint=_expected_dimension(si_unit)
            )
        if _COMMA.match(text):
            raise UnitError(
                f"'{text}' has a comma", hint="write 0.4 with a point, and 1000 without any"
            )
        value = float(match[1])
        unit = match[2].strip()
        if unit:
            factor, offset = factor_and_offset(unit, si_unit)
            value = factor * value + offset
    if not math.isfinite(value):
        raise UnitError(f"'{text}' is not finite", hint=_expected_dimension(si_unit))
    return value


def _float(value: float) -> float:
    """Return a number as float; infinite where it is a whole one of too many digits."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def positive(name: str, text: str | float, si_unit: str) -> float:
    """Convert a quantity that has to be more than nothing; `name` stands in messages.

    Raises:
        UnitError: as `parse`, or it is zero or negative.
    """
    try:
        value = parse(text, si_unit)
    except UnitError as error:
        raise UnitError(f"{name} '{text}': {error.what}", hint=error.hint) from None
    if not value > 0.0:
        raise UnitError(f"{name} '{text}' is not positive", hint=f"give more than 0 {si_unit}")
    return value


def parse_difference(text: str | float, si_unit: str) -> float:
    """Convert a difference of two quantities: as `parse`, but 5 degC are then 5 K.

    Raises:
        UnitError: as `parse`.
    """
    value = parse(text, si_unit)
    unit = unit_in(text)
    return value - factor_and_offset(unit, si_unit)[1] if unit else value


def unit_in(text: str | float) -> str:
    """Return the unit that a quantity's text names, or nothing."""
    match = _NUMBER.match(text) if isinstance(text, str) else None
    return match[2].strip() if match else ""


def has_unit(text: str | float) -> bool:
    """Whether a quantity's text names a unit."""
    return bool(unit_in(text))


@dataclass(frozen=True)
class Unit:
    """Marks a pydantic field as a quantity: `Annotated[float, Unit("Pa")]`; stored in SI."""

    si: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Accept a number or text with a unit; raise ValueError text that pydantic can place."""

        def convert(value: Any) -> float:
            if isinstance(value, bool) or not isinstance(value, (str, int, float)):
                raise ValueError(f"expected a number or text such as '1 {self.si}'")
            try:
                return parse(value, self.si)
            except UnitError as error:
                raise ValueError(str(error)) from error

        return core_schema.no_info_before_validator_function(convert, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Editors see: a number in SI, or text with a unit."""
        described = f"a number in {self.si or '1'}, or text with a unit"
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": described}
