"""The league's tables as Markdown, put into a page between two marks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.marked_page import write_between

MARKS = ("<!-- tables by benchmarks.league -->", "<!-- end of the tables -->")
SHOWN = 12
"""Confusions of an entrant that are shown, the most frequent first."""


def tables(results: Mapping[str, Any]) -> str:
    """Return rates of all entrants side by side, and the confusions of each."""
    entrants = results["entrants"]
    names = list(entrants)
    lines = [
        f"| {results['cases']} cases, seed {results['seed']} | {' | '.join(names)} |",
        f"|---|{'---|' * len(names)}",
    ]
    rows = next(iter(entrants.values()))["rates"]
    for row in rows:
        if rows[row]["n"]:
            cells = (_rate(entrants[name]["rates"][row]) for name in names)
            lines.append(f"| {row} | {' | '.join(cells)} |")
    for row, key in (("median", "error"), ("worst", "error")):
        cells = (_number(entrants[name][key][row]) for name in names)
        lines.append(f"| error of predictions, {row}, noise floors | {' | '.join(cells)} |")
    cells = (_number(entrants[name]["seconds"]["median"]) for name in names)
    lines.append(f"| seconds a case, median | {' | '.join(cells)} |")
    lines += ["", "| entrant | hidden effect | claimed | times |", "|---|---|---|---|"]
    for name in names:
        for item in entrants[name]["confusions"][:SHOWN]:
            lines.append(f"| {name} | {item['truth']} | {item['said']} | {item['count']} |")
    return "\n".join(lines)


def each(results: Mapping[str, Any]) -> str:
    """Return every case with what was hidden in it and what each entrant made of it."""
    entrants = results["entrants"]
    names = list(entrants)
    lines = [
        f"| case | hidden | {' | '.join(f'{name} (error, noise floors)' for name in names)} |",
        f"|---|---|{'---|' * len(names)}",
    ]
    for marks in zip(*(entrants[name]["marks"] for name in names), strict=True):
        hidden = " + ".join(marks[0]["truth"]) or "nothing"
        cells = (
            f"no answer: {mark['failure']}" if mark["failure"]
            else f"{' + '.join(mark['claimed']) or 'nothing'} ({_number(mark['error'])})"
            for mark in marks
        )  # fmt: skip
        lines.append(f"| {marks[0]['case']} | {hidden} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _rate(item: Mapping[str, float]) -> str:
    if not item["n"]:
        return "–"
    low, high = 100 * item["low"], 100 * item["high"]
    return f"{round(item['rate'] * item['n'])} of {item['n']} ({low:.0f}–{high:.0f} %)"


def _number(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.3g}"


def write_page(results: Mapping[str, Any], page: Path) -> None:
    """Put the tables into a page, between its marks.

    Raises:
        SystemExit: the page has none.
    """
    write_between(page, MARKS, tables(results))
