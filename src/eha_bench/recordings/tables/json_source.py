"""JSON and JSON lines as tables: records one after the other, or columns by name."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.encodings.field_path import lists_names
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.tables.json_records import Records, TooManyValues
from eha_bench.recordings.tables.times import NotATime, parse_times

_BLANK = " \t\r\n"
_NUMBER = 8
"""Bytes of a value in a column."""
_MOST_SAID = 5
"""Damaged lines that are reported one by one."""
_MOST_ELEMENTS = 100
"""A list of one record has rarely more elements than this if they are of one sample."""
_DEEPEST = 40
_TOPIC = "topic"
"""Where every line of JSON lines has this key, each topic is a group with its own clock."""


class JsonSource(GroupedTable):
    """A JSON file.

    Read are: one object a line; a list of objects (or of lists); an object of lists, each a
    column; and any of the latter inside objects, as groups. A list of one object of lists is read
    as that object. An element of a list is `position[0]`, or `position[elbow]` where a list of
    names (`names`, `joint_names`) is next to it; a value inside an object is `state.position`. What
    is a single value is metadata.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._records: dict[str, Records] = {}
        self._lists: dict[str, dict[str, NDArray[Any]]] = {}
        self._labels: dict[str, list[str]] = {}
        self._single: dict[str, str] = {}
        self._doubled: Counter[str] = Counter()
        self._left_out = 0
        self._counted = 0, 1  # up to which letter lines were counted, and how many there are
        try:
            self._format = self._parse(self._text())
        except TooManyValues as error:
            raise RecordingError(
                f"it is more than can be read: {error}", where=Place(file=self.path)
            ) from error
        for group, records in self._records.items():
            self._keep(group, dict(records.arrays()))
            self._keep_labels(group, records)
        usual = _usual_length(v for columns in self._lists.values() for v in columns.values())
        for group, columns in self._lists.items():
            self._keep(group, columns, usual)
        if self._left_out > _MOST_SAID:
            self._notes.append(f"{self._left_out - _MOST_SAID} more lines were left out")
        if self._doubled:
            names = ", ".join(f"'{name[:40]}'" for name in list(self._doubled)[:5])
            self._torn = True
            self._notes.append(
                f"{self._doubled.total()} keys occur twice in one object ({names}): "
                "the last of each was read"
            )
        if not any(series.values().dtype.kind == "f" for series in self._series):
            raise RecordingError(
                "it holds no list of numbers and no records with numbers",
                where=Place(file=self.path),
                hint="give a list of objects, one object a line, or an object of lists",
            )

    @property
    def format(self) -> str:
        """`json` or `jsonl`."""
        return self._format

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The single values of the file, by their paths."""
        return {"json": self._single} if self._single else {}

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers, dates, or times of day.

        Raises:
            RecordingError: it holds something else.
        """
        values = self._values(name)
        if values.dtype.kind != "O":
            return self.column(name)
        try:
            return parse_times(values)
        except NotATime as error:
            raise RecordingError(
                f"'{str(values[error.row])[:40]}' is neither a number nor a time (record "
                f"{error.row + 1})",
                where=Place(file=self.path, key=name),
                hint="write dates as 2025-03-01T12:00:00.5",
            ) from None

    def _text(self) -> str:
        try:
            return self._path.read_bytes().decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise RecordingError(
                "this looks like JSON, but it is not UTF-8", where=Place(file=self.path)
            ) from error

    def _parse(self, text: str) -> str:
        """Take all that the text holds; return the name of its form."""
        start = _after_blanks(text, 0)
        if text[start] == "[":
            self._take_list("", self._elements(text, start), 0)
            return "json"
        first, end = self._one(text, start)
        second = _after_blanks(text, text.find("\n", start) + 1 or len(text))
        if end is None and text[second : second + 1] != "{":
            raise RecordingError(
                f"this is not JSON, or it is damaged ({first})",
                where=Place(file=self.path, line=text.count("\n", 0, start) + 1),
                hint="check the file",
            )
        if end is not None and _after_blanks(text, end) == len(text):
            self._walk("", first, 0)
            return "json"
        self._take_lines(text, start)
        return "jsonl"

    def _elements(self, text: str, start: int) -> Iterator[Any]:
        """Yield the elements of a list one by one, so that they are not all in memory at once."""
        position = _after_blanks(text, start + 1)
        while position < len(text) and text[position] != "]":
            budget().tick()
            element, end = self._one(text, position)
            if end is None:
                self._tear(text, position, str(element))
                return
            yield element
            position = _after_blanks(text, end)
            if position < len(text) and text[position] == ",":
                position = _after_blanks(text, position + 1)
            elif position >= len(text) or text[position] != "]":
                break
        if position >= len(text) or text[position] != "]":
            self._tear(text, position, "the list is not closed")
        elif _after_blanks(text, position + 1) < len(text):
            self._tear(text, position + 1, "there is something after the list")

    def _take_list(self, path: str, elements: Iterator[Any], depth: int) -> None:
        """Take the elements of a list, each a record; a single one may hold columns instead."""
        ahead = list(islice(elements, 2))
        if len(ahead) == 1 and _holds_columns(ahead[0]):
            self._walk(path, ahead[0], depth)
            return
        rows = self._group(path)
        for element in chain(ahead, elements):
            rows.add(element if isinstance(element, (dict, list)) else [element])

    def _take_lines(self, text: str, position: int) -> None:
        """Take one document after the other; a damaged line is left out, the others are whole."""
        while position < len(text):
            budget().tick()
            stop = text.find("\n", position)
            document, end = self._one_line(text, position, len(text) if stop < 0 else stop)
            if isinstance(document, (dict, list)) and end is not None:
                self._line(document)
                position = _after_blanks(text, end)
                continue
            reason = str(document) if end is None else "it is not an object"
            self._tear(text, position, reason, last=stop < 0 and end is None)
            position = len(text) if stop < 0 else _after_blanks(text, stop)

    def _one_line(self, text: str, position: int, stop: int) -> tuple[Any, int | None]:
        """Return as `_one` what begins in a line, which most often ends there as well.

        Python counts all lines before a mistake: where there are many, in each line only.
        """
        line = text[position:stop].rstrip()
        try:
            value, end = self._decoder.raw_decode(line)
        except json.JSONDecodeError as error:
            return (error.msg, None) if error.pos < len(line) else self._one(text, position)
        except (ValueError, RecursionError):
            return "it cannot be parsed", None
        return value, position + end

    def _one(self, text: str, position: int) -> tuple[Any, int | None]:
        """Return a JSON value and where it ends; or what is wrong, and None."""
        try:
            value, end = self._decoder.raw_decode(text, position)
        except (ValueError, RecursionError) as error:
            return getattr(error, "msg", "") or "it cannot be parsed", None
        return value, end

    @property
    def _decoder(self) -> json.JSONDecoder:
        return json.JSONDecoder(object_pairs_hook=self._object)

    def _object(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            seen = Counter(key for key, _ in pairs)
            self._doubled.update(key for key, times in seen.items() if times > 1)
        return found

    def _line(self, document: dict[str, Any] | list[Any]) -> None:
        topic = document.get(_TOPIC) if isinstance(document, dict) else None
        self._group(topic if isinstance(topic, str) else "").add(document)

    def _group(self, name: str) -> Records:
        records = self._records.get(name)
        if records is None:
            most = budget().memory // _NUMBER
            left = most - sum(one.count * len(one.columns) for one in self._records.values())
            records = self._records[name] = Records(max(left, 0))
        return records

    def _walk(self, path: str, value: Any, depth: int) -> None:
        """Take the lists that stand anywhere in an object."""
        if depth > _DEEPEST:
            raise TooManyValues(f"it is nested deeper than {_DEEPEST} levels")
        for key, inner in value.items():
            here = f"{path}.{key}" if path else key
            match inner:
                case dict():
                    self._walk(here, inner, depth + 1)
                case [dict(), *_]:
                    self._take_list(here, iter(inner), depth + 1)
                case list():
                    self._column(path, key, inner)
                case _:
                    self._single[here] = str(inner)[:1000]

    def _column(self, group: str, name: str, values: list[Any]) -> None:
        if values and lists_names(name) and all(isinstance(v, str) for v in values):
            self._labels[group] = values
            return
        array = _array(values)
        if array is None:
            self._notes.append(f"'{name[:80]}' was left out: its elements differ in kind")
        elif array.size:
            self._lists.setdefault(group, {})[name] = array

    def _keep(self, group: str, columns: Mapping[str, NDArray[Any]], usual: int = 0) -> None:
        """Keep the columns of a group; matrices with one row a sample, however they stand there."""
        usual = _usual_length(columns.values()) or usual
        for name, values in columns.items():
            lies = values.ndim == 2 and len(values) != usual == values.shape[1]
            upright = values.T if lies else values
            self._series.append(Series(group, name, partial(_as_they_are, upright)))

    def _keep_labels(self, group: str, records: Records) -> None:
        for path, names in records.labels.items():
            if path in records.changed:
                self._notes.append(f"the names in '{path}' change: no element is found by its name")
            else:
                self._labels[f"{group}/{path.rpartition('.')[0]}".strip("/")] = names

    def _number_of_label(self, column: str, label: str) -> int | None:
        """Return the place of a name in the nearest list of names around a column."""
        groups = dict.fromkeys(series.group for series in self._series)
        paths = [f"{group}/{column}".strip("/").replace("/", ".") for group in ("", *groups)]
        around = [
            (len(place), names)
            for place, names in self._labels.items()
            if label in names and any(path.startswith(place.replace("/", ".")) for path in paths)
        ]
        return max(around)[1].index(label) if around else None

    def _tear(self, text: str, position: int, reason: str, *, last: bool = True) -> None:
        self._torn = True
        self._left_out += 1
        if self._left_out > _MOST_SAID:
            return
        counted, lines = self._counted
        line = lines + text.count("\n", counted, position)
        self._counted = position, line
        rest = "; everything before was read" if last else "; this line was left out"
        self._notes.append(f"it is damaged or torn in line {line} ({reason}){rest}")


def _holds_columns(record: Any) -> bool:
    """Whether the only record of a list holds columns of samples, and is no sample itself.

    A sample has numbers of its own (its time, also within a header or as a date), or names for the
    elements of its lists; both may stand beside columns, which are longer then.
    """
    if not isinstance(record, dict):
        return False
    longest = max((len(value) for value in record.values() if _is_series(value)), default=0)
    beside = any(
        isinstance(value, (bool, int, float, dict))
        or (isinstance(value, str) and _is_date(value))
        or (isinstance(value, list) and lists_names(key))
        for key, value in record.items()
    )
    return longest >= (_MOST_ELEMENTS if beside else 2)


def _is_date(text: str) -> bool:
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True


def _is_series(value: Any) -> bool:
    return isinstance(value, list) and all(
        inner is None or isinstance(inner, (bool, int, float, list)) for inner in value
    )


def _after_blanks(text: str, position: int) -> int:
    while position < len(text) and text[position] in _BLANK:
        position += 1
    return position


def _usual_length(arrays: Iterable[NDArray[Any]]) -> int:
    """Return the length that most columns have, 0 if there are only matrices."""
    lengths = Counter(len(values) for values in arrays if values.ndim == 1)
    return lengths.most_common(1)[0][0] if lengths else 0


def _array(values: list[Any]) -> NDArray[Any] | None:
    """Return a list as numbers (n,) or (n, m), or texts (n,); None if it is neither."""
    if all(isinstance(value, str) for value in values):
        texts = np.empty(len(values), dtype=object)
        texts[:] = values
        return texts
    try:
        found = np.array(
            [
                [_number(inner) for inner in value] if isinstance(value, list) else _number(value)
                for value in values
            ],
            dtype=np.float64,
        )
    except (TypeError, ValueError, OverflowError):
        return None
    return found if found.ndim <= 2 else None


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, (bool, int, float)):
        return float(value)
    raise TypeError


def _as_they_are(values: NDArray[Any]) -> NDArray[Any]:
    return values
