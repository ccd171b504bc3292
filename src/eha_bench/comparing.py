"""The Python face of comparing: the same as the commands, with their reports."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from eha_bench.api import write_reports
from eha_bench.bench.run import run_suite
from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.side import load_side
from eha_bench.core.result import Result, write_text
from eha_bench.report import append_step_summary
from eha_bench.report.comparison_markdown import comparison_markdown
from eha_bench.report.comparison_report import write_comparison
from eha_bench.report.trend_site import write_site
from eha_bench.suites import Suite
from eha_bench.targets.resolve import open_target
from eha_bench.targets.target import Target
from eha_bench.trends.history import History, history_of
from eha_bench.trends.index import update


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
    found = compare_sides(load_side(baseline), load_side(candidate), across_targets=across_targets)
    if out is not None:
        write_comparison_files(Path(out), found)
    return found


def write_comparison_files(folder: Path, comparison: Comparison) -> Path:
    """Write comparison.json, comparison.md and comparison.html; return the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    comparison.write(folder / "comparison.json")
    summary = comparison_markdown(comparison)
    write_text(folder / "comparison.md", summary)
    append_step_summary(summary)
    return write_comparison(folder, comparison)


def opened(suite: Suite, target: str | Path | None) -> Target:
    """Return the target that a suite is run on: the one given, the suite's own, or the simulator.

    Raises:
        EhaBenchError: there is no such target, or its file is wrong.
    """
    model, controller, own = (
        suite.path.parent / name if name and name != "simulator" else None
        for name in (suite.model, suite.controller, suite.target)
    )
    return open_target(target or own or "simulator", model=model, controller=controller)


def run_trials(
    suite: Suite, trials: Collection[str], target: str | Path | None, folder: Path
) -> Result:
    """Run some trials of a suite, and write result and reports into a folder.

    Raises:
        EhaBenchError: bad input, or the folder cannot be used.
    """
    chosen = tuple(trial for trial in suite.trials if trial.id in trials)
    result = run_suite(replace(suite, trials=chosen), opened(suite, target), folder)
    by_id = {trial.id: trial for trial in chosen}
    by_run = {(run.id, run.repeat): by_id[run.id] for run in result.trials}
    write_reports(folder, result, by_run, folder)
    return result


def history(folder: str | Path, out: str | Path | None = None, *, rebuild: bool = False) -> History:
    """Follow every metric over many results; write a static site, history.json and an index.

    Args:
        folder: every result.json below it is a run.
        out: folder of the site; `<folder>/history` if None.
        rebuild: make the index anew from the results that are there.

    Raises:
        InputError: there is no result.
    """
    watched = Path(folder)
    site = Path(out) if out is not None else watched / "history"
    found = history_of(update(site / "index.sqlite", watched, rebuild=rebuild), str(folder))
    found.write(site / "history.json")
    write_site(site, found, watched)
    return found
