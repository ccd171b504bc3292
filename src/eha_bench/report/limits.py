"""Rows of the tables of limits: value, limit and how far apart they are, in display units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final
from urllib.parse import quote

from eha_bench.core.budget import Budget
from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats
from eha_bench.core.result import Result, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.trial import Trial
from eha_bench.report.engineering import (
    COUNTS,
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    limit_text,
    metric_name,
    number,
)

_WORST_FIRST: Final = (
    ScoreStatus.FAILED,
    ScoreStatus.UNDECIDED,
    ScoreStatus.NOT_SCORED,
    ScoreStatus.WARNED,
    ScoreStatus.PASSED,
)


_HARDLY: Final = 0.05
_HARDLY_OF_BAND: Final = 0.1
"""Shares of a limit, and of half the width of a band: with less left, the next run may miss it."""

_OR: Final = {"above": "or more", "below": "or less", "both": "or anything else"}
"""What follows a value that a sensor's end cut off."""

_NEGLIGIBLE: Final = 0.01
"""Share of the whole uncertainty below which a contribution is not worth a word."""


@dataclass(frozen=True)
class Gauge:
    """Where a value lies between its limits, in per cent of the gauge's width."""

    low: float
    high: float
    value: float


@dataclass(frozen=True)
class ScoreRow:
    """A score as a table shows it; all text is for people.

    Attributes:
        trial, repeat: whose it is; `anchor` links to its section.
        stands_for: which of a trial's repeats it stands for, "" for itself: 'worst of 4 repeats'.
        value, unit, interval: measured value, its unit, half-width or bounds of its interval.
        limit, margin: as written, and how much is left or missing (with its share of the limit).
        reason: why there is no value or verdict; `convention`: how the value was measured.
        budget: standard uncertainties that its interval is made of, the largest first.
        severity: relative excess over the limit, for ordering; infinite where there is no value.
        at_risk: whether it is kept and hardly: less than a twentieth of the limit is left (of a
            band, a tenth of half its width), its interval reaches beyond, or the suite warns.
        own: whether its channel is the one that the trial is about, which need not be repeated.
    """

    trial: str
    repeat: int
    stands_for: str
    anchor: str
    metric: str
    metric_id: str
    channel: str
    value: str
    unit: str
    interval: str
    limit: str
    margin: str
    gauge: Gauge | None
    status: ScoreStatus
    reason: str
    convention: str
    budget: str
    severity: float
    at_risk: bool = False
    own: bool = False


def anchor_of(trial: str, repeat: int | None = None) -> str:
    """Return the fragment that opens a trial (and one of its repeats), without the `#`."""
    fragment = f"trial={quote(trial, safe='')}"
    return fragment if repeat is None else f"{fragment}&repeat={repeat}"


def score_rows(run: TrialResult, trial: Trial | None) -> tuple[ScoreRow, ...]:
    """Return a run's scores in their order; bounds come from the trial, if it is known."""
    return tuple(_row(run, trial, score) for score in run.scores)


def limit_rows(result: Result, trials: Mapping[str, Trial]) -> tuple[ScoreRow, ...]:
    """Return every limit once, in the order of the result.

    The worst repeat stands for all, or the median over them where the limit is on that.
    """
    grouped: dict[tuple[str, str, str, str], list[tuple[TrialResult, Score, ScoreRow]]] = {}
    for run in result.trials:
        trial = trials.get(run.id)
        for score in run.scores:
            if score.limit:
                key = (run.id, score.metric, score.channel, score.limit)
                grouped.setdefault(key, []).append((run, score, _row(run, trial, score)))
    return tuple(_standing_for(held, result, trials) for held in grouped.values())


def _standing_for(
    held: list[tuple[TrialResult, Score, ScoreRow]], result: Result, trials: Mapping[str, Trial]
) -> ScoreRow:
    run, score, row = min(held, key=lambda item: _badness(item[2]))
    if len(held) == 1:
        return row
    limit = limit_of(score, trials.get(run.id))
    if limit is not None and limit.repeats is Repeats.MEDIAN:
        of = (run.id, score.metric, score.channel)
        for summary in result.repeats:
            if (summary.trial, summary.metric, summary.channel) == of:
                median = replace(score, measure=summary.median)
                row = _row(run, trials.get(run.id), median)
                return replace(row, stands_for=f"median of {len(held)} repeats")
    return replace(row, stands_for=f"worst of {len(held)} repeats")


def worst_first(rows: Iterable[ScoreRow]) -> tuple[ScoreRow, ...]:
    """Return the rows that a gate rejects: by verdict, then by relative excess."""
    return tuple(sorted((row for row in rows if row.status.rejects), key=_badness))


def closest(rows: Iterable[ScoreRow]) -> ScoreRow | None:
    """Return the kept limit with the least left of it, relative to the limit."""
    kept = [row for row in rows if not row.status.rejects and row.margin]
    return max(kept, key=lambda row: row.severity, default=None)


def _badness(row: ScoreRow) -> tuple[int, float]:
    return _WORST_FIRST.index(row.status), -row.severity


def limit_of(score: Score, trial: Trial | None) -> AcceptanceLimit | None:
    """Return the limit that a score is judged by, or None where the trial does not say."""
    if trial is None or not score.limit:
        return None
    for limit in trial.limits:
        same = (limit.metric, limit.channel, limit.text)
        if same == (score.metric, score.channel, score.limit):
            return limit
    return None


def bounds_of(score: Score, trial: Trial | None) -> Bounds | None:
    """Return the bounds (SI) behind a score's limit, or None where nothing tells them."""
    limit = limit_of(score, trial)
    return Bounds.read(score.limit_in_si) if limit is None else limit.bounds


def _row(run: TrialResult, trial: Trial | None, score: Score) -> ScoreRow:
    measure = score.measure
    bounds = bounds_of(score, trial)
    near = [score.value, *((bounds.low, bounds.high) if bounds else ())]
    unit = display_unit(score.unit, near, metric=score.metric, written=score.limit)
    half_width = (measure.high - measure.low) / 2.0
    shown = unit.from_si(score.value)
    counted = score.metric in COUNTS
    decimals = 0 if counted else decimals_for(shown, unit.difference(half_width))
    decided = math.isfinite(score.value) and score.status is not ScoreStatus.UNDECIDED
    margin, severity = _margin(score.value, bounds, unit, decimals)
    if measure.open and score.status is ScoreStatus.UNDECIDED:
        margin = ""  # nobody knows what is left
    return ScoreRow(
        trial=run.id,
        repeat=run.repeat,
        stands_for="",
        anchor=anchor_of(run.id, run.repeat or None),
        metric=metric_name(score.metric),
        metric_id=score.metric,
        channel=channel_name(score.channel),
        value=number(shown, decimals),
        unit=unit.symbol if math.isfinite(shown) else "",
        interval=_interval(measure, unit, decimals),
        limit=limit_text(score.limit),
        margin=margin,
        gauge=_gauge(score.value, bounds),
        status=score.status,
        reason="" if decided else score.reason,
        convention=score.reason if decided else "",
        budget=_budget(measure.budget, unit) if decided else "",
        severity=severity,
        at_risk=_at_risk(score, bounds),
        own=trial is not None and score.channel == trial.channel,
    )


def _at_risk(score: Score, bounds: Bounds | None) -> bool:
    if score.status is ScoreStatus.WARNED:
        return True
    if score.status is not ScoreStatus.PASSED or bounds is None or score.metric in COUNTS:
        return False
    measure = score.measure
    left = min(measure.value - bounds.low, bounds.high - measure.value)
    half = (bounds.high - bounds.low) / 2.0
    if math.isfinite(half):
        hardly = left < _HARDLY_OF_BAND * half
    else:
        end = bounds.low if math.isfinite(bounds.low) else bounds.high
        hardly = left < _HARDLY * abs(end)
    return hardly or measure.low < bounds.low or measure.high > bounds.high


def _budget(budget: Budget, unit: DisplayUnit) -> str:
    """Return `noise 0.31 ms (A), resolution 0.05 ms (B)`, standard uncertainties."""
    parts = []
    for part in budget.merged().parts:
        size = unit.difference(part.standard)
        if math.isfinite(size) and part.standard >= _NEGLIGIBLE * budget.standard:
            symbol = "points" if unit.symbol == "%" else unit.symbol
            shown = f"{number(size, decimals_for(size, size))}\N{NO-BREAK SPACE}{symbol}".rstrip()
            parts.append(f"{part.source} {shown} ({part.evaluation})")
    return ", ".join(parts)


def _interval(measure: Measure, unit: DisplayUnit, decimals: int) -> str:
    value, low, high = measure.value, measure.low, measure.high
    if measure.open:
        return _OR[measure.open]
    if not (math.isfinite(low) and math.isfinite(high) and math.isfinite(value)):
        return ""
    below, above = unit.difference(value - low), unit.difference(high - value)
    if max(below, above) < 0.5 * 10.0**-decimals:
        return ""
    if abs(below - above) <= 0.05 * abs(below + above):
        return f"± {number((below + above) / 2.0, decimals)}"
    return f"{number(unit.from_si(low), decimals)} … {number(unit.from_si(high), decimals)}"


def _margin(
    value: float, bounds: Bounds | None, unit: DisplayUnit, decimals: int
) -> tuple[str, float]:
    if bounds is None or not math.isfinite(value):
        return "", math.inf if not math.isfinite(value) else 0.0
    left_low, left_high = value - bounds.low, bounds.high - value
    left = min(left_low, left_high)
    if math.isinf(left):
        return "", 0.0
    limit = bounds.low if left_low < left_high else bounds.high
    share = abs(left) / abs(limit) if limit else math.inf
    text = number(abs(unit.difference(left)), decimals)
    if unit.symbol:
        # a difference of two percentages is given in points, a share of the limit in per cent
        text += f"\N{NO-BREAK SPACE}{'points' if unit.symbol == '%' else unit.symbol}"
    word = "left" if left >= 0.0 else ("short" if limit == bounds.low else "over")
    # Of a limit in per cent, a share in per cent would only confuse.
    if math.isfinite(share) and unit.symbol != "%":
        text += f" ({number(100.0 * share, 1 if share < 0.1 else 0)}\N{NO-BREAK SPACE}%)"
    excess = -left / abs(limit) if limit else -left * math.inf if left else 0.0
    return f"{text} {word}", excess


def _gauge(value: float, bounds: Bounds | None) -> Gauge | None:
    if bounds is None or not math.isfinite(value):
        return None
    finite = [side for side in (bounds.low, bounds.high) if math.isfinite(side)]
    if not finite:
        return None
    if len(finite) == 1:
        finite.append(0.0)
    least, most = min(*finite, value), max(*finite, value)
    pad = 0.12 * (most - least) or 1.0
    least, most = least - pad, most + pad

    def place(at: float) -> float:
        return round(100.0 * min(1.0, max(0.0, (at - least) / (most - least))), 1)

    return Gauge(place(bounds.low), place(bounds.high), place(value))
