"""Rows of a comparison's tables: both sides, their difference and what it means, for people."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from eha_bench.comparison.comparison import Compared, Values
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.metric import Better
from eha_bench.report.aspects import aspect_of
from eha_bench.report.engineering import (
    COUNTS,
    PERCENT,
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    metric_name,
    number,
)

GRAVITY: Final = (
    ComparisonVerdict.WORSE,
    ComparisonVerdict.CHANGED,
    ComparisonVerdict.NOT_COMPARED,
    ComparisonVerdict.UNDECIDED,
    ComparisonVerdict.BETTER,
    ComparisonVerdict.SAME,
)

# The page's styles know the verdicts of limits; these are shown in the same colours.
LOOKS: Final = {
    ComparisonVerdict.WORSE: ("failed", "✕"),
    ComparisonVerdict.BETTER: ("passed", "✓"),
    ComparisonVerdict.CHANGED: ("warned", "≠"),
    ComparisonVerdict.SAME: ("same", "="),
    ComparisonVerdict.UNDECIDED: ("undecided", "?"),
    ComparisonVerdict.NOT_COMPARED: ("not_scored", "–"),
}


@dataclass(frozen=True)
class Whisker:
    """The difference's interval about 0, in per cent of the drawing's width."""

    low: float
    high: float
    value: float
    same_low: float
    same_high: float


@dataclass(frozen=True)
class Row:
    """A compared metric as a table shows it; all text is for people."""

    trial: str
    aspect: str
    metric: str
    channel: str
    baseline: str
    candidate: str
    unit: str
    difference: str
    share: str
    interval: str
    matters: str
    verdict: str
    look: str
    sign: str
    note: str
    method: str
    whisker: Whisker | None


def rows_of(items: tuple[Compared, ...]) -> tuple[Row, ...]:
    """Return the rows, the worst verdicts first and within them the largest differences."""
    ordered = sorted(items, key=lambda item: (GRAVITY.index(item.verdict), -_size(item)))
    return tuple(row_of(item) for item in ordered)


def _size(item: Compared) -> float:
    ratio = abs(item.difference) / item.margin if item.margin > 0.0 else 0.0
    return ratio if math.isfinite(ratio) else 0.0


def row_of(item: Compared) -> Row:
    """Return one row."""
    look, sign = LOOKS[item.verdict]
    known = [value for side in (item.baseline, item.candidate) for value in side.values]
    unit = display_unit(item.unit, known, metric=item.metric)
    half = (item.high - item.low) / 2.0
    places = decimals_for(unit.from_si(item.baseline.mean), unit.difference(half))
    if item.metric in COUNTS and all(value == round(value) for value in known):
        places = 0
    return Row(
        trial=item.trial,
        aspect=aspect_of(item.metric, item.unit),
        metric=metric_name(item.metric) if item.metric else "all",
        channel=channel_name(item.channel) if item.channel else "",
        baseline=_side(item.baseline, unit, places),
        candidate=_side(item.candidate, unit, places),
        unit=unit.symbol if known else "",
        difference=_difference(item.difference, unit, places),
        share=_share(item, unit),
        interval=_interval(item, unit, places),
        matters=_matters(item, unit),
        verdict=item.verdict.value.replace("_", " "),
        look=look,
        sign=sign,
        note=note_of(item),
        method=item.method,
        whisker=_whisker(item),
    )


def note_of(item: Compared) -> str:
    """Return a row's note: why it was not compared, or how many more repeats it takes."""
    parts = [item.reason] if item.reason else []
    if item.verdict is ComparisonVerdict.UNDECIDED:
        if item.cut_off:
            parts.append("more repeats would be cut off as well")
        elif item.baseline.runs == item.candidate.runs == 1:
            parts.append("with six repeats on each side most differences are decided")
        elif item.more_repeats is None:
            parts.append("how many more repeats would decide is not known")
        else:
            word = "repeat" if item.more_repeats == 1 else "repeats"
            parts.append(f"about {item.more_repeats} more {word} on each side would decide")
    if item.verdict is ComparisonVerdict.CHANGED:
        parts.append("the metric declares no better direction")
    named = item.better not in ("", Better.LOWER, Better.HIGHER)
    if named and item.verdict is not ComparisonVerdict.NOT_COMPARED:
        parts.append(f"{item.better} is better: the distances to it are compared")
    return ". ".join(part[:1].upper() + part[1:] for part in parts)


def _side(side: Values, unit: DisplayUnit, places: int) -> str:
    return number(unit.from_si(side.mean), places) if side.values else number(math.nan)


def _difference(value: float, unit: DisplayUnit, places: int) -> str:
    if not math.isfinite(value):
        return number(math.nan)
    points = "\N{NO-BREAK SPACE}points" if unit.symbol == "%" else ""
    return _signed(unit.difference(value), places) + points


def _signed(value: float, places: int) -> str:
    """Write a difference; what is below the last digit is 0, not a power of ten."""
    return number(round(value, places), places, sign=True)


def _share(item: Compared, unit: DisplayUnit) -> str:
    share = 100.0 * item.share
    if not math.isfinite(share) or unit == PERCENT or abs(share) > 1e3:
        return ""
    return _signed(share, 1 if abs(share) < 100.0 else 0) + "\N{NO-BREAK SPACE}%"


def _interval(item: Compared, unit: DisplayUnit, places: int) -> str:
    if not math.isfinite(item.low + item.high):
        return ""
    low, high = (_signed(unit.difference(value), places) for value in (item.low, item.high))
    return f"{low} … {high}"


def _matters(item: Compared, unit: DisplayUnit) -> str:
    if not math.isfinite(item.margin):
        return ""
    shown = unit.difference(item.margin)
    text = number(shown, decimals_for(shown, 0.05 * shown) if shown else 0)
    symbol = "points" if unit.symbol == "%" else unit.symbol
    suffix = f"\N{NO-BREAK SPACE}{symbol}" if symbol else ""
    return f"± {text}{suffix}"


def _whisker(item: Compared) -> Whisker | None:
    if not math.isfinite(item.low + item.high + item.margin):
        return None
    ends = (item.low, item.high, -item.margin, item.margin, 0.0)
    reach = 1.08 * max(abs(end) for end in ends) or 1.0

    def place(at: float) -> float:
        return round(50.0 + 50.0 * at / reach, 1)

    return Whisker(
        place(item.low), place(item.high), place(item.difference),
        place(-item.margin), place(item.margin),
    )  # fmt: skip
