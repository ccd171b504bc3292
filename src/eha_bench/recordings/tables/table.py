"""Tables as sources: columns instead of topics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.units import factor_and_offset
from eha_bench.recordings.budget import budget
from eha_bench.recordings.channel_map import ChannelMap, ChannelMapFile, TimeColumn
from eha_bench.recordings.naming import among, printable
from eha_bench.recordings.source import Source, TimeSpan, Topic, TopicRequest
from eha_bench.recordings.track import Column, Stamps, Track

_NUMBER = 8
"""Bytes of a value."""


class TableSource(Source):
    """A table: all columns share one clock, a column or a sample rate."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notes: list[str] = []
        self._torn = False
        self.own_epoch: int | None = None
        """Time zero in ns since 1970, of a table that eha-bench wrote; None of another one."""
        self.exact_seconds: dict[str, Column] = {}
        """Times of a group as they stand there, s; in nanoseconds a last bit may differ."""

    @property
    def path(self) -> str:
        """The file, for messages."""
        return str(self._path)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far."""
        return tuple(self._notes)

    @property
    def damaged(self) -> bool:
        """Whether its end was cut off."""
        return self._torn

    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""

    @abstractmethod
    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,).

        Raises:
            RecordingError: it holds something else.
        """

    @abstractmethod
    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers, datetime64 or timedelta64.

        Raises:
            RecordingError: it holds something else.
        """

    def topics(self) -> tuple[Topic, ...]:
        """The columns, each as a topic."""
        return tuple(Topic(name, None) for name in self.names())

    def tracks(
        self, wanted: Mapping[str, TopicRequest], span: TimeSpan | None = None
    ) -> dict[str, Track]:
        """Refuse: a table has no topics."""
        del wanted, span
        raise RecordingError("a table has no topics", where=Place(file=self.path))

    def units(self) -> Mapping[str, str]:
        """Units by column, as far as the file says them."""
        return {}

    def titles(self) -> Mapping[str, str]:
        """Of each column its name without the groups around it."""
        return {name: name for name in self.names()}

    def group_of(self, name: str) -> str:
        """Return what shares a clock with a column: the file, or a group of its columns."""
        del name
        return self.path

    def in_columns(self, mapping: ChannelMap) -> ChannelMap:
        """Return a map with every channel of this table called by its column."""
        return mapping

    def own_map(self) -> ChannelMap:
        """Return the map of a table that says itself what it holds.

        A column is taken if it is named as a channel, or if the file gives its unit; one of a
        known name without a unit is in SI.

        Raises:
            RecordingError: it has no clock, or no such column.
        """
        from eha_bench.recordings.tables.self_description import described_channels

        channels, clock, notes = described_channels(
            self.titles(), self.units(), own_clock=self.has_clock
        )
        if not channels or (clock is None and not self.has_clock):
            raise RecordingError(
                "no channel map says what this table holds",
                where=Place(file=self.path),
                hint=f"give a channels.yaml that maps its columns: {printable(self.names())}",
            )
        self._notes += notes
        return ChannelMapFile(time=clock, channels=channels)

    @property
    def has_clock(self) -> bool:
        """Whether the file itself says when its samples were taken."""
        return False

    def table(self, mapping: ChannelMap, columns: tuple[str, ...]) -> dict[str, Track]:
        """Return the wanted columns as one track a clock.

        Raises:
            RecordingError: a column is missing or of another length, or there is no clock.
        """
        groups: dict[str, list[str]] = {}
        for name in dict.fromkeys(columns):
            groups.setdefault(self.group_of(name), []).append(name)
        return {group: self._track(mapping, group, names) for group, names in groups.items()}

    def _track(self, mapping: ChannelMap, group: str, columns: list[str]) -> Track:
        values: dict[str, Column] = {}
        kinds = {}
        taken = 0
        for name in columns:
            raw = self._checked_column(name)
            taken += _NUMBER * raw.size
            budget().hold(taken, "its columns")
            kinds[name] = raw.dtype.str if raw.dtype.kind in "iuf" else ""
            values[name] = raw.astype(np.float64)
        sizes = {name: column.size for name, column in values.items()}
        stamps = self._clock_of(mapping, group, next(iter(sizes.values())))
        sizes[mapping.time.column if mapping.time else "the time"] = stamps.size
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{name}: {size}" for name, size in sizes.items())
            raise RecordingError(
                f"its columns differ in length ({listed})", where=Place(file=self.path)
            )
        return Track(group, stamps, values, self._kinds(kinds))

    def _clock_of(self, mapping: ChannelMap, group: str, count: int) -> Stamps:
        """Return the stamps of a group's samples: by a column, a rate, or the file's own clock."""
        if mapping.time is not None:
            return self._stamps(mapping.time, group)
        if mapping.sample_rate is None:
            raise RecordingError(
                "a table needs a clock",
                where=Place(file=self.path),
                hint="say 'time: {column: t, unit: s}' or 'sample_rate: 1 kHz' in channels.yaml",
            )
        rate = mapping.sample_rate
        if count / rate >= 2**62 / 1e9:
            raise RecordingError(
                f"{count} samples at {rate:g} Hz are longer than a recording can be",
                where=Place(file=self.path, key="sample_rate"),
                hint="give the sample rate in its unit, e.g. 1 kHz",
            )
        stamps: Stamps = np.rint(np.arange(count) * (1e9 / rate)).astype(np.int64)
        return stamps

    def _kinds(self, kinds: dict[str, str]) -> dict[str, str]:
        return kinds

    def _checked_column(self, name: str) -> NDArray[Any]:
        self._check(name)
        return self.column(name)

    def _check(self, name: str) -> None:
        if not self.has(name):
            raise RecordingError(
                f"there is no column '{name}'",
                where=Place(file=self.path),
                hint=among(name, self.names(), "columns"),
            )

    def has(self, name: str) -> bool:
        """Whether there is such a column."""
        return name in self.names()

    def _stamps(self, clock: TimeColumn, group: str) -> Stamps:
        self._check(clock.column)
        return self._in_nanoseconds(clock, clock.column, group)

    def _in_nanoseconds(self, clock: TimeColumn, column: str, group: str) -> Stamps:
        times = self.clock(column)
        if clock.unit == "s" and times.dtype.kind == "f":
            self.exact_seconds[group] = times.astype(np.float64)
        return nanoseconds(times, clock.unit, Place(file=self.path, key=clock.column))


def nanoseconds(times: NDArray[Any], unit: str, where: Place) -> Stamps:
    """Return a column of times as whole nanoseconds, shape (n,).

    Raises:
        RecordingError: a time is missing, or too large.
    """
    if times.dtype.kind == "b":
        times = times.astype(np.float64)
    dated = times.dtype.kind in "mM"
    bad = np.flatnonzero(np.isnat(times) if dated else ~np.isfinite(times))
    if bad.size:
        raise RecordingError(
            f"the time is not a number in {bad.size} of {times.size} rows, first in row "
            f"{bad[0] + 1}",
            where=where,
            hint="remove these rows, or give sample_rate instead of time",
        )
    if dated:
        return times.astype(f"{times.dtype.kind}8[ns]").astype(np.int64)
    factor, offset = factor_and_offset(unit, "s")
    tick = factor * 1e9
    with np.errstate(over="ignore"):
        farthest = np.abs(times.astype(np.float64) * tick + offset * 1e9).max(initial=0)
    if farthest >= 2**62:
        raise RecordingError(
            f"the time is too large for its unit ({unit})",
            where=where,
            hint="check its unit (ns or us?)",
        )
    if tick < 1 or tick % 1 or offset:
        return np.rint((times.astype(np.float64) * factor + offset) * 1e9).astype(np.int64)
    # whole units and the rest apart: a double holds no seconds since 1970 to the nanosecond
    whole = np.floor(times)
    rest = np.rint((times - whole).astype(np.float64) * tick).astype(np.int64)
    stamps: Stamps = whole.astype(np.int64) * np.int64(tick) + rest
    return stamps
