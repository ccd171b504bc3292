"""`eha-bench validate` and `eha-bench schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import say


def validate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="YAML files to check.")],
    json: Annotated[
        bool, typer.Option("--json", help="Print what was found on standard output.")
    ] = False,
) -> None:
    """Check YAML files: suite, target, model, controller, channels, dataset."""
    from eha_bench.core.errors import EhaBenchError
    from eha_bench.core.file_kind import kind_of

    found: list[dict[str, object]] = []
    for path in files:
        entry: dict[str, object] = {"file": str(path), "kind": None, "valid": True}
        found.append(entry)
        try:
            kind = kind_of(path)
            entry["kind"] = kind.name
            kind.check(path)
            say(f"{path}: a valid {kind.name}")
        except EhaBenchError as error:
            place = {"file": error.where.file, "line": error.where.line, "key": error.where.key}
            mistake = {"message": str(error), "what": error.what, "hint": error.hint, **place}
            entry.update(valid=False, error=mistake)
            say(f"eha-bench: {error}")
    if json:
        import json as encoder

        content = {"schema_version": 1, "files": found}
        typer.echo(encoder.dumps(content, indent=1, ensure_ascii=False))
    if not all(entry["valid"] for entry in found):
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
