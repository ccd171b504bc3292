"""CSV files and their relatives as tables."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.channel_map import TimeColumn
from eha_bench.recordings.source import HOLDS_DATES
from eha_bench.recordings.tables.csv_layout import MISSING, CsvLayout, NoTable, unique_names
from eha_bench.recordings.tables.table import TableSource
from eha_bench.recordings.tables.times import NotATime, parse_times
from eha_bench.recordings.track import Stamps

_MOST_TIMES = 12
"""A table takes so many times its size while it is read: as text, twice, and as numbers."""
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
_DATE = re.compile(r"\s*\d{4}-\d{1,2}-\d{1,2}([T ]|$)")


class CsvSource(TableSource):
    """Text with a delimiter (comma, semicolon, tab, bar or blanks) and a line of names."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        budget().hold(_MOST_TIMES * path.stat().st_size, "the table")
        self._columns = self._parse(self._text())
        self._often = Counter(self._layout.names)
        columns = list(self._columns)
        header = self._layout.header
        self._by_header = dict(zip(unique_names(header), columns, strict=False))
        # of each column of a pair its X
        self._times = {
            name: columns[place - place % 2] for place, name in enumerate(columns) if header
        }
        times = [self._columns[name] for name in columns[::2]] if header else []
        self._one_time = all(np.array_equal(column, times[0]) for column in times)

    @property
    def format(self) -> str:
        """`csv`."""
        return "csv"

    def names(self) -> tuple[str, ...]:
        """Names of the columns; where one stands there again, a number is added to it."""
        if self._times and self._one_time:
            return (self._layout.header[0], *list(self._columns)[1::2])
        return tuple(self._columns)

    def has(self, name: str) -> bool:
        """Whether there is such a column, also by what stands right above its numbers."""
        return name in self._columns or name in self._by_header

    def group_of(self, name: str) -> str:
        """Return what shares a clock with a column: the file, or a pair with times of its own."""
        time = self._times.get(self._own_name(name), "")
        return self.path if self._one_time or not time else time.rpartition("/")[0]

    def _stamps(self, clock: TimeColumn, group: str) -> Stamps:
        """Return the stamps by a column; by the X of each pair where that is named."""
        if not self._one_time and clock.column == self._layout.header[0]:
            return self._in_nanoseconds(clock, f"{group}/{clock.column}", group)
        return super()._stamps(clock, group)

    def _own_name(self, name: str) -> str:
        return name if name in self._columns else self._by_header.get(name, name)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,).

        Raises:
            RecordingError: a cell is not a number.
        """
        column = self._columns[self._own_name(name)]
        again = self._often[name]
        if again > 1:
            self._notes.append(
                f"{again} columns are called '{name}': the first was taken; the next is '{name}.1'"
            )
        if column.dtype.kind in "iuf":
            return column
        if column.dtype.kind == "b":
            return column.astype(np.float64)
        raise self._not_numbers(name, column)

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers, dates, or times of day.

        Raises:
            RecordingError: a cell is none of these.
        """
        column = self._columns[self._own_name(name)]
        if column.dtype.kind != "O":
            return self.column(name)
        try:
            return parse_times(column)
        except NotATime as error:
            cell = str(column[error.row])[:40]
            raise RecordingError(
                f"'{cell}' in column '{name}' is neither a number nor a time",
                where=Place(file=self.path, line=self._line(error.row)),
                hint="write dates as 2025-03-01T12:00:00.5, or correct or remove the line",
            ) from None

    def _kinds(self, kinds: dict[str, str]) -> dict[str, str]:
        """Text has no types: how an integer was stored is not known."""
        return dict.fromkeys(kinds, "")

    def _text(self) -> str:
        """Return the file's text with line ends of one kind."""
        text = self._decoded(self._path.read_bytes())
        return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text

    def _decoded(self, content: bytes) -> str:
        encoding = next((e for mark, e in _MARKS.items() if content.startswith(mark)), "utf-8")
        try:
            return content.decode(encoding)
        except UnicodeDecodeError as error:
            printable = not re.search(rb"[\x00-\x08\x0e-\x1f]", content)
            if encoding == "utf-8" and printable:
                self._notes.append("it is not UTF-8; its letters were read as Windows-1252")
                return content.decode("cp1252", "replace")
            raise RecordingError(
                "this is neither a recording nor text",
                where=Place(file=self.path),
                hint="check the file",
            ) from error

    def _parse(self, text: str) -> dict[str, NDArray[Any]]:
        import pandas as pd

        where = Place(file=self.path)
        try:
            self._layout = layout = CsvLayout.of(text)
        except NoTable as error:
            where = Place(file=self.path, line=error.line)
            raise RecordingError(str(error), where=where, hint=error.hint) from error
        self._notes += layout.notes
        text = self._without_torn_end(text)
        if "#" in text:
            text = _without_excel_errors(text, layout.delimiter)
        if layout.trailing:
            text = re.sub(re.escape(layout.delimiter) + r"$", "", text, flags=re.MULTILINE)
        # as bytes: pandas would turn text into four bytes a letter
        stream = BytesIO(text.encode())
        del text
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)
                frame = pd.read_csv(
                    stream, sep=r"\s+" if layout.delimiter == " " else layout.delimiter,
                    decimal=layout.decimal, skiprows=layout.first, header=None,
                    names=range(len(layout.names)), na_values=MISSING, skipinitialspace=True,
                    index_col=False, low_memory=False, comment="#", **_exactly(),
                )  # fmt: skip
        except (pd.errors.ParserWarning, pd.errors.ParserError) as error:
            raise RecordingError(
                "some of its lines hold more cells than the header line "
                f"({' '.join(str(error).split())[:200]})",
                where=where,
                hint="give every column a name, and every line as many cells",
            ) from error
        except pd.errors.EmptyDataError:
            frame = pd.DataFrame()
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise RecordingError(f"cannot be read as CSV ({reason})", where=where) from error
        frame = frame.dropna(how="all")
        if frame.empty:
            raise RecordingError("the table is empty", where=where, hint="record it again")
        self._lines = frame.index.to_numpy()
        return dict(
            zip(
                unique_names(layout.names),
                (frame[k].to_numpy() for k in frame.columns),
                strict=True,
            )
        )

    def _without_torn_end(self, text: str) -> str:
        """Drop a last line that was cut off; say so."""
        if text.endswith("\n"):
            return text
        body, _, last = text.rpartition("\n")
        delimiter = self._layout.delimiter
        cells = len(last.split()) if delimiter == " " else last.count(delimiter) + 1
        if body and cells < len(self._layout.names):
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
        comma = self._layout.decimal == ","
        for row, cell in enumerate(column.tolist()):
            try:
                float(cell.replace(",", ".") if comma and isinstance(cell, str) else cell)
                wrong = comma and isinstance(cell, str) and "." in cell
            except (TypeError, ValueError, OverflowError):
                wrong = True
            if wrong:
                comment = " with a decimal comma" if comma else ""
                if _DATE.match(str(cell)):
                    return RecordingError(
                        f"column '{name}' {HOLDS_DATES} ('{str(cell)[:40]}'), not numbers",
                        where=Place(file=self.path, line=self._line(row)),
                        hint=f"it can be the clock: 'time: {{column: {name}}}' in channels.yaml",
                    )
                return RecordingError(
                    f"'{str(cell)[:40]}' in column '{name}' is not a number{comment}",
                    where=Place(file=self.path, line=self._line(row)),
                    hint="correct or remove the line",
                )
        return RecordingError(f"column '{name}' does not hold numbers", where=Place(file=self.path))

    def _line(self, row: int) -> int:
        """Return the line of a row, from 1; empty lines and comments were no rows."""
        left = int(self._lines[row])
        lines = self._path.read_bytes().splitlines()[self._layout.first :]
        for number, line in enumerate(lines):
            if line.strip() and not line.lstrip().startswith(b"#"):
                if not left:
                    return self._layout.first + number + 1
                left -= 1
        return self._layout.first + 1


def _exactly() -> dict[str, Any]:
    """Return how to tell pandas to read every number to its last bit; from 3.0 it always does."""
    import pandas as pd

    return {} if int(pd.__version__.partition(".")[0]) >= 3 else {"float_precision": "round_trip"}


def _without_excel_errors(text: str, delimiter: str) -> str:
    """Empty the cells that Excel could not compute (`#N/A`, `#DIV/0!`): these are not comments."""
    between = re.escape(delimiter)
    error = rf'(?<={between})[ ]*"?#[A-Z/0]+[!?]?"?[ ]*(?={between}|$)'
    return re.sub(error, "", text, flags=re.MULTILINE)
