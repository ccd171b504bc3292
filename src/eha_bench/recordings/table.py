"""Tables (CSV, Parquet) as sources: columns instead of topics."""

from __future__ import annotations

import re
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.units import factor_and_offset
from eha_bench.recordings.channel_map import ChannelEntry, ChannelMap, ChannelMapFile, TimeColumn
from eha_bench.recordings.source import Source, Span, Topic, Wanted
from eha_bench.recordings.track import Column, Stamps, Track

_DELIMITERS = ",;\t|"


class TableSource(Source):
    """A table: all columns share one clock, a column or a sample rate."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notes: list[str] = []
        self._torn = False

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

    def topics(self) -> tuple[Topic, ...]:
        """The columns, each as a topic."""
        return tuple(Topic(name, None) for name in self.names())

    def tracks(self, wanted: Mapping[str, Wanted], span: Span | None = None) -> dict[str, Track]:
        """Refuse: a table has no topics."""
        del wanted, span
        raise RecordingError("a table has no topics", where=Place(file=self.path))

    def own_map(self) -> ChannelMap:
        """Return the map of a table that eha_bench wrote: columns named as channels, time in s.

        Raises:
            RecordingError: it has no column `time`, or none that is named as a channel.
        """
        names = self.names()
        known = [name for name in names if name in CHANNELS and CHANNELS[name].unit]
        if "time" not in names or not known:
            raise RecordingError(
                "no channel map says what this table holds",
                where=Place(file=self.path),
                hint=f"give a channels.yaml that maps its columns: {', '.join(names)[:500]}",
            )
        self._notes.append("columns were taken by their names, in SI units")
        return ChannelMapFile(
            time=TimeColumn(column="time"),
            channels={name: ChannelEntry(column=name) for name in known},
        )

    def table(self, mapping: ChannelMap, columns: tuple[str, ...]) -> dict[str, Track]:
        """Return the wanted columns as one track.

        Raises:
            RecordingError: a column is missing or of another length, or there is no clock.
        """
        values: dict[str, Column] = {}
        kinds = {}
        for name in columns:
            raw = self._checked(name)
            kinds[name] = raw.dtype.str if raw.dtype.kind in "iuf" else ""
            values[name] = raw.astype(np.float64)
        sizes = {name: column.size for name, column in values.items()}
        count = next(iter(sizes.values()))
        if mapping.time is None and mapping.sample_rate is None:
            raise RecordingError(
                "a table needs a clock",
                where=Place(file=self.path),
                hint="say 'time: {column: t, unit: s}' or 'sample_rate: 1 kHz' in channels.yaml",
            )
        if mapping.time is not None:
            stamps = self._stamps(mapping.time)
            sizes[mapping.time.column] = stamps.size
        else:
            stamps = np.rint(np.arange(count) * (1e9 / (mapping.sample_rate or 1.0))).astype(
                np.int64
            )
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{name}: {size}" for name, size in sizes.items())
            raise RecordingError(
                f"its columns differ in length ({listed})", where=Place(file=self.path)
            )
        return {self.path: Track(self.path, stamps, values, self._kinds(kinds))}

    def _kinds(self, kinds: dict[str, str]) -> dict[str, str]:
        return kinds

    def _checked(self, name: str) -> NDArray[Any]:
        if name not in self.names():
            raise RecordingError(
                f"there is no column '{name}'",
                where=Place(file=self.path),
                hint=f"its columns are: {', '.join(self.names())[:500]}",
            )
        return self.column(name)

    def _stamps(self, clock: TimeColumn) -> Stamps:
        raw = self._checked(clock.column)
        if raw.dtype.kind == "M":
            return raw.astype("datetime64[ns]").astype(np.int64)
        where = Place(file=self.path, key=clock.column)
        time = raw.astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(time))
        if bad.size:
            raise RecordingError(
                f"the time is not a number in {bad.size} of {time.size} rows, first in row "
                f"{bad[0] + 1}",
                where=where,
                hint="remove these rows, or give sample_rate instead of time",
            )
        factor, offset = factor_and_offset(clock.unit, "s")
        if raw.dtype.kind in "iu" and factor == 1e-9 and not offset:
            return raw.astype(np.int64)
        nanoseconds = np.rint((time * factor + offset) * 1e9)
        if np.abs(nanoseconds).max(initial=0) >= 2**62:
            raise RecordingError("the time is too large for its unit", where=where)
        return nanoseconds.astype(np.int64)


class CsvSource(TableSource):
    """Text with a delimiter (comma, semicolon, tab or bar) and a line of names."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._columns = self._parse()

    @property
    def format(self) -> str:
        """`csv`."""
        return "csv"

    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._columns)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,).

        Raises:
            RecordingError: a cell is not a number.
        """
        column = self._columns[name]
        if column.dtype.kind in "iuf":
            return column
        if column.dtype.kind == "b":
            return column.astype(np.float64)
        raise self._not_numbers(name, column)

    def _kinds(self, kinds: dict[str, str]) -> dict[str, str]:
        """Text has no types: how an integer was stored is not known."""
        return dict.fromkeys(kinds, "")

    def _parse(self) -> dict[str, NDArray[Any]]:
        import pandas as pd

        where = Place(file=self.path)
        try:
            text = self._path.read_bytes().decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise RecordingError(
                "this is neither a recording nor text", where=where, hint="check the file"
            ) from error
        first, self._skipped = _first_line(text)
        delimiter = max(_DELIMITERS, key=first.count)
        if delimiter not in first:
            raise RecordingError(
                "this is not a table: its first line holds no delimiter (comma, semicolon, tab)",
                where=Place(file=self.path, line=self._skipped + 1),
                hint="give a CSV file with a line of column names",
            )
        decimal = "," if delimiter != "," and re.search(r"\d,\d", text[:100_000]) else "."
        text = _without_last_delimiter(self._without_torn_end(text, delimiter), delimiter)
        from io import StringIO

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)
                frame = pd.read_csv(
                StringIO(text), sep=delimiter, decimal=decimal, skiprows=self._skipped,
                skipinitialspace=True, index_col=False, low_memory=False, comment="#",
            )  # fmt: skip
        except pd.errors.ParserWarning as error:
            raise RecordingError(
                "its lines hold more cells than the line of names",
                where=Place(file=self.path, line=self._skipped + 1),
                hint="give every column a name",
            ) from error
        except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise RecordingError(f"cannot be read as CSV ({reason})", where=where) from error
        if frame.empty:
            raise RecordingError("the table is empty", where=where, hint="record it again")
        return {str(name).strip(): frame[name].to_numpy() for name in frame.columns}

    def _without_torn_end(self, text: str, delimiter: str) -> str:
        """Drop a last line that was cut off; say so."""
        if text.endswith(("\n", "\r")):
            return text
        body, _, last = text.rpartition("\n")
        cells = _first_line(text)[0].count(delimiter)
        if body and last.count(delimiter) < cells:
            self._torn = True
            self._notes.append(
                f"the last line was cut off after {len(last)} characters and left out"
            )
            return body + "\n"
        self._notes.append(
            "the last line has no line end: if the file was cut, its last number may be short"
        )
        return text

    def _not_numbers(self, name: str, column: NDArray[Any]) -> RecordingError:
        for row, cell in enumerate(column.tolist()):
            try:
                float(cell)
            except (TypeError, ValueError):
                return RecordingError(
                    f"'{str(cell)[:40]}' in column '{name}' is not a number",
                    where=Place(file=self.path, line=row + 2 + self._skipped),
                    hint="correct or remove the line",
                )
        return RecordingError(f"column '{name}' does not hold numbers", where=Place(file=self.path))


def _without_last_delimiter(text: str, delimiter: str) -> str:
    """Remove the delimiter that some programs write behind the last cell, but not behind names."""
    lines = [line for line in text.split("\n", 200) if line.strip() and line[0] not in "#%"][:2]
    if len(lines) < 2 or not lines[1].rstrip("\r").endswith(delimiter):
        return text
    if lines[0].count(delimiter) >= lines[1].count(delimiter):
        return text
    return re.sub(re.escape(delimiter) + r"(?=\r?$)", "", text, flags=re.MULTILINE)


def _first_line(text: str) -> tuple[str, int]:
    """Return the first line that is neither empty nor a comment, and how many stand before it."""
    for number, line in enumerate(text.splitlines()):
        if line.strip() and not line.lstrip().startswith(("#", "%")):
            return line, number
    return "", 0


class ParquetSource(TableSource):
    """An Apache Parquet file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            self._file = pq.ParquetFile(path)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise RecordingError(
                f"the Parquet file is damaged or torn ({' '.join(str(error).split())[:200]})",
                where=Place(file=self.path),
                hint="its index stands at the end, so a torn file cannot be read",
            ) from error

    @property
    def format(self) -> str:
        """`parquet`."""
        return "parquet"

    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._file.schema_arrow.names)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,); nulls are NaN.

        Raises:
            RecordingError: it holds something else, or is damaged.
        """
        import pyarrow as pa

        where = Place(file=self.path, key=name)
        try:
            column = self._file.read(columns=[name]).column(name)
            values: NDArray[Any] = column.to_numpy()
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise RecordingError(
                f"cannot be read ({' '.join(str(error).split())[:200]})", where=where
            ) from error
        if values.dtype.kind not in "iufbM":
            raise RecordingError("the column does not hold numbers", where=where)
        if not values.size:
            raise RecordingError("the table is empty", where=where, hint="record it again")
        return values
