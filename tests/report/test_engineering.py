"""Values as engineers read them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.channels import CHANNELS
from eha_bench.report.engineering import (
    channel_name,
    decimals_for,
    display_unit,
    limit_text,
    metric_name,
    number,
    printed_unit,
    quantity,
)


@pytest.mark.parametrize(
    ("value", "si", "metric", "written", "text"),
    [
        (0.0391, "s", "response_time", "", "39.10 ms"),
        (0.6, "s", "settling_time", "<= 0.63 s", "0.6000 s"),
        (39.4e6, "Pa", "peak", "38 .. 41 MPa", "39.40 MPa"),
        (39.4e6, "Pa", "peak", "<= 400 bar", "394.0 bar"),
        (math.pi / 2, "rad", "", "", "90.00 deg"),
        (math.pi / 2, "rad", "phase_lag", "<= 100 mrad", "1571 mrad"),
        (2 * math.pi, "rad/s", "", "", "60.00 rpm"),
        (0.313, "", "overshoot", "", "31.30 %"),
        (0.971, "", "amplitude_ratio", "0.95 .. 1.05", "0.9710"),
        (313.15, "K", "", "", "40.00 °C"),
        (0.5, "K", "steady_state_error", "", "0.5000 K"),
        (-21.4e3, "Pa", "steady_state_error", "", "−21.40 kPa"),
        (3.0, "widget", "", "", "3.000 widget"),
        (525e3, "Pa*s", "iae", "<= 0.1 MPa*s", "0.5250 MPa·s"),
        (
            525e3,
            "Pa*s",
            "iae",
            "<= 3 bar*s with 95 % confidence",
            "5.250 bar·s",
        ),
        (0.1, "rad*s", "iae", "0.2 deg*s .. 3 deg*s", "5.730 deg·s"),
        (1e-6, "m^2", "", "<= 4 mm^2", "1.000 mm²"),
        (1.3471e-3, "m^2", "", "", "13.47 cm²"),
        (6.56e-5, "m^3", "", "", "65.60 cm³"),
        (0.4, "m^3", "", "", "0.4000 m³"),
        (2.0, "W", "peak_power", "<= 4", "2.000 W"),
        (2.0, "W", "peak_power", "<= 4 nonsense", "2.000 W"),
        (math.nan, "s", "rise_time", "<= 4 ms", "–"),
    ],
)
def test_quantity(value: float, si: str, metric: str, written: str, text: str) -> None:
    assert quantity(value, si, metric=metric, written=written).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("spread", "text"),
    [
        (3e-11, "3.4512e−7 m³/(s·Pa^0.5)"),
        (3e-9, "3.451e−7 m³/(s·Pa^0.5)"),
        (math.nan, "3.45e−7 m³/(s·Pa^0.5)"),
    ],
)
def test_a_small_number_has_the_digits_that_its_interval_asks_for(spread: float, text: str) -> None:
    """An interval of 3.45e-7 to 3.45e-7 says nothing."""
    shown = quantity(3.4512e-7, "m^3/(s*Pa^0.5)", spread=spread)
    assert shown.replace("\u00a0", " ") == text


@given(st.floats(-1e300, 1e300))
def test_a_number_reads_back_to_three_digits(value: float) -> None:
    assert float(number(value).replace("−", "-")) == pytest.approx(value, rel=6e-3)


@given(
    st.floats(min_value=-1e9, max_value=1e9),
    st.sampled_from(sorted({channel.unit for channel in CHANNELS.values()})),
)
def test_showing_is_invertible(value: float, si: str) -> None:
    unit = display_unit(si, (value,))
    assert (unit.from_si(value) - unit.offset) / unit.factor == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    ("unit", "printed"),
    [("kg*m^2", "kg·m²"), ("m^3/(s*Pa)", "m³/(s·Pa)"), ("m^3*Pa^0.5", "m³·Pa^0.5"), ("", "")],
)
def test_a_unit_is_printed_as_in_a_book(unit: str, printed: str) -> None:
    assert printed_unit(unit) == printed
    assert display_unit(unit).symbol == printed


def test_no_negative_zero() -> None:
    assert number(-1e-12, 2) != "−0.00"
    assert number(-0.0) == "0.000"


def test_digits_follow_the_interval() -> None:
    assert decimals_for(48.163, 0.23) == 2
    assert decimals_for(48.163, 23.0) == 0
    assert decimals_for(48.163) == 2


@pytest.mark.parametrize(
    ("typed", "printed"),
    [
        ("<= 41 ms", "≤ 41 ms"),
        ("11 A +- 6 %", "11 A ± 6 %"),
        ("38 .. 41 MPa", "38 … 41 MPa"),
        (">= -3 deg", "≥ −3 deg"),
    ],
)
def test_limit_text(typed: str, printed: str) -> None:
    assert limit_text(typed).replace("\u00a0", " ") == printed


def test_a_limit_breaks_only_between_its_parts() -> None:
    assert limit_text("<= 41 ms") == "≤\u00a041\u00a0ms"
    assert limit_text("43 ms +- 6 %").split(" ") == ["43\u00a0ms", "±\u00a06\u00a0%"]


def test_names() -> None:
    assert metric_name("holding_current") == "Holding current"
    assert metric_name("my_own") == "My own"
    assert channel_name("pressure_difference") == "Pressure difference"
    assert channel_name("x_1/y") == "x_1/y"
