"""CSV files and their relatives as tables."""

from __future__ import annotations

import re
import warnings
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.table import TableSource

_DELIMITERS = ",;\t|"


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
