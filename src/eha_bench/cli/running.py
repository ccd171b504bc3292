"""`eha-bench run` and `eha-bench score`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import (
    complete_suites,
    complete_sweeps,
    complete_targets,
    complete_trials,
)
from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.reading_limits import MaxMemory, MaxTime, reading_limits

if TYPE_CHECKING:
    from eha_bench.core.result import Result
    from eha_bench.sweeps.probability import Probability

Suite = Annotated[
    str,
    typer.Argument(
        help="Suite to run: a YAML file, or the name of a shipped one.",
        autocompletion=complete_suites,
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Result folder; an earlier run in it is set aside (default: reports/<suite>/<time>).",
    ),
]
Workers = Annotated[
    str,
    typer.Option(
        "--workers",
        help="Number of processes that simulate (0: one a processor), or dask://host:port or "
        "ray://host:port.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print result.json on standard output.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="List everything, not only the first of each kind.")
]


Posterior = Annotated[
    Path | None,
    typer.Option(
        "--posterior",
        help="diagnosis.json or calibration.json of the model: P(pass) over what is not known.",
    ),
]
Conditions = Annotated[
    Path | None,
    typer.Option(
        "--conditions",
        help="sweep.yaml with ranges of the model's parameters (oil, load) that are drawn with "
        "the posterior.",
        autocompletion=complete_sweeps,
    ),
]
Draws = Annotated[int, typer.Option("--draws", min=1, help="Machines drawn from the posterior.")]


def run(  # noqa: PLR0913, PLR0917 - the options of a command
    suite: Suite,
    target: Annotated[
        str | None,
        typer.Option(
            "--target",
            help="simulator, a target.yaml, a model.yaml to simulate, or a shipped name.",
            autocompletion=complete_targets,
        ),
    ] = None,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Finish an interrupted run.")] = False,
    retries: Annotated[
        int,
        typer.Option(
            "--retries", min=0, help="Number of repeats of a trial whose infrastructure failed."
        ),
    ] = 0,
    time_limit: Annotated[
        str, typer.Option("--time-limit", help="Stop safely after this time, e.g. '2 h'.")
    ] = "",
    workers: Workers = "",
    posterior: Posterior = None,
    draws: Draws = 200,
    conditions: Conditions = None,
    least: Annotated[
        float | None,
        typer.Option(
            "--p-pass",
            min=0.0,
            max=1.0,
            help="Exit with 1 unless the whole 95 % interval of P(pass) is at least this.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be sent, and send nothing.")
    ] = False,
    json: Json = False,
    verbose: Verbose = False,
) -> None:
    """Run a suite against a target, and write its report.

    Recordings, result.json, report.html and junit.xml.
    """
    from eha_bench.api import preview
    from eha_bench.api import run as run_suite
    from eha_bench.core.units import positive

    limit = positive("--time-limit", time_limit, "s") if time_limit else float("inf")
    if posterior is None and least is not None:
        from eha_bench.core.errors import InputError

        raise InputError("--p-pass needs a --posterior", hint="give a diagnosis.json")
    if posterior is None and conditions is not None:
        from eha_bench.core.errors import InputError

        raise InputError("--conditions needs a --posterior", hint="give a diagnosis.json")
    if posterior is not None:
        _check_posterior(suite, target, posterior, conditions)
    if dry_run:
        _show(preview(suite, target), json=json)
        return
    with TerminalProgress() as progress:
        result = run_suite(
            suite, target, out,
            resume=resume, retries=retries, time_limit=limit, workers=workers,
            progress=progress,
        )  # fmt: skip
    words = ["eha-bench", "run", str(suite)]
    words += ["--target", target] if target else []
    words += ["--out", str(result.folder), "--resume"]
    chance = None
    if posterior is not None and result.status.value in ("passed", "failed"):
        from eha_bench.api import probability

        with TerminalProgress() as progress:
            chance = probability(
                suite, posterior, target, result.folder,
                conditions=conditions, draws=draws, workers=workers, progress=progress,
            )  # fmt: skip
        say_probability(chance)
    finish(result, json=json, verbose=verbose, resume=shlex.join(words))
    if chance is not None and least is not None and chance.suite.low < least:
        say(f"P(pass) is not shown to be {least:g} or more: {chance.suite}")
        raise typer.Exit(1)


def _check_posterior(
    suite: str, target: str | None, posterior: Path, conditions: Path | None
) -> None:
    """Raise an InputError before anything is run where P(pass) could not be computed after it."""
    from eha_bench.api import check_posterior

    check_posterior(suite, posterior, target, conditions)


def say_probability(found: Probability) -> None:
    """Print P(pass) of the suite and of the limits that are not sure."""
    say(f"P(pass) {found.suite}, {found.suite.kept} of {found.suite.draws} draws")
    chances = [(found.of(place), limit) for place, limit in enumerate(found.limits)]
    for chance, limit in sorted(chances, key=lambda item: item[0].value):
        if chance.kept < chance.draws:
            say(f"  {limit.key} ({limit.text}): {chance}")
    for item in found.unknowns[:3]:
        if item.lower.value != item.upper.value:
            say(
                f"  {item.key}: P(pass) {item.lower.value:.2f} in its lowest third, "
                f"{item.upper.value:.2f} in its highest"
            )
    for note in found.notes:
        say(f"note: {note}")


def score(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings of any readable format.")],
    suite: Annotated[
        str | None,
        typer.Option(
            "--suite",
            help="Suite to score by (our own recordings carry theirs).",
            autocompletion=complete_suites,
        ),
    ] = None,
    channels: Annotated[
        Path | None, typer.Option("--channels", help="channels.yaml of a foreign log.")
    ] = None,
    trial: Annotated[
        str | None,
        typer.Option(
            "--trial",
            help="The trial that the recordings belong to.",
            autocompletion=complete_trials,
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Result folder.")] = Path("reports/score"),
    json: Json = False,
    verbose: Verbose = False,
    max_memory: MaxMemory = None,
    max_time: MaxTime = None,
) -> None:
    """Score recordings made earlier or elsewhere, as a run does."""
    from eha_bench.api import score_files

    with TerminalProgress() as progress, reading_limits(max_memory, max_time):
        result = score_files(recordings, suite, channels, out, trial=trial, progress=progress)
    finish(result, json=json, verbose=verbose)


def _show(trials: dict[str, tuple[str, ...]], *, json: bool) -> None:
    """Print what a run would do to its target, by trial."""
    if json:
        import json as encoder

        content = {"schema_version": 1, "trials": trials}
        typer.echo(encoder.dumps(content, indent=1, ensure_ascii=False))
        return
    for trial, lines in trials.items():
        typer.echo("\n  ".join((trial, *lines)))


def finish(result: Result, *, json: bool, verbose: bool, resume: str = "") -> None:
    """Print the outcome and the report's path, and leave with the result's exit status.

    `resume` is the command that goes on with a run that Ctrl-C has stopped.
    """
    from eha_bench.cli.run_summary import summary_lines
    from eha_bench.cli.terminal import shows_colour
    from eha_bench.core.result import Status

    folder = result.folder
    assert folder is not None

    if json:
        typer.echo(result.to_json(), nl=False)
    for line in summary_lines(result, verbose=verbose, colour=shows_colour()):
        say(line)
    if json:
        say(str(folder / "report.html"))
    else:
        typer.echo(str(folder / "report.html"))
    stopped_by = result.provenance.get("stopped_by", "")
    if resume and result.status is Status.INCOMPLETE and stopped_by == "interrupted":
        say(f"interrupted; to go on: {resume}")
        raise typer.Exit(INTERRUPTED)
    if result.status is not Status.PASSED:
        raise typer.Exit(result.status.exit_status)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(run)
    app.command()(score)
