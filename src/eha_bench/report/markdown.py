"""A run in Markdown, short enough for a pull request and for GitHub's step summary."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from eha_bench.core.errors import InputError, Place
from eha_bench.core.result import Result, Status
from eha_bench.core.trial import Trial
from eha_bench.report.limits import ScoreRow, limit_rows, worst_first
from eha_bench.report.run_report import headline

STEP_SUMMARY_BYTES: Final = 1024 * 1024
"""What GitHub takes of all summaries of a step together."""
_MOST_ROWS: Final = 200
_LONGEST_TEXT: Final = 300

_SIGNS: Final = {
    Status.PASSED: "✅",
    Status.FAILED: "❌",
    Status.INCOMPLETE: "⚠️",
    Status.FAULT: "⛔",
}
_UNJUDGED: Final = "➖"
_SPECIAL: Final = re.compile(r"[\\`*_{}\[\]<#|~&$@]|:(?=//|[\w+-]+:)|^[-+>]")
"""What Markdown reads in a line: marks, links, codes of emoji, and beginnings of lists, quotes."""


def markdown_summary(result: Result, trials: Mapping[str, Trial] | None = None) -> str:
    """Return the verdict, the limits that were not kept (worst first) and a line a trial.

    Args:
        result: what to tell.
        trials: by id; where they are there, the table says by how much a limit was missed.
    """
    rows = limit_rows(result, trials or {})
    parts = [
        f"## {_verdict(result.status, judged=bool(rows), of=_heading(result))}",
        as_text(headline(result)),
    ]
    facts = _of_the_run(result.provenance)
    if facts:
        parts.append(as_text(facts))
    stopped = [run for run in result.trials if run.reason]
    if stopped:
        parts.append(
            "\n".join(
                f"- {as_text(run.id)} ({run.status.value}): {as_text(run.reason)}"
                for run in stopped[:_MOST_ROWS]
            )
        )
    missed = worst_first(rows)
    if missed:
        parts.append(table(("Not kept", "Metric", "Measured", "Limit", "Margin"), _rows(missed)))
    kept: dict[str, list[bool]] = {}
    for run in result.trials:
        kept.setdefault(run.id, []).extend(
            not score.status.rejects for score in run.scores if score.limit
        )
    worst: dict[str, Status] = {}
    gravity = list(_SIGNS)
    for run in result.trials:
        worst[run.id] = max(worst.get(run.id, run.status), run.status, key=gravity.index)
    parts.append(
        table(
            ("Trial", "Verdict", "Limits kept"),
            (
                (
                    as_text(trial),
                    _verdict(status, judged=bool(kept[trial])),
                    f"{sum(kept[trial])} of {len(kept[trial])}" if kept[trial] else "",
                )
                for trial, status in worst.items()
            ),
        )
    )
    return "\n\n".join(parts) + "\n"


def _heading(result: Result) -> str:
    return f"{as_text(result.suite)} on {as_text(result.target)}: "


def _verdict(status: Status, *, judged: bool, of: str = "") -> str:
    """Return a verdict with its sign, after what it is of."""
    sign = _SIGNS[status] if judged or status is not Status.PASSED else _UNJUDGED
    return f"{sign} {of}{status.word(judged=judged)}"


def _of_the_run(provenance: Mapping[str, str]) -> str:
    """Return when a run was, what was run again and what stopped it, as far as that is known."""
    started, finished = provenance.get("started", ""), provenance.get("finished", "")
    when = f"started {started}" + (f", finished {finished}" if finished else "")
    retries, stopped_by = provenance.get("retries", ""), provenance.get("stopped_by", "")
    parts = [
        when if started else "",
        f"on {provenance['host']}" if provenance.get("host") else "",
        f"{retries} run again for their infrastructure" if retries else "",
        f"stopped by: {stopped_by}" if stopped_by else "",
    ]
    return "; ".join(part for part in parts if part)


def append_step_summary(text: str, environment: Mapping[str, str] | None = None) -> bool:
    """Append Markdown to the file that `GITHUB_STEP_SUMMARY` names; return whether it is named.

    Stays below the 1 MiB that GitHub takes, cutting at the end of a line.

    Raises:
        InputError: the file cannot be written.
    """
    named = (os.environ if environment is None else environment).get("GITHUB_STEP_SUMMARY", "")
    if not named:
        return False
    path = Path(named)
    try:
        used = path.stat().st_size if path.exists() else 0
        with path.open("a", encoding="utf-8") as file:
            file.write(_fitting(text, STEP_SUMMARY_BYTES - 1 - used))
    except OSError as error:
        raise InputError(
            f"cannot append the step summary ({error.strerror})",
            where=Place(file=named),
            hint="let GITHUB_STEP_SUMMARY name a file that can be written, or unset it",
        ) from error
    return True


def _fitting(text: str, room: int) -> str:
    if len(text.encode()) <= room:
        return text
    note = "\n… shortened: see the report.\n"
    head = text.encode()[: max(0, room - len(note.encode()))].decode(errors="ignore")
    cut = head.rpartition("\n")[0]
    return cut + note if room > len(note.encode()) else ""


def _rows(missed: Iterable[ScoreRow]) -> Iterable[tuple[str, ...]]:
    for row in missed:
        stands_for = f" ({row.stands_for})" if row.stands_for else ""
        value = " ".join(part for part in (row.value, row.unit, row.interval) if part)
        margin = row.margin or row.status.value.replace("_", " ")
        yield (
            as_text(row.trial) + stands_for,
            as_text(f"{row.metric}, {row.channel}"),
            value if not row.reason else f"{value} ({as_text(row.reason)})",
            as_text(row.limit),
            margin,
        )


def table(heading: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table whose cells are Markdown; of very many rows the first."""
    listed = list(rows)
    lines = [f"| {' | '.join(heading)} |", f"|{'---|' * len(heading)}"]
    lines += [f"| {' | '.join(cells)} |" for cells in listed[:_MOST_ROWS]]
    if len(listed) > _MOST_ROWS:
        lines.append(f"\n… and {len(listed) - _MOST_ROWS} more: see the report.")
    return "\n".join(lines)


def as_text(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    line = " ".join(text.split())
    if len(line) > _LONGEST_TEXT:
        line = line[: _LONGEST_TEXT - 1] + "…"
    return _SPECIAL.sub(r"\\\g<0>", line)
