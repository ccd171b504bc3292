"""Units are converted once, and what could be taken for something else is refused."""

import math
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from eha_bench.core import units
from eha_bench.core.common_units import COMMON
from eha_bench.core.errors import UnitError
from eha_bench.core.units import (
    Unit,
    base_unit,
    factor_and_offset,
    has_unit,
    parse,
    parse_difference,
)


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [
        ("15 MPa", "Pa", 15e6),
        ("150 bar", "Pa", 15e6),
        ("15MPa", "Pa", 15e6),
        ("  15   MPa ", "Pa", 15e6),
        ("-1.5e-3 m", "m", -1.5e-3),
        ("2400 rpm", "rad/s", 2400 * 2 * math.pi / 60),
        ("2400 r/min", "rad/s", 2400 * 2 * math.pi / 60),
        ("2400 U/min", "rad/s", 2400 * 2 * math.pi / 60),
        ("60 1/min", "1/s", 1.0),
        ("50 deg", "rad", math.radians(50)),
        ("50 °", "rad", math.radians(50)),
        ("6.7 Hz", "Hz", 6.7),
        ("1 kHz", "Hz", 1000.0),
        ("41 ms", "s", 0.041),
        ("5 %", "", 0.05),
        ("20 degC", "K", 293.15),
        ("0.69 cm^3/rev", "m^3/rad", 0.69e-6 / (2 * math.pi)),
        ("6e-10 m^3/(s*Pa)", "m^3/(s*Pa)", 6e-10),
        ("0.001 kg*m^2", "kg*m^2", 0.001),
        ("0.00498 N*m/(rad/s)", "N*m*s", 0.00498),
        ("0.13 Nm/A", "N*m/A", 0.13),
        ("10 1/s", "rad/s", 10.0),
        ("7", "Pa", 7.0),
        (7, "Pa", 7.0),
        (7.5, "rad", 7.5),
    ],
)
def test_quantity_becomes_si(text: str | float, si: str, value: float) -> None:
    assert parse(text, si) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "si"),
    [
        ("15 deg", "Pa"),
        ("15 MPa", "rad"),
        ("15 A", ""),
        ("50 deg", ""),  # an angle is not an overshoot
        ("5 %", "rad"),
        ("6.7 Hz", "rad/s"),  # 6.7 Hz is 42 rad/s, not the 6.7 that plain dimensions give
        ("2400 rpm", "Hz"),
        ("42 rad/s", "Hz"),
    ],
)
def test_wrong_dimension_is_refused(text: str, si: str) -> None:
    with pytest.raises(UnitError, match="wrong dimension"):
        parse(text, si)


@pytest.mark.parametrize(
    "unit", ["1/min", "1 / min", "/min", "1/minute", "min^-1", "min**-1", "min-1", "min⁻¹"]
)
def test_per_minute_is_no_speed(unit: str) -> None:
    """Drives mean revolutions by it; read as radians a speed is a sixth of what it is."""
    with pytest.raises(UnitError, match=r"revolutions or radians; write rpm") as found:
        parse(f"1200 {unit}", "rad/s")
    assert unit in str(found.value)


@pytest.mark.parametrize(
    "text", ["", "MPa", "fast", "1,5 MPa", "15 Mpa", "15 foo", "1 2 MPa", "nan", "inf Pa", "1e999"]
)
def test_what_is_no_quantity_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        parse(text, "Pa")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, False])
def test_what_is_no_finite_number_is_refused(value: float) -> None:
    with pytest.raises(UnitError):
        parse(value, "Pa")


@pytest.mark.parametrize(
    "unit",
    ["9**9**9**9", "m**99999999", "m^(9**9**9)", "__import__('os')", "m; s", "a" * 500, "[1]"],
)
def test_unit_text_is_never_evaluated(unit: str) -> None:
    with pytest.raises(UnitError):
        factor_and_offset(unit, "m")


def test_difference_of_temperatures_has_no_offset() -> None:
    assert parse_difference("5 degC", "K") == pytest.approx(5.0)
    assert parse_difference("5 K", "K") == 5.0
    assert parse_difference("0.1 deg", "rad") == pytest.approx(math.radians(0.1))
    assert parse_difference("3", "K") == 3.0


def test_has_unit() -> None:
    assert has_unit("3 MPa")
    assert not has_unit("3")
    assert not has_unit(3.0)


@given(st.floats(allow_nan=False, allow_infinity=False, width=64))
def test_bare_number_is_si_bit_for_bit(value: float) -> None:
    assert parse(value, "Pa") == value
    assert parse(repr(value), "Pa") == value


@given(
    st.floats(-1e9, 1e9),
    st.sampled_from([("bar", "Pa"), ("rpm", "rad/s"), ("deg", "rad"), ("mm", "m"), ("degC", "K")]),
)
def test_text_agrees_with_factor_and_offset(value: float, units: tuple[str, str]) -> None:
    factor, offset = factor_and_offset(*units)
    assert parse(f"{value!r} {units[0]}", units[1]) == factor * value + offset


@pytest.mark.parametrize(
    ("unit", "base"),
    [
        ("bar", "Pa"),
        ("rpm", "rad/s"),
        ("deg", "rad"),
        ("mm", "m"),
        ("kN", "N"),
        ("degC", "K"),
        ("1/min", "1/s"),
        ("1/s", "1/s"),
        ("kHz", "Hz"),
        ("hertz", "Hz"),
    ],
)
def test_base_unit(unit: str, base: str) -> None:
    assert base_unit(unit) == base


class _Pump(BaseModel):
    speed: Annotated[float, Unit("rad/s")]


def test_field_takes_text_or_number() -> None:
    assert _Pump.model_validate({"speed": "60 rpm"}).speed == pytest.approx(2 * math.pi)
    assert _Pump.model_validate({"speed": 3}).speed == 3.0


@pytest.mark.parametrize("value", ["3 m", True, None, [1], {"value": 1}])
def test_field_refuses_what_is_no_quantity(value: object) -> None:
    with pytest.raises(ValidationError):
        _Pump.model_validate({"speed": value})


def test_field_tells_editors_that_text_is_welcome() -> None:
    schema = _Pump.model_json_schema()["properties"]["speed"]
    assert {"type": "string"} in schema["anyOf"]
    assert "rad/s" in schema["description"]


@pytest.mark.parametrize("unit", COMMON)
def test_the_common_units_are_what_pint_says(unit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    si_unit, factor, offset = COMMON[unit]
    said = base_unit.__wrapped__(unit)
    monkeypatch.setattr(units, "COMMON", {})
    assert (factor, offset) == factor_and_offset.__wrapped__(unit, si_unit)
    assert said == base_unit.__wrapped__(unit)
