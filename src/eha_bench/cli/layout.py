"""`eha-bench layout`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import write_out


def layout(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="Recording, suite or channels.yaml to lay out (default: every channel we write)."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write (default: standard output).")
    ] = None,
) -> None:
    """Write a Foxglove layout (JSON) that plots our topics."""
    import json

    from eha_bench.core.output_folder import spare_inputs
    from eha_bench.report.foxglove import layout_for

    if out is not None:
        spare_inputs((out,), (source,), "name another file with --out")
    text = json.dumps(layout_for(source), indent=2, ensure_ascii=False) + "\n"
    if out is None:
        typer.echo(text, nl=False)
        return
    write_out(out, text)
    typer.echo(str(out))


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(layout)
