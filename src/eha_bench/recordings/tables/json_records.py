"""Turns JSON values into columns as they come, one record after the other."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.recordings.encodings.field_path import lists_names

_DEEPEST = 40
_NAN = float("nan")


class TooManyValues(Exception):
    """The values are more, or deeper, than a recording can be; says what."""


@dataclass
class Records:
    """Records of one group: a column a number in them, named by its path (`state.p[1]`).

    Attributes:
        most: how many cells the columns may have in total.
        columns: path -> numbers so far; NaN where a record lacks it.
        texts: path -> texts so far.
        labels: path -> the names that a list of texts gives to the elements of others.
        count: records so far.
        changed: paths of lists of names that are not the same in all records.
    """

    most: int
    columns: dict[str, array[float]] = field(default_factory=dict)
    texts: dict[str, list[str | None]] = field(default_factory=dict)
    labels: dict[str, list[str]] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)
    count: int = 0
    _elements: dict[tuple[str, int], list[str]] = field(default_factory=dict)

    def add(self, record: Mapping[str, Any] | list[Any]) -> None:
        """Add one record.

        Raises:
            TooManyValues: there are too many columns for so many records, or it nests too deep.
        """
        if isinstance(record, list):
            self._list("", record, 0)
        else:
            for key, value in record.items():
                self._value(key, value, 0)
        self.count += 1
        if self.count * (len(self.columns) + len(self.texts)) > self.most:
            raise TooManyValues(
                f"{self.count} records of {len(self.columns) + len(self.texts)} different "
                "values each"
            )

    def _value(self, path: str, value: Any, depth: int) -> None:
        kind = type(value)
        if kind is float or kind is int or kind is bool:
            self._number(path, value)
        elif kind is dict:
            self._add_nested(path, value, depth)
        elif kind is list:
            self._list(path, value, depth)
        elif kind is str:
            texts = self.texts.setdefault(path, [])
            texts.extend([None] * (self.count - len(texts)))
            texts.append(value)
        elif path not in self.columns and path not in self.texts:
            self._number(path, _NAN)

    def _number(self, path: str, value: float) -> None:
        column = self.columns.get(path)
        if column is None:
            column = self.columns[path] = array("d")
        if len(column) < self.count:
            column.extend([_NAN] * (self.count - len(column)))
        try:
            column.append(value)
        except OverflowError as error:
            raise TooManyValues(f"'{path[:80]}' holds a number of too many digits") from error

    def _add_nested(self, path: str, value: dict[str, Any], depth: int) -> None:
        if depth > _DEEPEST:
            raise TooManyValues(f"it is nested deeper than {_DEEPEST} levels")
        for key, inner in value.items():
            self._value(f"{path}.{key}", inner, depth + 1)

    def _list(self, path: str, value: list[Any], depth: int) -> None:
        if depth > _DEEPEST:
            raise TooManyValues(f"it is nested deeper than {_DEEPEST} levels")
        if value and lists_names(path.rpartition(".")[2]) and all(type(v) is str for v in value):
            known = self.labels.setdefault(path, value)
            if known != value:
                self.changed.add(path)
            return
        if len(value) > self.most:
            raise TooManyValues(f"'{path[:80]}' has {len(value)} elements in one record")
        names = self._elements.get((path, len(value)))
        if names is None:
            names = [f"{path}[{k}]" if path else str(k) for k in range(len(value))]
            self._elements[path, len(value)] = names
        for name, inner in zip(names, value, strict=True):
            self._value(name, inner, depth + 1)

    def arrays(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield (path, values), each (n,): float64, or texts as objects."""
        for path, numbers in self.columns.items():
            if path in self.texts:
                continue  # sometimes a number, sometimes a text: neither
            numbers.extend([_NAN] * (self.count - len(numbers)))
            yield path, np.frombuffer(numbers, dtype=np.float64)
        for path, texts in self.texts.items():
            texts.extend([None] * (self.count - len(texts)))
            values = np.empty(len(texts), dtype=object)
            values[:] = texts
            yield path, values
