"""A result as the console tells it: what was not kept and by how much, then a line a trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from eha_bench.cli.terminal import Paint, columns, more, paint
from eha_bench.core.note import Note, in_one
from eha_bench.core.result import Result, Status
from eha_bench.core.score import ScoreStatus
from eha_bench.core.trial import Trial
from eha_bench.report.limits import ScoreRow, limit_rows, worst_first

SHOWN: Final = 5
"""Lines of a kind before the rest is only counted."""

_TRIALS: Final = 20
_COLOURS: Final = {
    Status.PASSED: Paint.GOOD,
    Status.FAILED: Paint.BAD,
    Status.FAULT: Paint.BAD,
    Status.INCOMPLETE: Paint.WARN,
}
_SCORE_COLOURS: Final = {
    ScoreStatus.FAILED: Paint.BAD,
    ScoreStatus.UNDECIDED: Paint.UNSURE,
    ScoreStatus.NOT_SCORED: Paint.WARN,
}
_GRAVITY: Final = (Status.FAULT, Status.INCOMPLETE, Status.FAILED, Status.PASSED)


def summary_lines(
    result: Result,
    trials: Mapping[str, Trial] | None = None,
    *,
    verbose: bool = False,
    colour: bool = False,
) -> list[str]:
    """Return the lines that stand on the console when a run has ended.

    Args:
        result: of a run, or of recordings scored.
        trials: by id, as far as they are known.
        verbose: whether everything is listed, and not the first of each kind.
        colour: whether the terminal shows colour.
    """
    rows = limit_rows(result, trials or {})
    rejected = worst_first(rows)
    scored = [row for row in rejected if row.status is not ScoreStatus.NOT_SCORED]
    unscored = [row for row in rejected if row.status is ScoreStatus.NOT_SCORED]
    lines = [*_limits(scored, colour=colour), *_unscored_lines(unscored, colour=colour)]
    parts = [
        _stops(result, verbose=verbose, colour=colour),
        _first(lines, verbose=verbose),
        _notes(result, verbose=verbose),
        _trials(result, verbose=verbose, colour=colour),
        [_verdict(result, colour=colour)],
    ]
    apart: list[str] = []
    for part in filter(None, parts):
        apart += ["", *part] if apart and len(part) > 1 else part
    # what keeps a number with its unit on a page only keeps people from searching a log for it
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in apart]


def _stops(result: Result, *, verbose: bool, colour: bool) -> list[str]:
    """What stopped a run, a line for all repeats of a trial that give the same reason."""
    repeats: dict[str, int] = {}
    together: dict[tuple[str, Status, str], list[int]] = {}
    for run in result.trials:
        repeats[run.id] = repeats.get(run.id, 0) + 1
        if run.reason:
            together.setdefault((run.id, run.status, run.reason), []).append(run.repeat)
    lines = []
    for (trial, status, reason), which in together.items():
        name = trial
        if repeats[trial] > 1 or which != [0]:
            name += f", repeat{'s' * (len(which) > 1)} {', '.join(map(str, which))}"
        lines.append(f"{paint(name, _COLOURS[status], on=colour)}: {reason}")
    return _first(lines, verbose=verbose)


def _notes(result: Result, *, verbose: bool) -> list[str]:
    """What recordings are to be known for, a line a note with the trials of which it holds."""
    trials: dict[str, dict[str, None]] = {}
    for run in result.trials:
        for note in run.notes:
            trials.setdefault(note, {})[run.id] = None
    lines = [f"note: {', '.join(names)}: {note}" for note, names in trials.items()]
    return _first(lines, verbose=verbose)


def _limits(rejected: Sequence[ScoreRow], *, colour: bool) -> list[str]:
    """A line a limit that was not kept: `overshoot failed  42.9 %  (≤ 40 %, 2.9 points over)`."""
    cells = columns([_limit_cells(row) for row in rejected], right=(2,))
    lines = []
    for row, (trial, metric, value, rest) in zip(rejected, cells, strict=True):
        painted = paint(metric, _SCORE_COLOURS[row.status], on=colour)
        lines.append(f"{trial}  {painted}  {value}  {rest}".rstrip())
    return lines


def _unscored_lines(rows: Sequence[ScoreRow], *, colour: bool) -> list[str]:
    """A line a trial and reason, with all metrics that have no value for it.

    Reasons that differ in their numbers alone are one; each number is then a range.
    """
    together: dict[tuple[str, object], list[ScoreRow]] = {}
    for row in rows:
        kind = row.reason.kind if isinstance(row.reason, Note) else row.reason
        together.setdefault((row.trial, kind), []).append(row)
    lines = []
    for (trial, _), alike in together.items():
        names = ", ".join(dict.fromkeys(row.metric_id for row in alike))
        words = paint(f"{names} not scored", _SCORE_COLOURS[ScoreStatus.NOT_SCORED], on=colour)
        alone = f" ({alike[0].limit})" if len(alike) == 1 else ""
        notes = [row.reason for row in alike if isinstance(row.reason, Note)]
        reason = in_one(notes) if notes else alike[0].reason
        lines.append(f"{trial}  {words}: {reason}{alone}")
    return lines


def _limit_cells(row: ScoreRow) -> tuple[str, str, str, str]:
    word = row.status.value.replace("_", " ")
    value = f"{row.value} {row.unit}".strip() if row.unit or row.margin else ""
    pieces = [row.limit, row.margin, row.stands_for]
    rest = f"({', '.join(part for part in pieces if part)})"
    if row.reason:
        rest = f"{row.reason} {rest}"
    return row.trial, f"{row.metric_id} {word}", value, rest


def _trials(result: Result, *, verbose: bool, colour: bool) -> list[str]:
    """A table of trials, the worst first where not all of them fit; none of a single trial."""
    status: dict[str, Status] = {}
    kept: dict[str, list[bool]] = {}
    for run in result.trials:
        found = status.get(run.id, run.status)
        status[run.id] = min(found, run.status, key=_GRAVITY.index)
        kept.setdefault(run.id, []).extend(
            not score.status.rejects for score in run.scores if score.limit
        )
    not_run: dict[str, int] = {}
    for trial, _ in result.not_run:
        not_run[trial] = not_run.get(trial, 0) + 1
    names = list(dict.fromkeys((*status, *not_run)))
    if len(names) < 2:
        return []
    shown = names
    if not verbose and len(names) > _TRIALS:
        worst = sorted(names, key=lambda name: _GRAVITY.index(status.get(name, Status.INCOMPLETE)))
        shown = [name for name in names if name in set(worst[:_TRIALS])]
    rows = [("trial", "verdict", "limits kept", "")]
    for name in shown:
        marks = kept.get(name, [])
        missing = f"{not_run[name]} not run" if name in not_run and name in status else ""
        rows.append(
            (
                name,
                _word(name, status, kept),
                f"{sum(marks)} of {len(marks)}" if marks else "none",
                missing,
            )
        )
    lines = []
    for number, (name, verdict, limits, missing) in enumerate(columns(rows)):
        tone = _tone(shown[number - 1], status, kept) if number else Paint.QUIET
        lines.append(f"{name}  {paint(verdict, tone, on=colour)}  {limits}  {missing}".rstrip())
    if len(shown) < len(names):
        lines.append(more(len(names) - len(shown)))
    return lines


def _word(trial: str, status: Mapping[str, Status], kept: Mapping[str, list[bool]]) -> str:
    """Return a trial's verdict; a run that ended well without limits passed none."""
    if trial not in status:
        return "not run"
    return status[trial].word(judged=bool(kept[trial]))


def _tone(trial: str, status: Mapping[str, Status], kept: Mapping[str, list[bool]]) -> Paint:
    """Green is a trial that kept its limits, not one that has none."""
    found = status.get(trial, Status.INCOMPLETE)
    return Paint.QUIET if found is Status.PASSED and not kept[trial] else _COLOURS[found]


def _verdict(result: Result, *, colour: bool) -> str:
    limits = [score for run in result.trials for score in run.scores if score.limit]
    kept = sum(not score.status.rejects for score in limits)
    word, tone = result.status.word(judged=bool(limits)), _COLOURS[result.status]
    text = f"{kept} of {len(limits)} limits kept"
    if not limits:
        stopped = result.status is not Status.PASSED
        text = "no limits were scored" if stopped else "no limits to keep"
        tone = tone if stopped else Paint.WARN
    if result.not_run:
        text += f", {len(result.not_run)} run{'s' * (len(result.not_run) > 1)} not made"
    return f"{result.suite}: {paint(word, tone, on=colour)}, {text}"


def _first(lines: list[str], *, verbose: bool) -> list[str]:
    if verbose or len(lines) <= SHOWN:
        return lines
    return [*lines[:SHOWN], more(len(lines) - SHOWN)]
