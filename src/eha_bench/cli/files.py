"""`eha-bench validate` and `eha-bench schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import say


def validate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="YAML files to check.")],
) -> None:
    """Check YAML files: suite, target, model, controller, channels, dataset."""
    from eha_bench.core.errors import EhaBenchError
    from eha_bench.core.file_kind import kind_of

    wrong = 0
    for path in files:
        try:
            kind = kind_of(path)
            kind.check(path)
            say(f"{path}: a valid {kind.name}")
        except EhaBenchError as error:
            wrong += 1
            say(f"eha-bench: {error}")
    if wrong:
        raise typer.Exit(2)


def schema(
    kind: Annotated[
        str, typer.Argument(help="suite, target, model, controller, channels or dataset.")
    ],
) -> None:
    """Print the JSON Schema of a kind of file, for editors."""
    import json

    from eha_bench.core.file_kind import kind_named

    typer.echo(json.dumps(kind_named(kind).schema(), indent=2, ensure_ascii=False))


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(validate)
    app.command()(schema)
