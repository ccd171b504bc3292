"""Which column of a table is the time of which others, guessed from names, lengths and values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from eha_bench.core.errors import UnitError
from eha_bench.core.units import base_unit
from eha_bench.recordings.information import RecordingInformation, TopicInformation
from eha_bench.recordings.source import IN_PAIRS
from eha_bench.recordings.tables.self_description import named_unit
from eha_bench.recordings.values import ValueInformation

_TIME_AT_END = re.compile(r"[\s_.-](time|timestamp|stamp|zeit)$", re.I)
_FEWEST = 10
"""Rows from which on it is no chance that a column without a name rises all the time."""
_UNEVEN = 5.0
"""Median and mean of a time's steps differ by at most this factor."""


@dataclass(frozen=True)
class NamedClock:
    """A column that may hold the time, by its full name or by that within its group.

    Attributes:
        name: as a channels.yaml writes it. unit: as the file says it, "" where it does not.
        reason: what it stands on, where that is not its name alone.
        likely_unit: what its steps look like, where the file says no unit.
    """

    name: str
    unit: str
    reason: str = ""
    likely_unit: str = "s"

    def times(self, column: TopicInformation, table: Sequence[TopicInformation]) -> bool:
        """Whether it is the time of a column: that of its own group, or one for all of a length."""
        inside = [item for item in table if item.group == column.group and title(item) == self.name]
        clocks = inside or [item for item in table if item.name == self.name]
        return any(item.count == column.count for item in clocks)


def title(column: TopicInformation) -> str:
    """Return a column's name within its group."""
    return column.name.removeprefix(f"{column.group}/") if column.group else column.name


def best_clock(
    likely: Sequence[tuple[TopicInformation, str]], table: Sequence[TopicInformation]
) -> NamedClock | None:
    """Return the clock that most columns have, the likeliest of them; None where none has any.

    A name that several groups have is the time of each of them (`t` of `/ref/t` and `/p/t`).

    Args:
        likely: columns that may be clocks with their units, the likeliest first.
        table: all columns.
    """
    counted = Counter(title(column) for column, _ in likely)
    named = [NamedClock(column.name, unit) for column, unit in likely]
    named += [
        NamedClock(title(column), unit)
        for column, unit in likely
        if counted[title(column)] > 1 and title(column) != column.name
    ]
    clocks = {column.name for column, _ in likely}
    numbers = [column for column in table if column.values and column.name not in clocks]

    def timed(clock: NamedClock) -> int:
        return sum(clock.times(item, table) for item in numbers)

    best = max(named, key=timed, default=None)
    return best if best is not None and timed(best) else None


def unlike_their_group(table: Sequence[TopicInformation]) -> Iterator[TopicInformation]:
    """Yield columns of another length than most of their group, which no clock could be of."""
    lengths: dict[str, Counter[int]] = {}
    for item in table:
        if item.values:
            lengths.setdefault(item.group, Counter())[item.count] += 1
    for item in table:
        if item.values and lengths[item.group].most_common(1)[0][0] != item.count:
            yield item


def clock_by_values(found: RecordingInformation) -> NamedClock | None:
    """Return the column that its values show as the time, where none is called like one."""
    table = [(item, item.values[0]) for item in found.topics if item.values]
    for item, values in table:
        name, unit = named_unit(values.name)
        if _TIME_AT_END.search(name) and _is_time(unit or values.unit) and values.step > 0:
            return NamedClock(item.name, unit or values.unit, "its name ends like that of a time")
    rising = [(item, values) for item, values in table if values.step > 0]
    if any(IN_PAIRS in note for note in found.notes):
        times = [(item, values) for item, values in rising if title(item).lower() == "x"]
        if times:
            item, values = times[0]
            return _of_steps(title(item), values, IN_PAIRS)
    unnamed = all(item.name == str(place) for place, item in enumerate(found.topics))
    if unnamed and len(rising) == 1 and len(table) > 1:
        item, values = rising[0]
        if item.count >= _FEWEST and _is_even(values, item.count):
            return _of_steps(item.name, values, "no other column rises all the time")
    return None


def _of_steps(name: str, values: ValueInformation, reason: str) -> NamedClock:
    """Return a clock whose unit is the one in which its steps are those of a log."""
    most = {"s": 0.5, "ms": 500.0, "us": 5e5}
    unit = next((unit for unit, limit in most.items() if values.step < limit), "ns")
    return NamedClock(name, "", f"{reason}; its steps are {values.step:.3g}", unit)


def _is_even(values: ValueInformation, count: int) -> bool:
    """Whether steps are those of a time: of one size about, and no row numbers."""
    mean = (values.maximum - values.minimum) / (count - 1)
    numbers = mean == values.step == 1.0
    return 1 / _UNEVEN < mean / values.step < _UNEVEN and not numbers


def _is_time(unit: str) -> bool:
    try:
        return base_unit(unit) == "s"
    except UnitError:
        return False
