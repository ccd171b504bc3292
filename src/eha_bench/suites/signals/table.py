"""Two columns of a CSV file as arrays in SI."""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path, PurePosixPath

from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.core.units import factor_and_offset
from eha_bench.core.yaml_file import StrictModel, read_text


class Column(StrictModel):
    """A column of a CSV file, by its name in the first line, and its unit."""

    column: str
    unit: str


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file in the suite's folder or below.

    Raises:
        ValueError: the name is absolute, or leads out of the folder.
    """
    parts = PurePosixPath(name.replace("\\", "/"))
    if not name or parts.is_absolute() or ".." in parts.parts or ":" in parts.parts[0]:
        raise ValueError(f"'{name}' is outside the suite's folder: name it relative to the suite")
    return folder / parts


def read_columns(
    path: Path, time: Column, value: Column, unit: str
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return time in s and value in the SI unit `unit`, each (n,), n >= 2, time increasing.

    Raises:
        InputError: with the file's line: no such file or column, not a number, NaN, time that
            does not increase, fewer than two rows.
        UnitError: a unit of the wrong dimension.
    """
    scales = (factor_and_offset(time.unit, "s"), factor_and_offset(value.unit, unit))
    lines = [
        (number, line)
        for number, line in enumerate(read_text(path).lstrip("\ufeff").splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError("the file is empty", where=Place(file=str(path)))
    separator = max(",;\t", key=lines[0][1].count)
    rows = [[cell.strip() for cell in row] for row in _rows([line for _, line in lines], separator)]
    indices = [_index(rows[0], column.column, path, lines[0][0]) for column in (time, value)]
    times, values = [], []
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        cells = [_number(row, i, rows[0][i], path, number) for i in indices]
        found = [
            factor * cell + offset for cell, (factor, offset) in zip(cells, scales, strict=True)
        ]
        times.append(found[0])
        values.append(found[1])
    if len(times) < 2:
        raise InputError("there are fewer than two rows of numbers", where=Place(file=str(path)))
    for row_index, (before, after) in enumerate(pairwise(times), start=2):
        if after <= before:
            raise InputError(
                "time does not increase",
                where=Place(file=str(path), line=lines[row_index][0], key=time.column),
            )
    return tuple(moment - times[0] for moment in times), tuple(values)


def _rows(lines: list[str], separator: str) -> list[list[str]]:
    # line by line: a quote that is not closed must not swallow the rest of the file
    return [next(csv.reader([line], delimiter=separator)) for line in lines]


def _index(header: list[str], name: str, path: Path, line: int) -> int:
    if name not in header:
        raise InputError(
            f"no column '{name}'",
            where=Place(file=str(path), line=line),
            hint=suggest(name, header),
        )
    return header.index(name)


def _number(row: list[str], index: int, name: str, path: Path, line: int) -> float:
    cell = row[index] if index < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"'{cell}' is not a finite number", where=Place(file=str(path), line=line, key=name)
        )
    return value
