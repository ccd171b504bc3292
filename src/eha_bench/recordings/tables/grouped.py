"""Tables in groups: the columns of a group share a clock, which is the file's own or a column."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.channel_map import ChannelMap, TimeColumn
from eha_bench.recordings.naming import among
from eha_bench.recordings.tables.table import TableSource
from eha_bench.recordings.track import Stamps


@dataclass(frozen=True)
class Series:
    """One column of a group.

    Attributes:
        group: what shares its clock; empty where the file has only one.
        name: within the group.
        values: gives the samples, shape (n,) or (n, m).
        unit: as the file says it; None if it says none.
        clock: what it shares its clock with, where that is not all of its group.
    """

    group: str
    name: str
    values: Callable[[], NDArray[Any]]
    unit: str | None = None
    clock: str = ""

    @property
    def shared(self) -> str:
        """What ticks together with it."""
        return self.clock or self.group

    @property
    def path(self) -> str:
        """Group and name, which are a column's name where its own is not the only one."""
        return f"{self.group}/{self.name}" if self.group else self.name


class GroupedTable(TableSource):
    """A file of columns in groups.

    A column is called by its name, or by `group/name` where several groups have one of this name;
    in `channels.yaml` a group may also be given as `topic`, and the column as `field`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._series: list[Series] = []
        self._clocks: dict[str, Callable[[], Stamps]] = {}

    @cached_property
    def _by_name(self) -> dict[str, Series]:
        often = Counter(series.name for series in self._series)
        found: dict[str, Series] = {}
        for series in self._series:
            name = series.name if often[series.name] == 1 else series.path
            if name in found:
                name = _free_name(name, found)
            found[name] = series
        return found

    @cached_property
    def _by_path(self) -> dict[str, Series]:
        """The columns by group and name, however these are joined."""
        found: dict[str, Series] = {}
        for series in self._series:
            found.setdefault(_plain(series.path), series)
        return found

    @property
    def series(self) -> list[Series]:
        """All columns, in the file's order."""
        return self._series

    @property
    def clocks(self) -> Mapping[str, Callable[[], Stamps]]:
        """The clocks that the file itself has, by what shares them."""
        return self._clocks

    def forget_names(self) -> None:
        """Look at the names again, after columns came in."""
        for cached in ("_by_name", "_by_path"):
            self.__dict__.pop(cached, None)

    @property
    def has_clock(self) -> bool:
        """Whether every group has its own clock."""
        return bool(self._series) and all(s.shared in self._clocks for s in self._series)

    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._by_name)

    def titles(self) -> Mapping[str, str]:
        """Of each column its name within its group."""
        return {name: series.name for name, series in self._by_name.items()}

    def units(self) -> Mapping[str, str]:
        """Units by column, where the file says one."""
        return {
            name: series.unit for name, series in self._by_name.items() if series.unit is not None
        }

    def has(self, name: str) -> bool:
        """Whether there is such a column."""
        return self._find(name) is not None

    def group_of(self, name: str) -> str:
        """Return the group of a column; the file where it has only one."""
        found = self._find(name)
        return found[0].shared if found is not None and found[0].shared else self.path

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,).

        Raises:
            RecordingError: it holds something else.
        """
        values = self._values(name)
        if values.dtype.kind not in "iufb":
            raise RecordingError(
                "the column does not hold numbers", where=Place(file=self.path, key=name)
            )
        if values.ndim != 1:
            raise RecordingError(
                f"the column is an array of {values.shape[1]} numbers a sample"
                if values.ndim == 2
                else "the column is an array of several dimensions",
                where=Place(file=self.path, key=name),
                hint=f"add an index: '{name}[0]'",
            )
        return values

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,).

        Raises:
            RecordingError: it holds something else.
        """
        values = self._values(name)
        return values if values.dtype.kind in "mM" else self.column(name)

    def in_columns(self, mapping: ChannelMap) -> ChannelMap:
        """Return a map with every channel called by its column; topics are groups here.

        Raises:
            RecordingError: there is no such group, or no such column in it.
        """
        channels = {}
        for name, entry in mapping.channels.items():
            if entry.topic is None or entry.field is None:
                channels[name] = entry
                continue
            path = f"{entry.topic}/{entry.field}"
            if self._find(path) is None:
                raise self._no_such(entry.topic, entry.field)
            channels[name] = entry.model_copy(update={"column": path, "topic": None, "field": None})
        return mapping.model_copy(update={"channels": channels})

    def _no_such(self, group: str, name: str) -> RecordingError:
        groups = list(dict.fromkeys(series.group for series in self._series))
        inside = [s.name for s in self._series if _plain(s.group) == _plain(group)]
        where = Place(file=self.path, topic=group)
        if not inside:
            return RecordingError(
                "there is no such topic or group", where=where, hint=among(group, groups, "groups")
            )
        return RecordingError(
            f"it has no field '{name}'", where=where, hint=among(name, inside, "fields")
        )

    def _clock_of(self, mapping: ChannelMap, group: str, count: int) -> Stamps:
        own = self._clocks.get(group if group != self.path else "")
        if mapping.time is None and mapping.sample_rate is None and own is not None:
            return own()
        return super()._clock_of(mapping, group, count)

    def _stamps(self, clock: TimeColumn, group: str) -> Stamps:
        """Return the stamps by a column of the group, or by one that all groups share."""
        owner = next((s.group for s in self._series if s.shared == group), group)
        inside = f"{owner}/{clock.column}"
        name = inside if group != self.path and self._find(inside) is not None else clock.column
        self._check(name)
        return self._in_nanoseconds(clock, name, group)

    def _values(self, name: str) -> NDArray[Any]:
        self._check(name)
        found = self._find(name)
        assert found is not None
        series, element = found
        values = series.values()
        return values if element is None else values[:, element]

    def _find(self, name: str) -> tuple[Series, int | None] | None:
        """Return a column, and which element of each of its samples is meant."""
        series = self._by_name.get(name) or self._by_path.get(_plain(name))
        if series is not None:
            return series, None
        stem, bracket, rest = name.rpartition("[")
        if not bracket or not rest.endswith("]"):
            return None
        inside = rest[:-1].strip().strip("\"'")
        owner = self._by_name.get(stem) or self._by_path.get(_plain(stem))
        index = int(inside) if inside.isdecimal() else self._number_of_label(stem, inside)
        if index is None:
            return None
        if owner is None:
            element = f"{stem}[{index}]"
            inner = self._by_name.get(element) or self._by_path.get(_plain(element))
            return None if inner is None else (inner, None)
        values = owner.values()
        return (owner, index) if values.ndim == 2 and index < values.shape[1] else None

    def _number_of_label(self, column: str, label: str) -> int | None:
        """Return the number of the element that goes by a name, None where nothing names them."""
        del column, label
        return None


def _plain(path: str) -> str:
    """Return a path in which it does not matter how its steps are joined."""
    return path.strip("/").replace("/", ".")


def _free_name(name: str, taken: Mapping[str, Any]) -> str:
    number = 1
    while f"{name}.{number}" in taken:
        number += 1
    return f"{name}.{number}"
