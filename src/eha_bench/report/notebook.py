"""What a notebook shows of an object: a sentence and a short table, in the units of the pages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np

from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, TrialResult
from eha_bench.core.score import Score, ScoreStatus
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.report.comparison_report import headline as comparison_headline
from eha_bench.report.comparison_report import verdict_of
from eha_bench.report.comparison_rows import rows_of
from eha_bench.report.diagnosis_text import effect_rows, error_rows, words_of
from eha_bench.report.diagnosis_text import headline as diagnosis_headline
from eha_bench.report.engineering import (
    decimals_for,
    display_unit,
    limit_text,
    metric_label,
    number,
    quantity,
)
from eha_bench.report.trend_site import headline as history_headline
from eha_bench.trends.history import History
from eha_bench.trends.trend import TrendState

MOST_ROWS: Final = 20

_VERDICTS: Final = (ScoreStatus.FAILED, ScoreStatus.NOT_SCORED, ScoreStatus.UNDECIDED)


def recording_html(recording: Recording) -> str:
    """Return a line a channel: its range, in the unit that suits it."""
    rows = []
    missing = False
    for name in recording:
        values = recording[name]
        known = values[np.isfinite(values)]
        ends = (float(known.min()), float(known.max())) if known.size else (math.nan, math.nan)
        unit = display_unit(recording.unit(name), ends)
        shown = [unit.from_si(end) for end in ends]
        places = decimals_for(max(map(abs, shown)))
        cells = [number(round(end, places), places) for end in shown]
        gaps = len(values) - known.size
        missing = missing or gaps > 0
        rows.append((name, *cells, unit.symbol, str(gaps) if gaps else ""))
    names = ["channel", "smallest", "largest", "unit", "samples missing"]
    if not missing:
        names, rows = names[:-1], [row[:-1] for row in rows]
    return _table(recording.summary, names, rows, after="Its arrays are in SI units.")


def result_html(result: Result) -> str:
    """Return a line a limit, those that are not kept first."""
    repeats = any(run.repeat for run in result.trials)
    judged = [(run, score) for run in result.trials for score in run.scores if score.limit]
    judged.sort(key=lambda item: _urgency(item[1]))
    names = ["trial", "metric", "value", "limit", "verdict"]
    rows = [_limit_row(run, score, repeats=repeats) for run, score in judged]
    return _table(repr(result).strip("<>"), names, rows)


def _urgency(score: Score) -> int:
    return _VERDICTS.index(score.status) if score.status in _VERDICTS else len(_VERDICTS)


def _limit_row(run: TrialResult, score: Score, *, repeats: bool) -> tuple[str, ...]:
    half = (score.measure.high - score.measure.low) / 2.0
    value = quantity(score.value, score.unit, metric=score.metric, written=score.limit, spread=half)
    verdict = score.status.value.replace("_", " ")
    if score.status is ScoreStatus.NOT_SCORED and score.reason:
        verdict += f": {score.reason}"
    trial = f"{run.id} [{run.repeat}]" if repeats else run.id
    return trial, metric_label(score.metric), value, limit_text(score.limit), verdict


def comparison_html(comparison: Comparison) -> str:
    """Return a line a metric that is not the same; all of them where every one is."""
    same = comparison.of(ComparisonVerdict.SAME)
    others = tuple(item for item in comparison.items if item not in same)
    rows = [
        (row.trial, row.metric, row.baseline, row.candidate, row.unit, row.share, row.verdict)
        for row in rows_of(others or same)
    ]
    names = ("trial", "metric", "baseline", "candidate", "unit", "change", "verdict")
    _, word = verdict_of(comparison)
    left = f"{len(same)} more are the same." if others and same else ""
    return _table(f"{word}. {comparison_headline(comparison)}", names, rows, after=left)


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """Return the verdict, the parameters of what was found, and the errors before and after."""
    _, verdict, rests_on = diagnosis_headline(diagnosis)
    found = [
        (words_of(effect.id), row.name, row.value, row.interval)
        for effect in diagnosis.effects
        for row in effect_rows(effect, diagnosis)
    ]
    effects = ""
    if found:
        effects = _table("", ("effect", "parameter", "value", "95 % interval"), found)
    errors = dict(diagnosis.holdout or diagnosis.train)
    rows = [(row.channel, row.before, row.after, row.floor) for row in error_rows(errors)]
    runs = "runs that were never fitted" if diagnosis.holdout else "the runs that were fitted"
    names = (f"RMS error on {runs}", "recalibrated", "revised", "noise floor")
    return _table(f"{verdict}. {rests_on}", (), ()) + effects + _table("", names, rows)


def history_html(history: History) -> str:
    """Return a line a metric that was judged, what drifted first."""
    states = list(TrendState)
    judged = [trend for trend in history.trends if trend.state is not TrendState.TOO_FEW]
    rows = []
    for trend in sorted(judged, key=lambda trend: states.index(trend.state)):
        newest = quantity(
            float(trend.values[-1]), trend.unit, metric=trend.metric, spread=trend.course.sigma
        )
        night = trend.since.started[:10] if trend.since is not None else ""
        state = trend.state.value
        rows.append((trend.trial, metric_label(trend.metric), newest, state, night))
    names = ("trial", "metric", "newest", "state", "since")
    return _table(history_headline(history), names, rows)


def _table(
    title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], *, after: str = ""
) -> str:
    """Return a sentence, a table and a sentence as HTML; of many rows the first, and their count.

    A column of numbers stands to the right; everything is escaped.
    """
    parts = [f"<p><b>{escape(title)}</b></p>"] if title else []
    if rows:
        head = "".join(f"<th>{escape(name)}</th>" for name in headings)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
            for row in rows[:MOST_ROWS]
        )
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    left = len(rows) - MOST_ROWS
    notes = [f"... and {left} more." if left > 0 else "", after]
    text = " ".join(note for note in notes if note)
    if text:
        parts.append(f"<p>{escape(text)}</p>")
    return "".join(parts)
