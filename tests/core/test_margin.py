"""What a smallest difference that matters may be written as."""

import math

import pytest

from eha_bench.core.errors import UnitError
from eha_bench.core.margin import parse_margin


@pytest.mark.parametrize(
    ("text", "unit", "value", "expected"),
    [
        ("2 ms", "s", 0.05, 0.002),
        ("5 %", "s", 0.05, 0.0025),
        ("5 % of baseline", "s", -0.05, 0.0025),
        ("5 %", "", 0.3, 0.05),
        ("5 % of baseline", "", 0.3, 0.015),
        (0.01, "", 0.3, 0.01),
        ("5 degC", "K", 300.0, 5.0),
    ],
)
def test_a_margin_is_a_share_or_a_quantity(
    text: str | float, unit: str, value: float, expected: float
) -> None:
    assert math.isclose(parse_margin(text, unit).about(value), expected)


@pytest.mark.parametrize(("text", "unit"), [("2 MPa", "s"), ("-1 ms", "s"), ("x", ""), ("nan", "")])
def test_what_is_no_difference_is_refused(text: str, unit: str) -> None:
    with pytest.raises(UnitError):
        parse_margin(text, unit)
