"""Where a model holds, as tables: its error by the value of each channel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from eha_bench.diagnosis.replay.error_by_value import ErrorBin, ErrorByValue
from eha_bench.report.diagnosis_text import error_text
from eha_bench.report.engineering import (
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    number,
)

_NOTHING: Final = "\N{EN DASH}"
_DIGITS: Final = 2
_SHADES: Final = (2.0, 4.0, 8.0, 16.0)
"""Noise floors from which on a cell has the next shade."""


@dataclass(frozen=True)
class ErrorCell:
    """The error in one range: as text, the range as text, a shade from 0 to 4, who was there."""

    error: str
    within: str
    shade: int
    fitted: bool


@dataclass(frozen=True)
class ValueRow:
    """One channel by whose value the error is parted: below what was fitted, within, above."""

    name: str
    fitted: str
    cells: tuple[ErrorCell, ...]


@dataclass(frozen=True)
class ErrorTable:
    """The errors of one channel by the value of each."""

    name: str
    unit: str
    floor: str
    rows: tuple[ValueRow, ...]


def error_tables(
    items: Iterable[ErrorByValue], floors: Mapping[str, float]
) -> tuple[ErrorTable, ...]:
    """Return a table for each channel that has an error, the one that varies most first.

    Args:
        items: errors by value, those of one channel next to one another.
        floors: channel -> noise floor, SI.
    """
    found = []
    for name, group in groupby(items, key=lambda item: item.channel):
        own = tuple(group)
        errors = [part.error for item in own for part in _bins(item) if math.isfinite(part.error)]
        if not errors:
            continue
        floor = floors.get(name, math.nan)
        unit = display_unit(own[0].unit, errors)
        rows = tuple(_row(item, unit, floor) for item in own)
        table = ErrorTable(channel_name(name), unit.symbol, error_text(floor, unit, _DIGITS), rows)
        found.append((max(errors) / floor if floor > 0.0 else 0.0, table))
    return tuple(table for _, table in sorted(found, key=lambda item: -item[0]))


def _bins(item: ErrorByValue) -> tuple[ErrorBin, ...]:
    return tuple(part for part in (item.below, *item.bins, item.above) if part is not None)


def _row(item: ErrorByValue, unit: DisplayUnit, floor: float) -> ValueRow:
    ends = (item.bins[0].low, item.bins[-1].high)
    by = display_unit(item.by_unit, ends)
    parts = (item.below, *item.bins, item.above)
    cells = tuple(_cell(part, unit, by, floor) for part in parts)
    return ValueRow(channel_name(item.by), _range(*ends, by), cells)


def _cell(part: ErrorBin | None, unit: DisplayUnit, by: DisplayUnit, floor: float) -> ErrorCell:
    if part is None or not math.isfinite(part.error):
        return ErrorCell(_NOTHING, "", 0, fitted=True)
    shade = sum(part.error > times * floor for times in _SHADES) if floor > 0.0 else 0
    within = _range(part.low, part.high, by)
    return ErrorCell(error_text(part.error, unit, _DIGITS), within, shade, part.fitted > 0.0)


def _range(low: float, high: float, unit: DisplayUnit) -> str:
    shown = unit.from_si(low), unit.from_si(high)
    digits = max(0, decimals_for(shown[1] - shown[0]) - 1)
    return f"{number(shown[0], digits)} … {number(shown[1], digits)}{unit.suffix}"
