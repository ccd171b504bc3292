"""Pages that are made when they are asked for: the start, a run that is on, two runs compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from urllib.parse import quote, urlencode

from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.side import Side, load_side
from eha_bench.core.errors import InputError
from eha_bench.core.result import Status, TrialResult
from eha_bench.report.comparison_report import comparison_page
from eha_bench.report.page import render_page
from eha_bench.report.run_report import moment
from eha_bench.report.trend_site import VERDICTS, headline
from eha_bench.report.units_page import UNITS_NAME
from eha_bench.server.inside import inside
from eha_bench.server.live_view import live_view
from eha_bench.server.runs_on import RunOn
from eha_bench.server.watch import SITE, FolderState
from eha_bench.trends.index import Night

FILES: Final = "/files/"
"""Where the folder's own files, and the site of its history, are seen."""

RUNS_A_PAGE: Final = 100

_REVISION: Final = 12
_LOOKS: Final = {
    Status.PASSED.value: ("passed", "✓"),
    Status.FAILED.value: ("failed", "✕"),
    Status.FAULT.value: ("failed", "✕"),
}
_OTHER: Final = ("undecided", "?")


@dataclass(frozen=True)
class RunRow:
    """A run as the start page shows it; hrefs are "" where there is nothing to go to."""

    when: str
    name: str
    report: str
    suite: str
    rig: str
    revision: str
    status: str
    look: str
    sign: str
    pick: str
    picked: bool


def start_page(
    folder: Path, state: FolderState, *, first: int = 0, baseline: str | None = None
) -> str:
    """Return the start page: what is on, what the history says, the runs from the `first` on.

    `baseline` is the run that was clicked to be compared with another one, None for none.
    """
    history = state.history
    nights = tuple(reversed(history.nights)) if history is not None else ()
    first = first if 0 <= first < len(nights) else 0
    shown = nights[first : first + RUNS_A_PAGE]
    content = {
        "folder": folder.resolve().name,
        "verdict": _verdict(state),
        "problems": () if history is None else history.problems,
        "runs_on": [(run.name, f"/live/{_quoted(run.name)}") for run in state.seen.runs_on],
        "site": f"{FILES}{SITE}/index.html" if history is not None else "",
        "units": f"{FILES}{SITE}/{UNITS_NAME}" if history is not None and history.kin else "",
        "rows": [_row(folder, night, baseline) for night in shown],
        "count": len(nights),
        "baseline": baseline,
        "newer": _at(max(first - RUNS_A_PAGE, 0), baseline) if first else "",
        "older": _at(first + RUNS_A_PAGE, baseline) if first + RUNS_A_PAGE < len(nights) else "",
    }
    return render_page("served.html.j2", content, title=f"{content['folder']}: results")


def live_page(run: RunOn) -> str:
    """Return the page of a run that is on.

    Raises:
        EhaBenchError: nothing of its recording can be read yet.
    """
    view = live_view(run.recording)
    content = {"name": run.name, "view": view}
    return render_page("live.html.j2", content, title=f"{view.trial} is running")


def compare_page(folder: Path, baseline: str, candidate: str) -> str:
    """Return the page of two runs compared.

    Raises:
        InputError: one of them is not a run below the folder, or they cannot be compared.
    """
    sides = [_side(folder, name) for name in (baseline, candidate)]
    return comparison_page(compare_sides(sides[0], sides[1], across_targets=True))


def message_page(what: str, hint: str = "") -> str:
    """Return a page that says one thing."""
    return render_page("message.html.j2", {"what": what, "hint": hint}, title=what)


def _verdict(state: FolderState) -> tuple[str, str, str, str]:
    """Return look, sign, word and sentence of what the history says."""
    if state.history is not None:
        return (*VERDICTS[state.history.status], headline(state.history))
    if state.problem:
        return (*_OTHER, "No history yet", f"The folder {state.problem}.")
    return (*_OTHER, "Computing", "The results are being read; this page reloads by itself.")


def _row(folder: Path, night: Night, baseline: str | None) -> RunRow:
    name = night.path.rpartition("/")[0]
    look, sign = _LOOKS.get(night.status, _OTHER)
    report = f"{name}/report.html" if name else "report.html"
    there = inside(folder, report) is not None
    gone = not (folder / night.path).is_file()
    if gone:
        pick = ""
    elif baseline is None:
        pick = _at(0, name)
    else:
        pick = "/compare?" + urlencode({"baseline": baseline, "candidate": name})
    return RunRow(
        when=moment(night.started) or night.path,
        name=name,
        report=FILES + _quoted(report) if there else "",
        suite=night.suite,
        rig=f"{night.target}, {night.host}" if night.host else night.target,
        revision=night.revision[:_REVISION],
        status=night.status,
        look=look,
        sign=sign,
        pick=pick,
        picked=baseline is not None and name == baseline,
    )


def _side(folder: Path, name: str) -> Side:
    """Return a run as one side; recordings that would lie elsewhere are left out.

    Raises:
        InputError: there is no such run.
    """
    place = inside(folder, name) if name else folder.resolve()
    result = None if place is None else inside(place, "result.json")
    if result is None:
        raise InputError(f"'{name}' is not a run of this folder")
    side = load_side(result)
    found = tuple(
        (replace(one, trials=tuple(_own(trial, at) for trial in one.trials)), at)
        for one, at in side.results
    )
    return Side(name or folder.resolve().name, found)


def _own(trial: TrialResult, folder: Path) -> TrialResult:
    if trial.recording and inside(folder, trial.recording) is None:
        return replace(trial, recording="")
    return trial


def _at(first: int, baseline: str | None) -> str:
    asked = {"from": str(first)} if first else {}
    if baseline is not None:
        asked["baseline"] = baseline
    return "/" + (f"?{urlencode(asked)}" if asked else "")


def _quoted(name: str) -> str:
    return quote(name, safe="/")
