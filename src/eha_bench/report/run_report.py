"""The page of a run: verdict, what failed by how much, every limit, every trial with its plots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Final
from urllib.parse import quote

from markupsafe import Markup

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import ScoreStatus
from eha_bench.core.trial import Trial
from eha_bench.report.bode import bode_of
from eha_bench.report.bode_figure import BodeView, bode_view
from eha_bench.report.describe import describe
from eha_bench.report.figure_view import FigureView, figure_of
from eha_bench.report.limits import (
    ScoreRow,
    anchor_of,
    closest,
    limit_rows,
    score_rows,
    worst_first,
)
from eha_bench.report.page import Fact, write_page
from eha_bench.report.repeats_table import RepeatsRow, repeats_rows
from eha_bench.report.scene import scene_of
from eha_bench.report.scene_figure import POINTS
from eha_bench.report.spark import spark

REPORT_NAME: Final = "report.html"
Loader = Callable[[], Recording]

# All static curves of a page together: keeps a page of many trials light.
_POINTS_A_PAGE: Final = 100_000
_FEWEST_POINTS: Final = 300

_GRAVITY: Final = {Status.FAULT: 0, Status.INCOMPLETE: 1, Status.FAILED: 2, Status.PASSED: 3}
_VERDICTS: Final = {
    Status.PASSED: "Passed",
    Status.FAILED: "Failed",
    Status.INCOMPLETE: "Incomplete",
    Status.FAULT: "Fault",
}
_FACT_NAMES: Final = {
    "version": "eha-bench",
    "model_sha256": "Model, SHA-256",
    "controller_sha256": "Controller, SHA-256",
    "suite_sha256": "Suite, SHA-256",
}


class Group(StrEnum):
    """What a reader of a page looks for."""

    FAILED = "failed"
    AT_RISK = "risk"
    PASSED = "passed"
    UNJUDGED = "unjudged"


@dataclass(frozen=True)
class RunView:
    """One run of a trial as the page shows it."""

    trial: str
    anchor: str
    repeat: int
    status: Status
    reason: str
    notes: tuple[str, ...]
    judged: tuple[ScoreRow, ...]
    others: tuple[ScoreRow, ...]
    figure: FigureView | None
    spark: Markup
    bode: BodeView | None
    missing: str
    recording: str
    href: str
    sha256: str


@dataclass(frozen=True)
class TrialView:
    """All runs of a trial: the one to look at first, and the others.

    `group` is what the page's filter goes by; what is `open` is not folded to a line.
    """

    id: str
    anchor: str
    status: Status
    summary: tuple[str, ...]
    limits: int
    kept: int
    first: RunView
    others: tuple[RunView, ...]
    repeats: tuple[RepeatsRow, ...]
    group: Group
    open: bool
    limits_note: str


def write_report(
    folder: Path,
    result: Result,
    recordings: Mapping[tuple[str, int], Loader],
    trials: Mapping[str, Trial],
) -> Path:
    """Write `report.html` into a folder and return its path.

    Args:
        folder: where `result.json` and the recordings that it names lie; must exist.
        result: what to show.
        recordings: (trial id, repeat) -> a function that reads the recording, called once; a
            recording that is not there or cannot be read is named on the page.
        trials: by id; a trial that is not there is shown without its levels and limits.
    """
    limits = limit_rows(result, trials)
    views = _trial_views(folder, result, recordings, trials, limits)
    judged = bool(limits) or result.status is not Status.PASSED
    content = {
        "result": result,
        "verdict_word": _VERDICTS[result.status] if judged else "Not judged",
        "verdict_look": result.status.value if judged else "unjudged",
        "headline": headline(result),
        "faults": [
            view
            for trial in views
            for view in (trial.first, *trial.others)
            if view.status in (Status.FAULT, Status.INCOMPLETE) or view.reason
        ],
        "missed": worst_first(limits),
        "closest": closest(limits) if result.status is Status.PASSED else None,
        "started": moment(result.provenance.get("started", "")),
        "trials": views,
        "groups": Counter(view.group.value for view in views),
        "not_run": Counter(trial for trial, _ in result.not_run),
        "facts": facts(result),
    }
    title = f"{_VERDICTS[result.status]}: {result.suite} on {result.target}"
    return write_page(folder / REPORT_NAME, "run.html.j2", content, title=title)


def headline(result: Result) -> str:
    """Return the verdict's reason as a sentence: `2 of 14 limits missed`, and so on."""
    scores = [score for run in result.trials for score in run.scores if score.limit]
    found = Counter(score.status for score in scores)
    trials = {run.id for run in result.trials}
    rejecting = {
        run.id for run in result.trials if any(s.limit and s.status.rejects for s in run.scores)
    }
    parts = []
    faults = sum(run.status is Status.FAULT for run in result.trials)
    if faults:
        parts.append(f"{_count(faults, 'run')} stopped by a fault or a safety limit")
    unsafe = sum(run.is_unsafe for run in result.trials)
    if unsafe:
        parts.append(f"{_count(unsafe, 'run')} beyond a safety limit")
    if result.not_run:
        parts.append(f"{_count(len(result.not_run), 'run')} not made")
    unfinished = sum(run.status is Status.INCOMPLETE for run in result.trials)
    if unfinished or (result.status is Status.INCOMPLETE and not result.not_run):
        parts.append(f"{_count(unfinished, 'run')} unfinished" if unfinished else "not all was run")
    words = {
        ScoreStatus.FAILED: "missed",
        ScoreStatus.UNDECIDED: "undecided",
        ScoreStatus.NOT_SCORED: "not scored",
    }
    unmet = [(found[status], word) for status, word in words.items() if found[status]]
    if unmet:
        (count, word), *others = unmet
        also = "".join(f", {number} {other}" for number, other in others)
        parts.append(
            f"{count} of {_count(len(scores), 'limit')} {word}{also}, "
            f"in {len(rejecting)} of {_count(len(trials), 'trial')}"
        )
    elif scores:
        limited = {run.id for run in result.trials if any(score.limit for score in run.scores)}
        share = "" if limited == trials else f"{len(limited)} of "
        parts.append(
            f"{'all ' if len(scores) > 1 else ''}{_count(len(scores), 'limit')} kept "
            f"in {share}{_count(len(trials), 'trial')}"
        )
    else:
        stopped = any(run.status in (Status.FAULT, Status.INCOMPLETE) for run in result.trials)
        what = "no limit scored" if stopped else "no limits"
        parts.append(f"{what} in {_count(len(trials), 'trial')}")
    text = "; ".join(parts) + "."
    return text[0].upper() + text[1:]


def moment(text: str) -> str:
    """Return an ISO 8601 instant to the minute, with its zone; any other text as it is."""
    try:
        return datetime.fromisoformat(text).strftime("%Y-%m-%d %H:%M %Z").strip()
    except ValueError:
        return text


def facts(result: Result) -> tuple[Fact, ...]:
    """Return the provenance as the foot of the page lists it."""
    found = [Fact("Suite", result.suite), Fact("Target", result.target)]
    for key, value in result.provenance.items():
        if not value:
            continue  # a target without a model, a run without a repository
        name = _FACT_NAMES.get(key) or key.replace("_", " ").capitalize()
        found.append(Fact(name, value, code="sha256" in key or key == "revision"))
    return tuple(found)


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _trial_views(
    folder: Path,
    result: Result,
    recordings: Mapping[tuple[str, int], Loader],
    trials: Mapping[str, Trial],
    limits: tuple[ScoreRow, ...],
) -> tuple[TrialView, ...]:
    grouped: dict[str, list[TrialResult]] = {}
    for run in result.trials:
        grouped.setdefault(run.id, []).append(run)
    views = []
    for place, (trial_id, runs) in enumerate(grouped.items()):
        trial = trials.get(trial_id)
        ordered = sorted(runs, key=lambda run: (_GRAVITY[run.status], run.repeat))
        shown = [
            _run_view(
                folder,
                run,
                trial,
                recordings.get((run.id, run.repeat)),
                key=f"t{place}-r{number}",
                share=len(result.trials),
                first=number == 0,
                repeats=len(runs),
            )
            for number, run in enumerate(ordered)
        ]
        limited = [score for run in runs for score in run.scores if score.limit]
        own = [row for row in limits if row.trial == trial_id]
        group = _group(ordered[0].status, own, judged=bool(limited))
        views.append(
            TrialView(
                id=trial_id,
                anchor=anchor_of(trial_id),
                status=ordered[0].status,
                summary=describe(trial) if trial else (),
                limits=len(limited),
                kept=sum(not score.status.rejects for score in limited),
                first=shown[0],
                others=tuple(sorted(shown[1:], key=lambda view: view.repeat)),
                repeats=repeats_rows(runs[0], result.repeats),
                group=group,
                open=group in (Group.FAILED, Group.AT_RISK) or len(grouped) == 1,
                limits_note=_limits_note(group, own),
            )
        )
    return tuple(views)


def _group(worst: Status, rows: Sequence[ScoreRow], *, judged: bool) -> Group:
    if worst is not Status.PASSED:
        return Group.FAILED
    if not judged:
        return Group.UNJUDGED
    return Group.AT_RISK if any(row.at_risk for row in rows) else Group.PASSED


def _limits_note(group: Group, rows: Sequence[ScoreRow]) -> str:
    """Return the one thing to know of a trial's limits, where it is folded to a line."""
    if group is Group.FAILED:
        missed = worst_first(rows)
        return f"{missed[0].metric}: {missed[0].margin or missed[0].reason}" if missed else ""
    near = closest(rows)
    return f"closest: {near.metric}, {near.margin}" if near else ""


def _run_view(
    folder: Path,
    run: TrialResult,
    trial: Trial | None,
    load: Loader | None,
    *,
    key: str,
    share: int,
    first: bool,
    repeats: int,
) -> RunView:
    rows = score_rows(run, trial)
    figure: FigureView | None = None
    bode: BodeView | None = None
    small = Markup()
    missing, notes = "", run.notes
    try:
        if load is None:
            missing = "No plot: the recording is missing."
        else:
            recording = load()
            figure, small, missing = _figure(recording, run, trial, key, share, first)
            bode = _bode(recording, run, trial, key)
            notes = (*notes, *(note for note in recording.notes if note not in notes))
    except EhaBenchError as error:
        missing = f"No plot: {error}."
    return RunView(
        trial=run.id,
        anchor=anchor_of(run.id, run.repeat) if repeats > 1 else anchor_of(run.id),
        repeat=run.repeat,
        status=run.status,
        reason=run.reason,
        notes=notes,
        judged=tuple(row for row in rows if row.limit),
        others=tuple(row for row in rows if not row.limit),
        figure=figure,
        spark=small,
        bode=bode,
        missing=missing,
        recording=run.recording,
        href=recording_href(folder, run.recording),
        sha256=run.sha256,
    )


def recording_href(folder: Path, recording: str) -> str:
    """Return a link to a recording that lies below the report's folder; "" for any other path."""
    if not recording or Path(recording).is_absolute() or ".." in Path(recording).parts:
        return ""
    # Quoted, a name is a path and never a scheme such as `javascript:`.
    return quote(recording, safe="/") if (folder / recording).exists() else ""


def _figure(
    recording: Recording, run: TrialResult, trial: Trial | None, key: str, share: int, first: bool
) -> tuple[FigureView | None, Markup, str]:
    scene = scene_of(recording, run, trial)
    if not scene.panels:
        return None, Markup(), "No plot: the recording holds no samples."
    curves = sum(len(panel.traces) for panel in scene.panels)
    points = min(POINTS, max(_FEWEST_POINTS, _POINTS_A_PAGE // (share * curves)))
    headings = ", ".join(panel.heading for panel in scene.panels)
    title = f"{run.id}, repeat {run.repeat}: {headings}"
    static = None if first else 1
    figure = figure_of(scene, key=key, title=title, points=points, static_panels=static)
    return figure, spark(scene) if first else Markup(), ""


def _bode(recording: Recording, run: TrialResult, trial: Trial | None, key: str) -> BodeView | None:
    bode = bode_of(recording, run, trial)
    if bode is None:
        return None
    return bode_view(bode, key=f"{key}-bode", title=f"{run.id}, repeat {run.repeat}: Bode plot")
