"""`eha-bench init`: a project that runs at once."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from eha_bench.cli.completion import beginning
from eha_bench.cli.console import say

if TYPE_CHECKING:
    from collections.abc import Iterator

TEMPLATES: Final = Path(__file__).with_name("templates")
_COMMON: Final = "common"
_PLACED: Final = {"bench.yml": ".github/workflows/bench.yml", "gitignore": ".gitignore"}


def plants() -> tuple[str, ...]:
    """Return the plants that there is a project for."""
    return tuple(
        sorted(path.name for path in TEMPLATES.iterdir() if path.is_dir() and path.name != _COMMON)
    )


def _complete_plants(incomplete: str) -> list[str]:
    return beginning(plants(), incomplete)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder of the project.")] = Path(),
    plant: Annotated[
        str,
        typer.Option("--plant", help="Plant of the project.", autocompletion=_complete_plants),
    ] = "eha_knee",
) -> None:
    """Write a project that runs at once.

    Suite, target, model, controller, channels, dataset and CI file; nothing is asked.
    Files that are there already are left alone.
    """
    from eha_bench.core.atomic_file import replacing
    from eha_bench.core.errors import InputError, PluginError
    from eha_bench.core.near_miss import suggest
    from eha_bench.core.output_folder import writable

    if plant not in plants():
        raise PluginError(f"there is no project for plant '{plant}'", hint=suggest(plant, plants()))
    writable(folder, "name another folder: eha-bench init DIR")
    wanted = dict(_files(plant))
    there = [name for name in wanted if (folder / name).exists()]
    if len(there) == len(wanted):
        raise InputError(f"{folder} already holds all files of the project")
    for name, source in wanted.items():
        target = folder / name
        if name in there:
            say(f"left alone: {target}")
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as part:
            part.write_bytes(source.read_bytes())
        typer.echo(str(target))
    move = "" if folder == Path() else f"cd {shlex.quote(str(folder))} && "
    say(f"\nnext: {move}eha-bench run suite.yaml --target target.yaml")


def _files(plant: str) -> Iterator[tuple[str, Path]]:
    """Yield the name within a project and the template of every file."""
    for top in (TEMPLATES / plant, TEMPLATES / _COMMON):
        for source in sorted(top.rglob("*")):
            if source.is_file() and "__pycache__" not in source.parts:
                name = source.relative_to(top).as_posix()
                yield _PLACED.get(name, name), source


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(init)
