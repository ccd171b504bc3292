"""SI values as engineers read them: display units, digits, names of metrics and channels."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import UnitError
from eha_bench.core.units import factor_and_offset

SIGNIFICANT_DIGITS: Final = 4
_AFTER_NUMBER: Final = re.compile(r"\d(?:[eE][-+]?\d+)?\s*([^\W\d_][^\s,;<>=±+]*)")
_MINUS: Final = "\N{MINUS SIGN}"
_NOTHING: Final = "\N{EN DASH}"


@dataclass(frozen=True)
class DisplayUnit:
    """A unit for display: shown value = `factor` * SI value + `offset`; `symbol` may be ""."""

    symbol: str
    factor: float = 1.0
    offset: float = 0.0

    def from_si(self, value: float) -> float:
        """Convert an SI value to this unit."""
        return self.factor * value + self.offset

    def difference(self, value: float) -> float:
        """Convert a difference of SI values to this unit: the offset has no part in it."""
        return self.factor * value

    @property
    def suffix(self) -> str:
        """What follows the number: a no-break space and the symbol, or nothing."""
        return f"\N{NO-BREAK SPACE}{self.symbol}" if self.symbol else ""


# SI unit -> (smallest magnitude for which it is used, display unit), largest first.
_SCALES: Final[dict[str, tuple[tuple[float, DisplayUnit], ...]]] = {
    "s": (
        (1.0, DisplayUnit("s")),
        (1e-3, DisplayUnit("ms", 1e3)),
        (0.0, DisplayUnit("µs", 1e6)),
    ),
    "Pa": (
        (1e5, DisplayUnit("MPa", 1e-6)),
        (1e1, DisplayUnit("kPa", 1e-3)),
        (0.0, DisplayUnit("Pa")),
    ),
    "A": ((0.1, DisplayUnit("A")), (0.0, DisplayUnit("mA", 1e3))),
    "rad": ((0.0, DisplayUnit("deg", 180.0 / math.pi)),),
    "rad/s": ((0.0, DisplayUnit("rpm", 30.0 / math.pi)),),
    "m": (
        (10.0, DisplayUnit("m")),
        (1e-4, DisplayUnit("mm", 1e3)),
        (0.0, DisplayUnit("µm", 1e6)),
    ),
    "m/s": ((1.0, DisplayUnit("m/s")), (0.0, DisplayUnit("mm/s", 1e3))),
    "N": ((1e5, DisplayUnit("kN", 1e-3)), (0.0, DisplayUnit("N"))),
    "K": ((0.0, DisplayUnit("°C", 1.0, -273.15)),),
    "Hz": ((1e4, DisplayUnit("kHz", 1e-3)), (0.0, DisplayUnit("Hz"))),
    "N*m": ((0.01, DisplayUnit("N·m")), (0.0, DisplayUnit("mN·m", 1e3))),
    "m^3/s": ((0.0, DisplayUnit("L/min", 6e4)),),
}
_POWERS: Final[dict[str, tuple[tuple[float, DisplayUnit], ...]]] = {
    "m^2": ((0.1, DisplayUnit("m²")), (0.0, DisplayUnit("cm²", 1e4))),
    "m^3": ((0.1, DisplayUnit("m³")), (0.0, DisplayUnit("cm³", 1e6))),
}
"""The same of areas and volumes, which a limit may give in any power of a length."""

# Units that a limit may be written in besides those above: the value is then shown in it.
_WRITTEN: Final[dict[str, dict[str, DisplayUnit]]] = {
    "s": {"us": DisplayUnit("µs", 1e6), "min": DisplayUnit("min", 1 / 60)},
    "Pa": {"bar": DisplayUnit("bar", 1e-5)},
    "rad": {
        "rad": DisplayUnit("rad"),
        "mrad": DisplayUnit("mrad", 1e3),
        "degree": DisplayUnit("deg", 180.0 / math.pi),
        "°": DisplayUnit("deg", 180.0 / math.pi),
    },
    "rad/s": {
        "rad/s": DisplayUnit("rad/s"),
        "deg/s": DisplayUnit("deg/s", 180.0 / math.pi),
    },
    "N": {"kN": DisplayUnit("kN", 1e-3)},
    "m": {"um": DisplayUnit("µm", 1e6), "cm": DisplayUnit("cm", 1e2)},
}

PERCENT: Final = DisplayUnit("%", 100.0)
PLAIN: Final = DisplayUnit("")

_FRACTIONS: Final = frozenset({"overshoot", "undershoot", "tracking_nrmse", "distortion"})

COUNTS: Final = frozenset({"loop_overruns"})
"""Metrics that are whole numbers."""

_METRIC_NAMES: Final[dict[str, tuple[str, str]]] = {
    "rise_time": ("Rise time", "10\N{EN DASH}90 %"),
    "response_time": ("Response time", "0\N{EN DASH}95 %"),
    "settling_time": ("Settling time", "2 %"),
    "steady_state_error": ("Steady-state error", ""),
    "tracking_rms": ("Tracking error, RMS", ""),
    "tracking_max": ("Tracking error, maximum", ""),
    "tracking_nrmse": ("Tracking error, normalised RMS", ""),
    "bandwidth_3db": ("Bandwidth", f"{_MINUS}3 dB"),
    "bandwidth_90deg": ("Bandwidth", f"{_MINUS}90°"),
    "loop_overruns": ("Loop overruns", ""),
}
"""id -> name, and the convention by which it is measured."""

_CHANNEL_NAMES: Final[dict[str, str]] = {
    "pressure_a": "Pressure A",
    "pressure_b": "Pressure B",
}


def metric_name(metric: str) -> str:
    """Return a metric's id as a heading, e.g. `response_time` -> Response time (0-95 %)."""
    name, convention = _METRIC_NAMES.get(metric) or (_sentence(metric), "")
    return f"{name} ({convention})" if convention else name


def metric_label(metric: str) -> str:
    """Return a metric's name for a mark in a plot, without its convention: response time."""
    name, _ = _METRIC_NAMES.get(metric) or (_sentence(metric), "")
    return name.lower()


def channel_name(channel: str) -> str:
    """Return a channel's name as a heading; a name that is not ours stays as it is."""
    if channel not in CHANNELS:
        return channel
    return _CHANNEL_NAMES.get(channel) or _sentence(channel)


def _sentence(identifier: str) -> str:
    text = identifier.replace("_", " ").strip()
    return text[:1].upper() + text[1:]


def display_unit(
    si: str, values: Iterable[float] = (), *, metric: str = "", written: str = ""
) -> DisplayUnit:
    """Choose the unit in which values are shown.

    Args:
        si: SI unit of the values ("" for a pure number).
        values: those that are shown together, SI; not-finite ones are passed over.
        metric: id of the metric, "" for a channel's samples (fractions become per cent,
            temperatures degrees Celsius, as far as that is meant).
        written: a limit as its author wrote it, e.g. `<= 41 ms`: its unit wins.
    """
    asked = _written_unit(si, written)
    if asked is not None:
        return asked
    if si == "":
        return PERCENT if metric in _FRACTIONS else PLAIN
    if si == "K" and metric:
        return DisplayUnit("K")
    scales = _SCALES.get(si) or _POWERS.get(si)
    if scales is None:
        return DisplayUnit(printed_unit(si))
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if largest == 0.0:
        return scales[0][1]
    return next(unit for least, unit in scales if largest >= least)


def printed_unit(unit: str) -> str:
    """Return a unit as it is printed: `kg*m^2` -> kg·m²."""
    return re.sub(r"\^([23])(?![\d.])", lambda found: "²³"[int(found[1]) - 2], unit).replace(
        "*", "·"
    )


def _written_unit(si: str, written: str) -> DisplayUnit | None:
    # The last word that is not a number; `<= 41 ms`, `11 A +- 6 %` and `38 .. 41 MPa` are all met.
    if si == "":
        return PERCENT if written.rstrip().endswith("%") else None
    if si not in _SCALES:
        return _composed_unit(si, written)
    known = {unit.symbol: unit for _, unit in _SCALES.get(si, ())} | _WRITTEN.get(si, {})
    for word in reversed(re.findall(r"[^\s\d.,;()<>=±]+", written)):
        if word in known:
            return known[word]
    return None


def _composed_unit(si: str, written: str) -> DisplayUnit | None:
    """Return the unit of a limit whose SI unit is none of ours: `<= 0.3 MPa*s` of Pa*s."""
    for unit in reversed(_AFTER_NUMBER.findall(written)):
        try:
            factor, offset = factor_and_offset(unit, si)
        except UnitError:
            continue
        return DisplayUnit(printed_unit(unit), 1.0 / factor, -offset / factor)
    return None


def limit_text(text: str) -> str:
    """Return a limit as its author wrote it, with printed signs: `<= 41 ms` -> `≤ 41 ms`."""
    for typed, printed in (("<=", "≤"), (">=", "≥"), ("+/-", "±"), ("+-", "±"), ("..", "…")):
        text = text.replace(typed, printed)
    text = re.sub(r"(?<![\w.])-(?=[\d.])", _MINUS, text)
    text = re.sub(r"(?<=[^\W\d_])\*(?=[^\W\d_])", "·", text)
    # A number stays with its unit, and a sign with its number.
    text = re.sub(r"(?<=[\d.]) (?=[^\d\s±…≤≥])", "\N{NO-BREAK SPACE}", text)
    return re.sub(r"(?<=[±≤≥]) (?=\d)", "\N{NO-BREAK SPACE}", text)


def decimals_for(value: float, spread: float = math.nan) -> int:
    """Digits after the point: four significant ones, or up to five as the interval asks."""
    if not math.isfinite(value):
        return 0
    by_value = SIGNIFICANT_DIGITS - 1 - _exponent(value)
    if math.isfinite(spread) and spread > 0.0:
        # a mantissa has as many digits, however small the power of ten
        most = 9 if abs(value) >= SMALL else math.inf
        return int(max(0, min(by_value + 1, 1 - _exponent(spread), most)))
    return max(0, min(by_value, 9))


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0


LARGE: Final = 1e7
"""From here on numbers are written with powers of ten."""
SMALL: Final = 0.5e-6
"""Below it they are, too."""


def number(value: float, decimals: int | None = None, *, sign: bool = False) -> str:
    """Write a number for people: a true minus, an en dash for NaN, powers of ten where needed."""
    if math.isnan(value):
        return _NOTHING
    if math.isinf(value):
        return (_MINUS if value < 0 else "") + "∞"
    places = decimals_for(value) if decimals is None else decimals
    if value and (abs(value) >= LARGE or abs(value) < 0.5 * 10.0 ** -min(places, 6)):
        small = abs(value) < SMALL
        text = power_of_ten(value, max(2, places + _exponent(value)) if small else 2)
    else:
        text = f"{value:.{places}f}"
        if float(text) == 0.0:
            text = text.lstrip("-")
    if sign and value > 0.0:
        text = f"+{text}"
    return text.replace("-", _MINUS)


def power_of_ten(value: float, decimals: int) -> str:
    """Write a number as a mantissa with `decimals` digits after the point: 1.50e7."""
    mantissa, _, power = f"{value:.{decimals}e}".partition("e")
    return f"{mantissa}e{int(power)}".replace("-", _MINUS)


def quantity(
    value: float, si: str, *, metric: str = "", written: str = "", spread: float = math.nan
) -> str:
    """Write an SI value with its display unit, e.g. (0.0391, "s") -> `39.10 ms`.

    Args:
        value, spread: the value and the half-width of its interval (NaN: unknown), SI.
        si: their unit.
        metric, written: as for `display_unit`.
    """
    if not math.isfinite(value):
        return number(value)
    unit = display_unit(si, (value,), metric=metric, written=written)
    shown = unit.from_si(value)
    decimals = 0 if metric in COUNTS else decimals_for(shown, unit.difference(spread))
    return number(shown, decimals) + unit.suffix
