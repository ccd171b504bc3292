"""`eha-bench compare`, `ab`, `history` and `baseline`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.running import Workers

if TYPE_CHECKING:
    from eha_bench.comparison.comparison import Comparison

Json = Annotated[bool, typer.Option("--json", help="Print comparison.json on standard output.")]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Leave with 1 also where a metric is undecided, changed or not compared."
    ),
]


def compare(
    baseline: Annotated[
        Path, typer.Argument(help="Result folder, baseline file, or folder of several.")
    ],
    candidate: Annotated[Path, typer.Argument(help="The same, of what is to be judged.")],
    out: Annotated[
        Path, typer.Option("--out", help="Folder for comparison.html, .json and .md.")
    ] = Path("reports/comparison"),
    json: Json = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the summary for a merge request.")
    ] = False,
    across_targets: Annotated[
        bool, typer.Option("--across-targets", help="Compare different rigs on purpose.")
    ] = False,
    strict: Strict = False,
) -> None:
    """Compare two results: differences with confidence, and a verdict a metric."""
    from eha_bench.comparing import compare as compare_results

    found = compare_results(baseline, candidate, out, across_targets=across_targets)
    say_verdicts(found)
    if json:
        typer.echo(found.to_json(), nl=False)
    elif markdown:
        typer.echo((out / "comparison.md").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(out / "comparison.html"))
    leave(found, strict=strict)


def ab(  # noqa: PLR0913, PLR0917 - the options of a command
    suite: Annotated[Path, typer.Argument(help="Suite to run (YAML).")],
    a: Annotated[
        str, typer.Option("--a", help="Baseline target: simulator, target or model file.")
    ],
    b: Annotated[str, typer.Option("--b", help="Candidate target, the same.")],
    repeats: Annotated[int, typer.Option("--repeats", help="Pairs of runs, at most.")] = 10,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder (default: reports/<suite>-ab).")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the order of A and B.")] = 0,
    warm_up: Annotated[
        int, typer.Option("--warm-up", min=0, help="Passes through the suite, not scored.")
    ] = 1,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run.")
    ] = False,
    workers: Workers = "",
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Run a suite on two targets in turn (A B B A), until every metric is decided."""
    from eha_bench.comparing import ab as run_ab
    from eha_bench.core.result import Status
    from eha_bench.suites import load_suite

    folder = out or Path("reports") / f"{load_suite(suite).name}-ab"
    with TerminalProgress() as progress:
        done = run_ab(
            suite, a, b, folder,
            repeats=repeats, seed=seed, warm_up=warm_up, resume=resume, workers=workers,
            progress=progress,
        )  # fmt: skip
    for side, result in done.run.results.items():
        for trial in result.trials:
            if trial.reason:
                say(f"{side.upper()}, {trial.id} [{trial.repeat}]: {trial.reason}")
    if done.comparison is not None:
        say_verdicts(done.comparison)
        say(done.comparison.stopped)
        if json:
            typer.echo(done.comparison.to_json(), nl=False)
        else:
            typer.echo(str(folder / "comparison.html"))
    if done.run.status is Status.FAULT:
        raise typer.Exit(Status.FAULT.exit_status)
    if done.run.status is Status.INCOMPLETE or done.comparison is None:
        say("interrupted: go on with --resume")
        raise typer.Exit(INTERRUPTED)
    leave(done.comparison, strict=strict)


def baseline(
    file: Annotated[Path, typer.Argument(help="Baseline file, e.g. baselines/knee.json.")],
    results: Annotated[list[Path], typer.Argument(help="Result folders; several are repeats.")],
    failed: Annotated[
        bool, typer.Option("--failed", help="Take results that missed limits, too.")
    ] = False,
) -> None:
    """Make results the baseline that `compare` and limits `of baseline` refer to."""
    from eha_bench.comparison.baseline_file import accept

    done = accept(file, results, failed=failed)
    if done.change is not None:
        say("what changes:")
        say_verdicts(done.change)
    runs = len(done.result.trials)
    say(f"{file}: {runs} runs of {done.result.suite} on {done.result.target}")
    typer.echo(str(file))


def history(
    folder: Annotated[Path, typer.Argument(help="Folder of result folders.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder of the site (default: DIR/history).")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print history.json.")] = False,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Make the index anew from the results there are.")
    ] = False,
    only_worse: Annotated[
        bool, typer.Option("--only-worse", help="Leave with 0 where it drifted for the better.")
    ] = False,
    workers: Annotated[
        str,
        typer.Option(
            "--workers",
            help="Judge metrics on so many processes, or on dask://host:port or ray://host:port.",
        ),
    ] = "",
) -> None:
    """Follow every metric over many results: changes, control limits, drift; a static site."""
    from eha_bench.comparing import history as follow
    from eha_bench.report.engineering import metric_name, quantity
    from eha_bench.report.trend_site import headline

    found = follow(folder, out, rebuild=rebuild, workers=workers)
    for problem in found.problems:
        say(f"note: left out: {problem}")
    for trend in found.drifted:
        worse = {True: ", for the worse", False: ", for the better", None: ""}[trend.worse]
        now = quantity(float(trend.values[-1]), trend.unit, metric=trend.metric)
        was = quantity(float(trend.values[-1]) - trend.shift, trend.unit, metric=trend.metric)
        say(
            f"{trend.trial}: {metric_name(trend.metric)} {trend.state.value}: {was} -> {now}{worse}"
        )
    say(headline(found))
    if json:
        typer.echo(found.to_json(), nl=False)
    else:
        typer.echo(str((out or folder / "history") / "index.html"))
    if found.exit_status(only_worse=only_worse):
        raise typer.Exit(1)


def say_verdicts(found: Comparison) -> None:
    """Print caveats, what is not the same, and the verdict."""
    from eha_bench.comparison.verdict import Verdict
    from eha_bench.report.comparison_report import headline
    from eha_bench.report.comparison_rows import rows_of
    from eha_bench.report.engineering import number

    for caveat in found.caveats:
        say(f"note: {caveat}")
    others = [verdict for verdict in Verdict if verdict is not Verdict.SAME]
    for row in rows_of(found.of(*others)):
        share = f" ({row.share})" if row.share else ""
        change = f": {row.baseline} -> {row.candidate} {row.unit}".rstrip() + share
        if row.baseline == row.candidate == number(math.nan):
            change = ""
        note = f"; {row.note}" if row.note else ""
        say(f"{row.trial}: {row.metric} {row.verdict}{change}{note}")
    say(f"{found.status.replace('_', ' ')}: {headline(found)}")


def leave(found: Comparison, *, strict: bool) -> None:
    """Leave with the comparison's exit status, if it is not 0."""
    from eha_bench.comparison.verdict import Verdict

    status = found.exit_status
    open_ones = found.of(Verdict.UNDECIDED, Verdict.CHANGED, Verdict.NOT_COMPARED)
    if strict and status == 0 and open_ones:
        status = 1
    if status:
        raise typer.Exit(status)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(compare)
    app.command()(ab)
    app.command()(baseline)
    app.command()(history)
