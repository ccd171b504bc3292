"""`eha-bench validate` and `eha-bench schema`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import complete_kinds
from eha_bench.cli.console import say

if TYPE_CHECKING:
    from eha_bench.core.errors import EhaBenchError


def validate(
    files: Annotated[list[Path], typer.Argument(help="YAML files to check.")],
    json: Annotated[
        bool, typer.Option("--json", help="Print the findings on standard output.")
    ] = False,
) -> None:
    """Check YAML files of any kind: every mistake with its line.

    Suite, sweep, target, model, controller, channels, dataset, nightly and plant files.
    """
    from eha_bench.core.errors import EhaBenchError
    from eha_bench.core.plugins import running_nothing
    from eha_bench.core.yaml_file import kind_of

    found: list[dict[str, object]] = []
    for path in files:
        entry: dict[str, object] = {"file": str(path), "kind": None, "valid": True}
        found.append(entry)
        try:
            kind = kind_of(path)
            entry["kind"] = kind.name
            with running_nothing() as unseen:
                checked = kind.check(path)
            remarks = list(kind.remarks(checked))
            entry.update(not_checked=unseen, notes=remarks)
            say(f"{path}: a valid {kind.title}")
            for remark in remarks:
                say(f"{path}: {remark}")
            for reference in dict.fromkeys(unseen):
                say(f"{path}: {reference} was not checked: only a run loads its code")
        except EhaBenchError as error:
            mistakes = [_mistake(item) for item in error.each]
            entry.update(valid=False, error=mistakes[0], errors=mistakes)
            for item in error.each:
                say(f"eha-bench: {item.sentence}")
    if json:
        import json as encoder

        content = {"schema_version": 1, "files": found}
        typer.echo(encoder.dumps(content, indent=1, ensure_ascii=False))
    if not all(entry["valid"] for entry in found):
        raise typer.Exit(2)


def _mistake(error: EhaBenchError) -> dict[str, object]:
    """Return a mistake for programs."""
    place = {"file": error.where.file, "line": error.where.line, "key": error.where.key}
    return {"message": error.sentence, "what": error.what, "hint": error.hint, **place}


def schema(
    kind: Annotated[
        str,
        typer.Argument(
            help="suite, sweep, vary, target, model, controller, channels, dataset or nightly.",
            autocompletion=complete_kinds,
        ),
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
