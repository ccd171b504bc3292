"""The Python face of comparing: the same as the commands, with their reports."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from eha_bench.api import Given, target_for, tell_step_summary, write_reports
from eha_bench.bench.interleaved import (
    COMPARISON,
    COMPARISON_FILES,
    COMPARISON_SUMMARY,
    Interleaved,
    InterleavedPlan,
    run_interleaved,
)
from eha_bench.bench.run import run_suite
from eha_bench.bench.store import SuiteFolder
from eha_bench.causes.follow import Progress as StageProgress
from eha_bench.causes.follow import causes_behind
from eha_bench.causes.follow import silent as no_stages
from eha_bench.causes.settings import load_cause_settings
from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.sequential import shares
from eha_bench.comparison.side import Side, load_side
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.interruption import signals_raised_after
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.progress import Progress, silent
from eha_bench.core.result import Result, Status
from eha_bench.core.workers import workers_from
from eha_bench.report.comparison_markdown import comparison_markdown
from eha_bench.report.comparison_report import write_comparison
from eha_bench.report.history_markdown import history_markdown
from eha_bench.report.trend_site import write_site
from eha_bench.suites import Suite, load_suite
from eha_bench.trends.history import History, history_of
from eha_bench.trends.index import update

_HISTORY, _HISTORY_SUMMARY, _INDEX = "history.json", "history.md", "index.sqlite"
_HISTORY_FILES = (_HISTORY, _HISTORY_SUMMARY, _INDEX)
"""What programs read of a history, next to its pages."""


def compare(
    baseline: str | Path,
    candidate: str | Path,
    out: str | Path | None = None,
    *,
    across_targets: bool = False,
) -> Comparison:
    """Compare two results metric by metric, with a verdict and an interval each.

    Args:
        baseline, candidate: a result folder, a result.json (a baseline file), or a folder that
            holds several results, which are then repeats of each other.
        out: folder for comparison.json, comparison.html and comparison.md; nothing is written if
            None.
        across_targets: whether results of different rigs are compared on purpose.

    Raises:
        InputError: there is no result, or the two come from different rigs.
    """
    with noting_inputs() as read:
        sides = load_side(baseline), load_side(candidate)
    if out is not None:
        folder = writable(Path(out))
        spare_inputs((folder / name for name in COMPARISON_FILES), read)
    found = compare_sides(*sides, across_targets=across_targets)
    if out is not None:
        write_comparison_files(Path(out), found)
    return found


def write_comparison_files(folder: Path, comparison: Comparison) -> Path:
    """Write comparison.json, comparison.md and comparison.html; return the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    comparison.write(folder / COMPARISON)
    summary = comparison_markdown(comparison)
    write_text(folder / COMPARISON_SUMMARY, summary)
    page = write_comparison(folder, comparison)
    tell_step_summary(summary)
    return page


def run_trials(
    suite: Suite, trials: Collection[str], target: str | Path | None, folder: Path
) -> Result:
    """Run some trials of a suite, and write result and reports into a folder.

    Raises:
        EhaBenchError: bad input, or the folder cannot be used.
    """
    chosen = tuple(trial for trial in suite.trials if trial.id in trials)
    result = run_suite(replace(suite, trials=chosen), target_for(suite, target), folder)
    by_id = {trial.id: trial for trial in chosen}
    by_run = {(run.id, run.repeat): by_id[run.id] for run in result.trials}
    write_reports(folder, result, by_run, folder)
    return result


def history(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    rebuild: bool = False,
    diagnose: str | Path | None = None,
    workers: str | int | None = None,
    progress: StageProgress = no_stages,
) -> History:
    """Follow every metric over many results; write a static site, history.json, .md and an index.

    Args:
        folder: every result.json below it is a run.
        out: folder of the site; `<folder>/history` if None.
        rebuild: make the index again from the results that are there.
        diagnose: nightly.yaml whose `diagnose` says which causes are followed; estimates of the
            nights are kept in `<site>/causes`.
        workers: number of processes, dask://host:port or ray://host:port, that judge the metrics.
        progress: called with the stage of the estimation and the share of it done.

    Raises:
        InputError: there is no result, nightly.yaml is wrong, or the site cannot be written.
    """
    watched = Path(folder)
    site = Path(out) if out is not None else watched / "history"
    with noting_inputs() as read:
        settings = load_cause_settings(Path(diagnose)) if diagnose is not None else None
    spare_inputs((site / name for name in _HISTORY_FILES), read)
    index = update(site / _INDEX, watched, rebuild=rebuild)
    found = history_of(index, str(folder), workers_from(workers))
    if settings is not None:
        found = replace(found, causes=causes_behind(found, watched, site, settings, progress))
    found.write(site / _HISTORY)
    write_text(site / _HISTORY_SUMMARY, history_markdown(found))
    write_site(site, found, watched)
    return found


@dataclass(frozen=True)
class AbResult:
    """What an interleaved run found: the two results, and the comparison of what was finished.

    `folder` is where they lie.
    """

    run: Interleaved
    comparison: Comparison | None
    folder: Path


@signals_raised_after()
def ab(
    suite: Given,
    a: Given,
    b: Given,
    out: str | Path | None = None,
    *,
    repeats: int = 10,
    seed: int = 0,
    warm_up: int = 1,
    resume: bool = False,
    workers: str | int | None = None,
    progress: Progress = silent,
) -> AbResult:
    """Run a suite on two targets in turn (A B B A), and compare B with A.

    Stops before `repeats` pairs where every metric is decided; its error rate holds however early.

    Args:
        suite: a suite.yaml, a shipped name or a dict; its own `repeats` do not count.
        a, b: `simulator`, a target.yaml or a model.yaml, a shipped name or a dict; A is the
            baseline.
        out: gets folders a and b, comparison.html, .json and .md, an earlier run in it is set
            aside; `reports/<suite>-ab/<time>` if None.
        repeats: pairs, at most.
        seed: of the order.
        warm_up: passes through the suite that are not scored.
        resume: go on with an earlier, interrupted run.
        workers: number of processes, dask://host:port or ray://host:port, for simulated targets.
        progress: called at the start of every run.

    Raises:
        EhaBenchError: bad input, or the folder cannot be used.
    """
    if repeats < 1:
        raise InputError(
            f"{repeats} repeats are too few", hint="give 1 or more; 10 are usually enough"
        )
    if seed < 0:
        raise InputError(f"a seed of {seed} is negative", hint="give 0 or more")
    loaded = load_suite(suite)
    openers = {"a": partial(target_for, loaded, a), "b": partial(target_for, loaded, b)}
    names = (openers["a"]().identity.name, openers["b"]().identity.name)
    plan = InterleavedPlan(loaded.sha256, names, repeats, seed)
    shelf = SuiteFolder(f"{loaded.name}-ab")
    folder = Path(out) if out else (shelf.latest() if resume else None) or shelf.claim()
    looks = shares(repeats)

    def compared(results: Mapping[str, Result]) -> Comparison:
        sides = [Side(str(folder / key), ((results[key], folder / key),)) for key in ("a", "b")]
        return compare_sides(sides[0], sides[1], across_targets=True, looks=looks)

    def decided(results: Mapping[str, Result]) -> bool:
        return not compared(results).of(ComparisonVerdict.UNDECIDED)

    run = run_interleaved(
        loaded, openers, folder, plan,
        decided=decided, warm_up=warm_up, resume=resume, workers=workers_from(workers),
        progress=progress,
    )  # fmt: skip
    trials = {trial.id: trial for trial in loaded.trials}
    for side, result in run.results.items():
        by_run = {(item.id, item.repeat): trials[item.id] for item in result.trials}
        write_reports(folder / side, result, by_run, folder / side)
    if run.pairs == 0:
        return AbResult(run, None, folder)
    why = "every metric was decided" if run.decided else "the last was reached"
    if run.status in (Status.FAULT, Status.INCOMPLETE):
        why = f"the run was stopped ({run.status.value})"
    order = " ".join("".join(pair).upper() for pair in plan.order()[: run.pairs])
    stopped = f"{run.pairs} of {repeats} pairs were run ({order}): {why}."
    found = replace(compared(run.results), stopped=stopped)
    write_comparison_files(folder, found)
    return AbResult(run, found, folder)
