"""What a table says of itself: columns named as channels, units in the header or in the file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import UnitError
from eha_bench.core.units import base_unit, factor_and_offset
from eha_bench.recordings.channel_map import ChannelEntry, TimeColumn
from eha_bench.recordings.naming import printable

_WITH_UNIT = re.compile(r"(?P<name>[^\[\](),]*[^\[\](),\s])\s*[\[(](?P<unit>[^\[\]()]*)[\])]")
_NONE = ("", "-", "1", "none", "None")
"""How files write that a column has no unit."""
_CLOCKS = ("time", "timestamp", "t")
"""Names of a column of times; the latter two only where their unit is given."""


def named_unit(column: str) -> tuple[str, str | None]:
    """Return the name and the unit that a heading such as `pressure_a [bar]` gives."""
    match = _WITH_UNIT.fullmatch(column)
    if match is None or match["unit"].strip().isdecimal():  # p[0] is an element, no unit
        return column, None
    return match["name"], match["unit"].strip()


def described_channels(
    columns: Mapping[str, str], units: Mapping[str, str], *, own_clock: bool
) -> tuple[dict[str, ChannelEntry], TimeColumn | None, list[str]]:
    """Return the channels that need no map, the column that holds their time, and notes.

    Args:
        columns: of each column its title, which is its name but for groups around it.
        units: by column, where the file gives one with the name.
        own_clock: whether the file has a clock, so that no column needs to be one.
    """
    heads = {column: _heading(column, title, units) for column, title in columns.items()}
    clock = None if own_clock else _clock(heads, columns)
    often = Counter(name for name, _ in heads.values())
    channels: dict[str, ChannelEntry] = {}
    unsaid: list[str] = []
    notes: list[str] = []
    for column, (title, unit) in heads.items():
        if clock is not None and clock.column in (column, columns[column]):
            continue
        # two of one name are distinguished by their groups
        name = column if often[title] > 1 else title
        if unit is None and name not in CHANNELS:
            unsaid.append(column)
            continue
        wrong = _unit_problem(name, unit)
        if wrong or not name.strip() or not name.isprintable() or name == "time":
            notes.append(
                f"column {printable([column])!r} was left out: {wrong or 'it has no name'}"
            )
            continue
        # of a known channel without a unit the trial knows what it asks for
        known = "" if unit is None and not CHANNELS[name].unit else unit
        channels[name] = ChannelEntry(column=column, unit=known)
    if unsaid and channels:
        notes.append(
            f"columns without a known name or a unit were left out: {printable(unsaid)}; "
            "a channels.yaml takes them"
        )
    if channels:
        declared = any(entry.unit for entry in channels.values())
        notes.append(
            "columns were taken by their names, in SI units"
            + (" where none is given" if declared else "")
        )
    return channels, clock, notes


def _heading(column: str, title: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    if column in units:
        unit = units[column].strip()
        return title, "" if unit in _NONE else unit
    return named_unit(title)


def _clock(
    heads: Mapping[str, tuple[str, str | None]], titles: Mapping[str, str]
) -> TimeColumn | None:
    for wanted in _CLOCKS:
        for column, (name, unit) in heads.items():
            if name.lower() != wanted or (unit is None and wanted != "time"):
                continue
            if unit is None or not _wrong(unit, "s"):
                # by its title each group takes its own
                return TimeColumn(column=titles[column], unit=unit or "s")
    return None


def _unit_problem(name: str, unit: str | None) -> str:
    if unit is None:
        return ""
    known = CHANNELS[name].unit if name in CHANNELS else ""
    return _wrong(unit, known or None)


def _wrong(unit: str, si_unit: str | None) -> str:
    try:
        if si_unit is None:
            base_unit(unit)
        else:
            factor_and_offset(unit, si_unit)
    except UnitError as error:
        return str(error)
    return ""
