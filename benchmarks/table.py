"""Rows of the one table that all benchmarks end in: a figure, its target, met or missed."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Row:
    """One measured figure; `better` is "<" or ">", target NaN where there is none.

    `met` is the verdict of a benchmark that judges by more than one number.
    """

    figure: str
    value: float
    unit: str = ""
    better: str = "<"
    target: float = math.nan
    note: str = ""
    met: bool | None = None

    @property
    def verdict(self) -> str:
        if self.met is not None:
            return "met" if self.met else "missed"
        if math.isnan(self.target):
            return ""
        met = self.value <= self.target if self.better == "<" else self.value >= self.target
        return "met" if met else "missed"

    def __str__(self) -> str:
        target = "" if math.isnan(self.target) else f"{self.better}= {self.target:g} {self.unit}"
        value = f"{self.value:10.4g} {self.unit:4}"
        return f"{self.figure:58} {value} {target:14} {self.verdict:7} {self.note}".rstrip()


def write_rows(path: Path | None, rows: Iterable[Row]) -> None:
    """Write rows as JSON, if a path is given."""
    if path is not None:
        content = [_finite(asdict(row) | {"verdict": row.verdict}) for row in rows]
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def report_rows(path: Path | None, rows: Sequence[Row]) -> int:
    """Print rows, write them if a path is given; return 1 where a target was missed, else 0."""
    for row in rows:
        print(row)
    write_rows(path, rows)
    return int(any(row.verdict == "missed" for row in rows))


def _finite(entry: Mapping[str, Any]) -> dict[str, Any]:
    nan = [key for key, value in entry.items() if isinstance(value, float) and math.isnan(value)]
    return {**entry, **dict.fromkeys(nan)}


def rows_of(name: str, content: Any) -> list[Row]:
    """Return the rows that a benchmark's own JSON stands for."""
    if name in _READERS:
        return list(_READERS[name](content))
    return [_row(entry) for entry in content]


def _row(entry: Mapping[str, Any]) -> Row:
    figure = str(entry.get("name") or entry["figure"])
    if entry.get("page"):
        figure = f"{entry['page']}: {figure}"
    target, value = entry.get("target"), entry.get("value")
    return Row(
        figure,
        math.nan if value is None else float(value),
        str(entry.get("unit", "")),
        str(entry.get("better", "<")),
        math.nan if target is None else float(target),
        str(entry.get("note", "")),
        entry.get("met"),
    )


def _scoring(content: Any) -> Iterable[Row]:
    for entry in content:
        figure = f"{entry['trial']}: scored / read by rosbags"
        yield Row(figure, entry["of_reading"], "", "<", 0.5)


def _growth(content: Any) -> Iterable[Row]:
    for entry in content:
        for what in ("time", "memory"):
            exponent = entry[f"{what}_exponent"]
            yield Row(f"{entry['name']}: exponent of {what}", exponent, "", "<", 1.1)


def _coverage(content: Any) -> Iterable[Row]:
    """The worst line against each border: some intervals may hold more than 97 %, none less."""
    found = [entry for entry in content if entry["coverage"] == entry["coverage"]]
    if found:
        least = min(found, key=lambda entry: entry["coverage"] - entry["wanted"][0])
        note = f"{least['metric']}, {least['noise']}"
        yield Row(
            "coverage of 95 % intervals, least", 100 * least["coverage"], "%", ">", 93.0, note
        )
        most = [entry for entry in found if entry["wanted"][1] < 1.0]
        if most:
            top = max(most, key=lambda entry: entry["coverage"])
            note = f"{top['metric']}, {top['noise']}"
            yield Row(
                "coverage of 95 % intervals, most", 100 * top["coverage"], "%", "<", 97.0, note
            )
        refused = max(
            1.0 - entry["scored"] / entry["recordings"] - entry["may_refuse"] for entry in found
        )
        yield Row("refused beyond what may be, most", 100 * refused, "%", "<", 0.0)


def _blind(content: Any) -> Iterable[Row]:
    from benchmarks.blind import GOALS, MOST_FALSE

    for name, found in content["rates"].items():
        if found["n"] and name in GOALS:
            note = f"{found['n']} cases"
            yield Row(name, 100 * found["rate"], "%", ">", 100 * GOALS[name], note)
        elif found["n"] and name.startswith("accuses"):
            yield Row(name, 100 * found["rate"], "%", "<", 100 * MOST_FALSE, f"{found['n']} cases")
    yield Row("a case, median", content["seconds"]["median"], "s")


def _comparison(content: Any) -> Iterable[Row]:
    for entry in content:
        note = f"wanted {entry['wanted']}" if entry["wanted"] else ""
        # what was tried once is a figure, not a share of many
        value, unit = (entry["share"], "") if entry["tried"] == 1 else (100 * entry["share"], "%")
        yield Row(entry["what"], value, unit, note=note, met=entry["kept"])


_READERS = {
    "scoring": _scoring,
    "growth": _growth,
    "coverage": _coverage,
    "blind": _blind,
    "comparison": _comparison,
}
