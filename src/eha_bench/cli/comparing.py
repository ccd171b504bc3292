"""`eha-bench compare`, `ab`, `history` and `baseline`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import complete_targets
from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.running import Suite, Verbose, Workers
from eha_bench.cli.terminal import Paint, columns, more, paint, shows_colour

if TYPE_CHECKING:
    from eha_bench.comparison.comparison import Comparison
    from eha_bench.report.comparison_rows import Row

Json = Annotated[bool, typer.Option("--json", help="Print comparison.json on standard output.")]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Exit with 1 also where a metric is undecided, changed or not compared."
    ),
]


def compare(
    baseline: Annotated[
        Path, typer.Argument(help="Result folder, baseline file, or folder of several.")
    ],
    candidate: Annotated[Path, typer.Argument(help="Results to judge, given in the same ways.")],
    out: Annotated[
        Path, typer.Option("--out", help="Folder for comparison.html, .json and .md.")
    ] = Path("reports/comparison"),
    json: Json = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the summary for a merge request.")
    ] = False,
    across_targets: Annotated[
        bool, typer.Option("--across-targets", help="Allow a comparison of different rigs.")
    ] = False,
    strict: Strict = False,
    verbose: Verbose = False,
) -> None:
    """Compare two results: a verdict on every metric.

    Every difference has its interval; exit status 1 for a regression.
    """
    from eha_bench.comparison_api import compare as compare_results

    found = compare_results(baseline, candidate, out, across_targets=across_targets)
    say_verdicts(found, verbose=verbose)
    if json:
        typer.echo(found.to_json(), nl=False)
    elif markdown:
        typer.echo((out / "comparison.md").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(out / "comparison.html"))
    leave(found, strict=strict)


def ab(  # noqa: PLR0913, PLR0917 - the options of a command
    suite: Suite,
    a: Annotated[
        str,
        typer.Option(
            "--a",
            help="Baseline target: simulator, target or model file, or a shipped one.",
            autocompletion=complete_targets,
        ),
    ],
    b: Annotated[
        str,
        typer.Option(
            "--b", help="Candidate target, given in the same ways.", autocompletion=complete_targets
        ),
    ],
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Pairs of runs, at most.")] = 10,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder (default: reports/<suite>-ab/<time>).")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the order of A and B.")] = 0,
    warm_up: Annotated[
        int, typer.Option("--warm-up", min=0, help="Warm-up passes through the suite, not scored.")
    ] = 1,
    resume: Annotated[bool, typer.Option("--resume", help="Finish an interrupted run.")] = False,
    workers: Workers = "",
    json: Json = False,
    strict: Strict = False,
    verbose: Verbose = False,
) -> None:
    """Run a suite on two targets in turn (A B B A).

    It goes on until every metric is decided, or all repeats are done.
    """
    from eha_bench.comparison_api import ab as run_ab
    from eha_bench.core.result import Status

    with TerminalProgress() as progress:
        done = run_ab(
            suite, a, b, out,
            repeats=repeats, seed=seed, warm_up=warm_up, resume=resume, workers=workers,
            progress=progress,
        )  # fmt: skip
    for side, result in done.run.results.items():
        for trial in result.trials:
            if trial.reason:
                say(f"{side.upper()}, {trial.id} [{trial.repeat}]: {trial.reason}")
    if done.comparison is not None:
        say_verdicts(done.comparison, verbose=verbose)
        say(done.comparison.stopped)
        if json:
            typer.echo(done.comparison.to_json(), nl=False)
        else:
            typer.echo(str(done.folder / "comparison.html"))
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
        bool, typer.Option("--failed", help="Accept results that missed limits.")
    ] = False,
) -> None:
    """Make results the baseline of comparisons and limits.

    `compare` takes the file, and limits `of baseline` refer to it.
    """
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
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the summary in Markdown.")
    ] = False,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Rebuild the index from the results.")
    ] = False,
    only_worse: Annotated[
        bool, typer.Option("--only-worse", help="Exit with 0 for a drift to the better.")
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            help="nightly.yaml: where the summary is sent, and when; which causes are followed.",
        ),
    ] = None,
    diagnose: Annotated[
        Path | None,
        typer.Option(
            "--diagnose",
            help="nightly.yaml: estimate every night the causes that it follows under 'diagnose': "
            "which wears, since when, how fast, how many nights are left to a limit.",
        ),
    ] = None,
    workers: Annotated[
        str,
        typer.Option(
            "--workers",
            help="Number of processes that judge metrics (0: one a processor), or dask://host:port "
            "or ray://host:port.",
        ),
    ] = "",
) -> None:
    """Follow every metric over many results, and flag drifts.

    Trends, changes and control limits, as pages that need no server.
    """
    from eha_bench.cli.experiment import stages
    from eha_bench.comparison_api import history as follow
    from eha_bench.core.errors import InputError
    from eha_bench.report.causes_text import untold_sentence, wear_sentence
    from eha_bench.report.sending import send_on
    from eha_bench.report.trend_site import event_sentence, headline
    from eha_bench.trends.nightly_file import load_nightly

    nightly = load_nightly(config) if config is not None else None
    followed = diagnose
    if followed is None and nightly is not None and nightly.diagnose is not None:
        followed = config
    with TerminalProgress() as bar:
        found = follow(
            folder, out, rebuild=rebuild, diagnose=followed, workers=workers, progress=stages(bar)
        )
    for problem in found.problems:
        say(f"note: left out: {problem}")
    for event in found.events:
        if event.now:
            say(event_sentence(event))
    if found.causes is not None:
        for night in untold_sentence(found.causes)[:1]:
            say(f"note: no cause estimated: {night}")
        for wear in found.causes.wear:
            say(wear_sentence(wear))
    say(headline(found))
    if nightly is not None:
        try:
            done = send_on(found, nightly)
        except InputError as error:  # the night is judged all the same
            done = f"note: {error}"
        if done:
            say(done)
    if json:
        typer.echo(found.to_json(), nl=False)
    elif markdown:
        site = out or folder / "history"
        typer.echo((site / "history.md").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str((out or folder / "history") / "index.html"))
    if found.exit_status(only_worse=only_worse):
        raise typer.Exit(1)


def say_verdicts(found: Comparison, *, verbose: bool = False) -> None:
    """Print caveats, limits newly missed, what is not the same, and the verdict."""
    from eha_bench.cli.run_summary import SHOWN
    from eha_bench.comparison.verdict import ComparisonVerdict
    from eha_bench.report.comparison_report import (
        headline,
        limits_turned,
        repeats_needed,
        verdict_of,
    )
    from eha_bench.report.comparison_rows import rows_of

    on = shows_colour()
    for caveat in found.caveats:
        say(f"note: {caveat}")
    missed, kept = limits_turned(found)
    for limit in missed:
        say(f"{paint('limit newly missed', Paint.BAD, on=on)}: {limit}")
    for limit in kept:
        say(f"{paint('limit kept again', Paint.GOOD, on=on)}: {limit}")
    tones = {
        ComparisonVerdict.WORSE: Paint.BAD,
        ComparisonVerdict.CHANGED: Paint.WARN,
        ComparisonVerdict.BETTER: Paint.GOOD,
        ComparisonVerdict.NOT_COMPARED: Paint.QUIET,
        ComparisonVerdict.UNDECIDED: Paint.UNSURE,
    }
    for verdict, tone in tones.items():
        rows = rows_of(found.of(verdict))
        shown = rows
        if not verbose:
            shown = () if verdict is ComparisonVerdict.UNDECIDED else rows[:SHOWN]
        cells = columns([_change_cells(row) for row in shown], right=(2,))
        for trial, metric, change, note in cells:
            say(f"{trial}  {paint(metric, tone, on=on)}  {change}  {note}".rstrip())
        if verdict is ComparisonVerdict.UNDECIDED and rows and not verbose:
            say(f"{len(rows)} {paint('undecided', tone, on=on)}: {repeats_needed(found)}")
        elif len(shown) < len(rows):
            say(more(len(rows) - len(shown)))
    _, word = verdict_of(found)
    say(f"{word[0].lower()}{word[1:]}: {headline(found)}")


def _change_cells(row: Row) -> tuple[str, str, str, str]:
    from eha_bench.report.engineering import number

    change = f"{row.baseline} -> {row.candidate} {row.unit}".rstrip()
    if row.baseline == row.candidate == number(math.nan):
        change = ""
    by = row.share or (row.difference if row.unit == "%" else "")
    share_text = f"({by})" if by and change and by != number(math.nan) else ""
    return row.trial, f"{row.metric} {row.verdict}", change, f"{share_text} {row.note}".strip()


def leave(found: Comparison, *, strict: bool) -> None:
    """Leave with the comparison's exit status, if it is not 0."""
    from eha_bench.comparison.verdict import ComparisonVerdict

    status = found.exit_status
    open_ones = found.of(
        ComparisonVerdict.UNDECIDED, ComparisonVerdict.CHANGED, ComparisonVerdict.NOT_COMPARED
    )
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
