"""`eha-bench export-fmu`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import say


def export_fmu(
    model: Annotated[Path, typer.Argument(help="model.yaml.")],
    out: Annotated[Path, typer.Option("--out", help="The .fmu to write.")],
    fmi: Annotated[int, typer.Option("--fmi", min=2, max=3, help="FMI version: 2 or 3.")] = 2,
) -> None:
    """Write a model as an FMU for Simulink, Modelica and others.

    For co-simulation, by FMI 2 or 3.
    """
    from eha_bench.targets.fmu.export import export_fmu as export

    path = export(model, out, fmi)
    say("running it needs a Python with eha-bench: see docs/fmu.md")
    typer.echo(str(path))


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("export-fmu")(export_fmu)
