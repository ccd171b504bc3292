"""`eha-bench run` and `eha-bench score`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say

if TYPE_CHECKING:
    from eha_bench.core.result import Result

Out = Annotated[
    Path | None, typer.Option("--out", help="Result folder (default: reports/<suite>).")
]
Workers = Annotated[
    str,
    typer.Option(
        "--workers",
        help="Simulate on so many processes, or on dask://host:port or ray://host:port.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print result.json on standard output.")]


def run(
    suite: Annotated[Path, typer.Argument(help="Suite to run (YAML).")],
    target: Annotated[
        str | None,
        typer.Option("--target", help="simulator, a target.yaml, or a model.yaml to simulate."),
    ] = None,
    out: Out = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Do only what an interrupted run left undone.")
    ] = False,
    retries: Annotated[
        int,
        typer.Option(
            "--retries", min=0, help="Run a trial again whose infrastructure failed, so often."
        ),
    ] = 0,
    time_limit: Annotated[
        str, typer.Option("--time-limit", help="Stop safely after this time, e.g. '2 h'.")
    ] = "",
    workers: Workers = "",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be sent, and send nothing.")
    ] = False,
    json: Json = False,
) -> None:
    """Run a suite against a target: recordings, result.json, report.html, junit.xml."""
    from eha_bench.api import preview
    from eha_bench.api import run as run_suite
    from eha_bench.core.units import positive
    from eha_bench.suites import load_suite

    limit = positive("--time-limit", time_limit, "s") if time_limit else float("inf")
    if dry_run:
        _show(preview(suite, target), json=json)
        return
    folder = out or Path("reports") / load_suite(suite).name
    with TerminalProgress() as progress:
        result = run_suite(
            suite, target, folder,
            resume=resume, retries=retries, time_limit=limit, workers=workers,
            progress=progress,
        )  # fmt: skip
    _finish(result, folder, json=json, interruptible=True)


def score(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings, of any format read.")],
    suite: Annotated[
        Path | None,
        typer.Option("--suite", help="Suite to score by (our own recordings carry theirs)."),
    ] = None,
    channels: Annotated[
        Path | None, typer.Option("--channels", help="channels.yaml of somebody else's log.")
    ] = None,
    trial: Annotated[
        str | None, typer.Option("--trial", help="The trial that the recordings belong to.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Result folder.")] = Path("reports/score"),
    json: Json = False,
) -> None:
    """Score recordings made earlier or elsewhere, by the same code as a run."""
    from eha_bench.api import score_files

    with TerminalProgress() as progress:
        result = score_files(recordings, suite, channels, out, trial=trial, progress=progress)
    _finish(result, out, json=json)


def _show(trials: dict[str, tuple[str, ...]], *, json: bool) -> None:
    """Print what a run would do to its target, by trial."""
    if json:
        import json as encoder

        content = {"schema_version": 1, "trials": trials}
        typer.echo(encoder.dumps(content, indent=1, ensure_ascii=False))
        return
    for trial, lines in trials.items():
        typer.echo("\n  ".join((trial, *lines)))


def _finish(result: Result, folder: Path, *, json: bool, interruptible: bool = False) -> None:
    """Print the outcome and the report's path, and leave with the result's exit status."""
    from eha_bench.core.result import Status

    if json:
        typer.echo(result.to_json(), nl=False)
    rejected = [
        (trial, item)
        for trial in result.trials
        for item in trial.scores
        if item.limit and item.status.rejects
    ]
    for trial in result.trials:
        if trial.reason:
            say(f"{trial.id} [{trial.repeat}]: {trial.reason}")
    for trial, item in rejected:
        value = f"{item.value:.6g} {item.unit}".strip()
        why = item.measure.reason if item.status.value == "not_scored" else value
        word = item.status.value.replace("_", " ")
        say(f"{trial.id} [{trial.repeat}]: {item.metric} {word}: {why} "
            f"(limit {item.limit})")  # fmt: skip
    limits = sum(bool(item.limit) for trial in result.trials for item in trial.scores)
    say(f"{result.suite}: {result.status.value}, {limits - len(rejected)} of {limits} limits kept")
    if json:
        say(str(folder / "report.html"))
    else:
        typer.echo(str(folder / "report.html"))
    stopped_by = result.provenance.get("stopped_by", "")
    if interruptible and result.status is Status.INCOMPLETE and stopped_by == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if result.status is not Status.PASSED:
        raise typer.Exit(result.status.exit_status)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(run)
    app.command()(score)
