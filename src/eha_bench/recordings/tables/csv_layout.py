"""Finds the table in a text: its delimiter, its names, and where its numbers begin."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from eha_bench.core.errors import UnitError
from eha_bench.core.units import base_unit
from eha_bench.recordings.source import IN_PAIRS

_DELIMITERS = ";\t|,"
"""Tried in this order: a comma may also be a decimal one."""
_MOST_COLUMNS = 10_000
_WINDOW = 200
_HEADERS = 4
"""Lines above the numbers that may hold names, units and descriptions."""
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_TIME = re.compile(r"\d+([-/.:])\d{1,2}\1\d")
"""How a date or a time of day begins."""
MISSING = ("-", "--")
"""What stands in a cell where nothing was measured, besides what pandas knows."""
_NOTHING = {"", "nan", "-nan", "na", "n/a", "<na>", "none", "null", "inf", "-inf", "+inf", *MISSING}
_EXCEL_ERROR = re.compile(r"#[A-Z/0]+[!?]?")


class NoTable(Exception):
    """The text holds no table; says why, and in which line (from 1)."""

    def __init__(self, what: str, line: int, hint: str) -> None:
        super().__init__(what)
        self.line = line
        self.hint = hint


@dataclass(frozen=True)
class CsvLayout:
    """How a table is written.

    Attributes:
        delimiter: one character; a blank stands for any white space.
        decimal: `.` or `,`.
        names: of the columns, as they stand there.
        first: line of the first row, from 0.
        trailing: whether rows end with a delimiter that the names do not have.
        notes: what had to be assumed.
        header: the line right above the numbers, of a table of pairs: `X,Y,X,Y`. Its columns go by
            the names in the line above it, if there are any, and each X as `name/X`.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    first: int
    trailing: bool
    notes: tuple[str, ...]
    header: tuple[str, ...] = ()

    @classmethod
    def of(cls, text: str) -> CsvLayout:
        """Find the table in a text.

        Raises:
            NoTable: there is none.
        """
        head = text.split("\n", _WINDOW)[:_WINDOW]
        rows = [(n, line) for n, line in enumerate(head) if line.strip() and not _is_comment(line)]
        delimiter, cells = _delimiter([line for _, line in rows])
        if not delimiter:
            raise NoTable(
                "this is not a table: its first line holds no delimiter (comma, semicolon, tab)",
                (rows[0][0] if rows else 0) + 1,
                "give a CSV file with a header line",
            )
        table = [(n, _split(line, delimiter)) for n, line in rows]
        start = _first_row(table, cells)
        number = table[start][0] if start < len(table) else len(head)
        above = table[start - 1] if start else (0, [])
        trailing = len(above[1]) == cells - 1 and not table[start][1][-1]
        notes: list[str] = []
        names: list[str] = []
        left = start
        if len(above[1]) == cells or trailing:
            names, left = above[1], start - 1
            units = _units_row(table[max(start - _HEADERS, 0) : start], len(names))
            if units is not None:
                place = start - units
                names, left = table[place - 1][1], place - 1
                notes.append(
                    f"line {table[place][0] + 1} was taken as units "
                    f"({', '.join(table[place][1])[:100]}); those of channels.yaml are used"
                )
        elif len(above[1]) > cells and not any(map(_is_number, above[1])):
            names, left = above[1][:cells], start - 1
            notes.append(
                f"there is nothing below the last names ({', '.join(above[1][cells:])[:100]})"
            )
        elif len(above[1]) > 1:
            raise NoTable(
                f"its lines hold {cells} cells, its header line {len(above[1])}",
                above[0] + 1,
                "give every column a name",
            )
        else:
            names = _names_in_comment(head[:number], delimiter, cells)
        header = tuple(names) if _are_pairs(names) else ()
        if header:
            above_it = table[left - 1][1] if left else []
            titles = _titles_of_pairs(above_it, len(names))
            left -= bool(titles)
            notes.append(IN_PAIRS + ", named in the line above" * bool(titles))
            names = _names_of_pairs(titles or names[1::2], names[0])
        if left:
            notes.append(
                "one line before the table was skipped"
                if left == 1
                else f"{left} lines before the table were skipped"
            )
        if not names:
            names = [str(k) for k in range(cells)]
            notes.append("it has no header line: its columns are called 0, 1, 2, ...")
        decimal = "," if delimiter != "," and re.search(r"\d,\d", text[:100_000]) else "."
        return cls(delimiter, decimal, tuple(names), number, trailing, tuple(notes), header)


def _first_row(table: list[tuple[int, list[str]]], cells: int) -> int:
    """Return which line is the first whose cells are of the kinds that the table's cells are."""
    lines = [(k, line) for k, (_, line) in enumerate(table) if len(line) == cells]
    telling = [(k, line) for k, line in lines if any(map(_is_number, line))]
    if not telling:  # no number at all: the names are all that can be distinguished from the rest
        return lines[0][0] + 1
    kinds = Counter(tuple(map(_is_number, line)) for _, line in telling)
    usual = max(kinds, key=lambda kind: (kinds[kind], sum(kind)))
    numeric = _kinds([line for _, line in telling], usual)
    found = [k for k, line in telling if _is_of_kinds(line, numeric)]
    first = found[0] if found else next(k for k, line in telling if _is_of_kinds(line, usual))
    while first and _is_time_alone(table[first - 1][1], numeric):
        first -= 1
    return first


def _kinds(lines: list[list[str]], usual: tuple[bool, ...]) -> tuple[bool, ...]:
    """Return whether each column holds numbers, by the cells in which anything stands.

    Most lines do without the number of a sensor slower than the others: what they have in common,
    `usual`, tells only where there are numbers for sure, and so what is a row and what a heading.
    """
    sure = [column for column, wanted in enumerate(usual) if wanted]
    rows = [line for line in lines if all(_is_kind(line[column], True) for column in sure)]
    found = list(usual)
    for column in set(range(len(usual))).difference(sure):
        written = [row[column] for row in rows if not _is_nothing(row[column])]
        found[column] = 0 < len(written) <= 2 * sum(map(_is_number, written))
    return tuple(found)


def _is_kind(cell: str, number: bool) -> bool:
    return _is_number(cell) is number or _is_nothing(cell)


def _is_of_kinds(line: list[str], numeric: tuple[bool, ...]) -> bool:
    return len(line) == len(numeric) and all(map(_is_kind, line, numeric))


def _is_time_alone(line: list[str], numeric: tuple[bool, ...]) -> bool:
    """Whether a line is a row in which nothing was measured: a written time, empty cells, words."""
    written = next((cell for cell in line if not _is_nothing(cell)), "")
    return _TIME.match(written) is not None and _is_of_kinds(line, numeric)


def _units_row(heads: list[tuple[int, list[str]]], cells: int) -> int | None:
    """Return how many lines above the numbers the units stand, below a line of names; or None."""
    for back in range(1, len(heads)):
        units, names = heads[-back][1], heads[-back - 1][1]
        if not len(units) == len(names) == cells:
            return None
        if _are_units(units) and not _are_units(names):
            return back
    return None


def _are_pairs(names: list[str]) -> bool:
    """Whether names are X, Y, X, Y, ..., as oscilloscopes and Maxon's EPOS Studio write them."""
    return (
        len(names) > 2
        and len(names) % 2 == 0
        and all(name.lower() == "xy"[place % 2] for place, name in enumerate(names))
    )


def _titles_of_pairs(line: list[str], cells: int) -> list[str]:
    """Return the name of each pair, from a line with one above each X; none where it has none."""
    titles, between = line[:cells:2], line[1:cells:2]
    fits = cells - 1 <= len(line) <= cells
    return titles if fits and all(titles) and not any(between) else []


def _names_of_pairs(titles: list[str], clock: str) -> list[str]:
    """Return the names of all columns of a table of pairs, each once."""
    return [name for title in unique_names(titles) for name in (f"{title}/{clock}", title)]


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names of which none stands there twice; as pandas does it."""
    found: dict[str, None] = {}
    times: Counter[str] = Counter()
    for name in names:
        unique = name
        while unique in found:
            times[name] += 1
            unique = f"{name}.{times[name]}"
        found[unique] = None
    return list(found)


def _names_in_comment(lines: list[str], delimiter: str, cells: int) -> list[str]:
    """Return the names that stand in a comment right above the numbers, as NumPy writes them."""
    comment = next((line for line in reversed(lines) if line.strip()), "")
    written = _split(comment.lstrip("#% \t"), delimiter) if _is_comment(comment) else []
    return written if len(written) == cells and not any(map(_is_number, written)) else []


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%"))


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    if '"' not in line and _width(line, delimiter) > _MOST_COLUMNS:
        # no row of a table that is read: a million cells would take ten times their text
        return line.split(delimiter, _MOST_COLUMNS + 1)[:-1]
    try:
        cells = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        cells = line.split(delimiter)
    return [cell.strip() for cell in cells]


def _width(line: str, delimiter: str) -> int:
    """Return the number of a line's cells."""
    if delimiter == " " or '"' in line:
        return len(_split(line, delimiter))
    return line.count(delimiter) + 1


def _delimiter(lines: list[str]) -> tuple[str, int]:
    """Return the delimiter that most lines have equally often, and the number of cells."""
    # the last line may have been cut
    body = lines[:-1] if len(lines) > 3 else lines
    for delimiter in (*_DELIMITERS, " "):
        counts = Counter(_width(line, delimiter) for line in body[len(body) // 4 :])
        cells, times = max(counts.items(), key=lambda item: item[1], default=(0, 0))
        if cells > 1 and times > 0.6 * counts.total():
            numbers = sum(any(map(_is_number, _split(line, delimiter))) for line in lines)
            if delimiter == " " and numbers <= 0.5 * len(lines):
                continue
            if cells > _MOST_COLUMNS:
                raise NoTable(
                    f"it has {cells} columns, more than the {_MOST_COLUMNS} that are read",
                    1,
                    "check the file, or leave columns out",
                )
            return delimiter, cells
    return "", 0


def _is_nothing(cell: str) -> bool:
    return cell.lower() in _NOTHING or _EXCEL_ERROR.fullmatch(cell) is not None


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _are_units(cells: list[str]) -> bool:
    """Whether most of the cells that are not empty are units, in brackets or not."""
    written = [cell.strip("[]() ") for cell in cells]
    return sum(map(_is_unit, written)) > 0.5 * sum(map(bool, written)) > 0


def _is_unit(text: str) -> bool:
    try:
        base_unit(text)
    except UnitError:
        return False
    return bool(text)
