"""`eha-bench next`: the experiment that separates what a diagnosis leaves open."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import TerminalProgress, say

_HUNDRED = 100
NONE = 1
"""Exit status where no experiment is proposed."""


def next_experiment(
    diagnosis: Annotated[Path, typer.Argument(help="diagnosis.json, or the folder it is in.")],
    out: Annotated[Path, typer.Option("--out", help="Suite to write (next.yaml).")],
    budget: Annotated[
        str, typer.Option("--budget", help="Bench time that it may take, e.g. '30 s'.")
    ] = "30 s",
    safety: Annotated[
        str,
        typer.Option(
            "--safety",
            help="target.yaml of a drive, or a suite, whose limits hold; without one nothing goes "
            "beyond what the recordings have been to.",
        ),
    ] = "",
    probability: Annotated[
        float,
        typer.Option(
            "--probability",
            min=0.5,
            max=0.999,
            help="Of naming the right rival, as asked for.",
        ),
    ] = 0.95,
    within: Annotated[
        str,
        typer.Option("--within", help="Half of a 95 % interval that is asked for, e.g. '10 %'."),
    ] = "10 %",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all draws.")] = 0,
    json: Annotated[
        bool, typer.Option("--json", help="Print the result on standard output.")
    ] = False,
) -> None:
    """Find the cheapest permitted experiment that separates what a diagnosis leaves open."""
    from eha_bench.api import next_experiment as propose
    from eha_bench.core.units import positive
    from eha_bench.experiment.proposal import Ending

    with TerminalProgress() as bar:
        found = propose(
            diagnosis,
            out,
            budget=positive("--budget", budget, "s"),
            safety=safety or None,
            probability=probability,
            within=positive("--within", within, ""),
            seed=seed,
            progress=lambda stage, share: bar(round(_HUNDRED * share), _HUNDRED, stage),
        )
    for note in found.notes:
        say(note)
    say(found.sentence)
    if json:
        typer.echo(json_text.dumps(found.to_dict(), indent=1, ensure_ascii=False, allow_nan=False))
    else:
        typer.echo(str(out if found.ending is Ending.PROPOSED else out.with_suffix(".html")))
    if found.ending is not Ending.PROPOSED:
        raise typer.Exit(NONE)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("next")(next_experiment)
