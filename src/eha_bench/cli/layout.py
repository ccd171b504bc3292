"""`eha-bench layout`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


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
    """Write a Foxglove layout (JSON) that plots our topics, units in the labels."""
    import json

    from eha_bench.core.atomic_file import write_text
    from eha_bench.core.errors import InputError, Place
    from eha_bench.report.foxglove import layout_for

    text = json.dumps(layout_for(source), indent=2, ensure_ascii=False) + "\n"
    if out is None:
        typer.echo(text, nl=False)
        return
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_text(out, text)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})",
            where=Place(file=str(out)),
            hint="name another file with --out",
        ) from error
    typer.echo(str(out))


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(layout)
