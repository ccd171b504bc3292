"""The page of a comparison: verdict, caveats, what changed, every metric, overlaid plots."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from eha_bench.comparison.comparison import Compared, Comparison
from eha_bench.comparison.evidence import ONE_RUN
from eha_bench.comparison.side import Side, SideRun
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError
from eha_bench.recordings import read
from eha_bench.report.comparison_rows import GRAVITY, LOOKS, Row, rows_of
from eha_bench.report.engineering import limit_text, metric_name
from eha_bench.report.figure_view import FigureView, figure_of
from eha_bench.report.overlay import overlay
from eha_bench.report.page import Fact, render_page
from eha_bench.report.run_report import moment

REPORT_NAME: Final = "comparison.html"
MOST_PLOTS: Final = 12
_STATIC_POINTS: Final = 600

_WORDS: Final = {
    "regression": ("failed", "Regression"),
    "no_regression": ("passed", "No regression"),
    "nothing_compared": ("incomplete", "Nothing compared"),
}


@dataclass(frozen=True)
class ComparedTrialView:
    """A trial's metrics and its overlaid plot."""

    id: str
    anchor: str
    look: str
    sign: str
    verdict: str
    rows: tuple[Row, ...]
    figure: FigureView | None
    missing: str
    open: bool


def write_comparison(folder: Path, comparison: Comparison) -> Path:
    """Write `comparison.html` into a folder that exists; return its path."""
    path = folder / REPORT_NAME
    write_text(path, comparison_page(comparison))
    return path


def comparison_page(comparison: Comparison) -> str:
    """Return the page of a comparison, whole."""
    look, word = verdict_of(comparison)
    missed, kept = limits_turned(comparison)
    content = {
        "comparison": comparison,
        "look": look,
        "word": word,
        "headline": headline(comparison),
        "suite": " and ".join(sorted(comparison.candidate.suites)),
        "sides": [
            ("Baseline", comparison.baseline, _facts(comparison.baseline)),
            ("Candidate", comparison.candidate, _facts(comparison.candidate)),
        ],
        "missed": missed,
        "kept": kept,
        "changed": _by_trial(
            comparison.of(
                ComparisonVerdict.WORSE, ComparisonVerdict.CHANGED, ComparisonVerdict.BETTER
            )
        ),
        "undecided": _by_trial(comparison.of(ComparisonVerdict.UNDECIDED)),
        "needed": repeats_needed(comparison),
        "not_compared": _by_trial(comparison.of(ComparisonVerdict.NOT_COMPARED)),
        "trials": _trials(comparison),
    }
    title = f"{word}: {content['suite']}"
    return render_page("comparison.html.j2", content, title=title)


def verdict_of(comparison: Comparison) -> tuple[str, str]:
    """Return how the whole comparison looks, and its verdict in words.

    Limits that only the candidate misses are part of it: the metrics may be the same and the
    limits stricter.
    """
    look, word = _WORDS[comparison.status]
    missed = len(limits_turned(comparison)[0])
    if missed and comparison.status == "no_regression":
        plural = "" if missed == 1 else "s"
        return "warned", f"{word}, but {missed} limit{plural} newly missed"
    open_ones = comparison.of(ComparisonVerdict.UNDECIDED)
    if len(open_ones) == comparison.metric_count and comparison.status == "no_regression":
        return "undecided", f"{word} shown"  # nor its absence
    return look, word


def limits_turned(comparison: Comparison) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return limits that only the candidate missed, and those that only the baseline missed.

    A limit counts as missed where any repeat missed it; each is given as `trial: metric, limit`,
    with the baseline's limit where it was another one.
    """
    before, after = (_limits(side) for side in (comparison.baseline, comparison.candidate))
    both = [(key, before[key], after[key]) for key in after if key in before]
    newly = tuple(_limit_text(*item) for item in both if item[2].missed and not item[1].missed)
    again = tuple(_limit_text(*item) for item in both if item[1].missed and not item[2].missed)
    return newly, again


_Key = tuple[str, str, str]


@dataclass(frozen=True)
class _SideLimit:
    """A limit in all runs of one side: its text, and whether any run missed it."""

    text: str
    missed: bool


def _limits(side: Side) -> dict[_Key, _SideLimit]:
    """Return every limit of a side, by trial, metric and channel."""
    found: dict[_Key, _SideLimit] = {}
    for trial, runs in side.runs.items():
        for score in (score for run in runs for score in run.trial.scores if score.limit):
            key = (trial, score.metric, score.channel)
            missed = score.status.rejects or (key in found and found[key].missed)
            found[key] = _SideLimit(limit_text(score.limit), missed)
    return found


def _limit_text(key: _Key, before: _SideLimit, after: _SideLimit) -> str:
    trial, metric, _ = key
    text = f"{trial}: {metric_name(metric)}, {after.text}"
    return text if before.text == after.text else f"{text} (in the baseline {before.text})"


def repeats_needed(comparison: Comparison) -> str:
    """Return what it would take to decide what is undecided, as a sentence; "" for nothing."""
    undecided = comparison.of(ComparisonVerdict.UNDECIDED)
    if not undecided:
        return ""
    if all(item.cut_off for item in undecided):
        return "Cut off by a sensor's end: more repeats would be cut off as well."
    counts = sorted(item.more_repeats for item in undecided if item.more_repeats is not None)
    if not counts:
        alone = all(item.of_one_run for item in undecided)
        why = f"{ONE_RUN.capitalize()}. " if alone else ""
        return f"{why}Six repeats or more on each side decide most differences that matter."
    half, most = counts[len(counts) // 2], counts[-1]
    plural = "" if half == 1 else "s"
    text = f"About {half} more repeat{plural} on each side would decide half of them"
    return f"{text}, {most} all." if most > half else f"{text} or more."


def _by_trial(items: tuple[Compared, ...]) -> tuple[Row, ...]:
    """Return rows with those of a trial and of an aspect together, each with the worst first."""
    rows = rows_of(items)
    trials = list(dict.fromkeys(row.trial for row in rows))
    aspects = list(dict.fromkeys((row.trial, row.aspect) for row in rows))
    return tuple(
        sorted(
            rows,
            key=lambda row: (trials.index(row.trial), aspects.index((row.trial, row.aspect))),
        )
    )


def headline(comparison: Comparison) -> str:
    """Return what was found as a sentence: `Of 21 metrics 1 is worse, 18 are the same`."""
    found = comparison.counts()
    parts = []
    for verdict in GRAVITY:
        count = found[verdict]
        if count and verdict is not ComparisonVerdict.NOT_COMPARED:
            word = "the same" if verdict is ComparisonVerdict.SAME else verdict.value
            verb = "" if verdict is ComparisonVerdict.CHANGED else ("is " if count == 1 else "are ")
            parts.append((count, f"{verb}{word}"))
    total = comparison.metric_count
    listed = ", ".join(f"{count} {predicate}" for count, predicate in parts)
    text = f"Of {total} metric{'' if total == 1 else 's'} {listed}" if parts else ""
    if total > 1 and len(parts) == 1:
        text = f"All {total} metrics {parts[0][1]}"
    left = found[ComparisonVerdict.NOT_COMPARED]
    if left:
        also = f"{left} could not be compared"
        text = f"{text}; {also}" if text else f"{also[0].upper()}{also[1:]}"
    return f"{text or 'There is nothing to compare'}."


def _facts(side: Side) -> tuple[Fact, ...]:
    found = [
        Fact("Result", side.name),
        Fact("Target", ", ".join(sorted(side.targets))),
        Fact("Runs", str(sum(len(runs) for runs in side.runs.values()))),
    ]
    for key, name in (
        ("revision", "Revision"),
        ("started", "Started"),
        ("host", "Host"),
        ("version", "eha-bench"),
        ("suite_sha256", "Suite, SHA-256"),
        ("model_sha256", "Model, SHA-256"),
        ("controller_sha256", "Controller, SHA-256"),
    ):
        values = sorted(side.provenance(key))
        if values:
            shown = [moment(value) if key == "started" else value for value in values]
            text = shown[0] if len(shown) == 1 else f"{shown[0]} … {shown[-1]}"
            found.append(Fact(name, text, code="sha256" in key or key == "revision"))
    return tuple(found)


def _trials(comparison: Comparison) -> tuple[ComparedTrialView, ...]:
    grouped: dict[str, list[Compared]] = {}
    for item in comparison.items:
        grouped.setdefault(item.trial, []).append(item)
    by_gravity = sorted(grouped, key=lambda trial: _gravity(grouped[trial]))
    plotted = set(by_gravity[:MOST_PLOTS])
    views = []
    for place, (trial, items) in enumerate(grouped.items()):
        figure, missing = None, "Not plotted: plots are drawn of the trials that changed most."
        if trial in plotted:
            figure, missing = _figure(comparison, trial, items, f"t{place}")
        worst = GRAVITY[_gravity(items)]
        look, sign = LOOKS[worst]
        word, rows = worst.value.replace("_", " "), rows_of(tuple(items))
        unfolded = worst in (
            ComparisonVerdict.WORSE,
            ComparisonVerdict.CHANGED,
            ComparisonVerdict.BETTER,
        )
        views.append(
            ComparedTrialView(
                trial, f"trial={place}", look, sign, word, rows, figure, missing, unfolded
            )
        )
    return tuple(views)


def _gravity(items: Iterable[Compared]) -> int:
    return min(GRAVITY.index(item.verdict) for item in items)


def _figure(
    comparison: Comparison, trial: str, items: list[Compared], key: str
) -> tuple[FigureView | None, str]:
    sides = (comparison.baseline, comparison.candidate)
    first, second = (_typical(side.runs.get(trial, ()), items) for side in sides)
    if not (first and first.recording and second and second.recording):
        return None, "No plot: the recordings of one side are missing."
    try:
        scene = overlay(
            (read(first.recording), read(second.recording)),
            (first.trial, second.trial),
            ("baseline", "candidate"),
        )
    except (EhaBenchError, OSError) as error:
        return None, f"No plot: {error}."
    if scene is None:
        return None, "No plot: the two recordings have no channel in common."
    title = f"{trial}: baseline repeat {first.trial.repeat}, candidate {second.trial.repeat}"
    view = figure_of(scene, key=key, title=title, points=_STATIC_POINTS, static_panels=1)
    return view, ""


def _typical(runs: tuple[SideRun, ...], items: list[Compared]) -> SideRun | None:
    """Return the run whose value of the most notable metric is in the middle."""
    there = [run for run in runs if run.usable and run.recording is not None]
    if not there:
        return None
    notable = min(items, key=lambda item: GRAVITY.index(item.verdict))

    def value(run: SideRun) -> float:
        for score in run.trial.scores:
            if (score.metric, score.channel) == (notable.metric, notable.channel):
                return score.value
        return float("nan")

    valued = sorted((run for run in there if value(run) == value(run)), key=value)
    return valued[len(valued) // 2] if valued else there[0]
