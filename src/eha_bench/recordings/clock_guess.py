"""Which column of a table is the time of which others, guessed from names and lengths."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from eha_bench.recordings.information import TopicInformation


@dataclass(frozen=True)
class NamedClock:
    """A column that may hold the time, by its full name or by that within its group.

    Attributes:
        name: as a channels.yaml writes it. unit: as the file says it, "" where it does not.
    """

    name: str
    unit: str

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
