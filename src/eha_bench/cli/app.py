"""The commands of `eha-bench`, put together."""

from __future__ import annotations

import typer

from eha_bench.cli import (
    closing,
    comparing,
    exporting,
    files,
    layout,
    recording_files,
    rig,
    running,
)

app = typer.Typer(
    name="eha-bench",
    help="Test, score and understand electro-hydrostatic actuators.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Print the version."),
) -> None:
    """Test, score and understand electro-hydrostatic actuators."""
    if version:
        from eha_bench import __version__

        typer.echo(__version__)
        raise typer.Exit
    del context


running.register(app)
files.register(app)
recording_files.register(app)
closing.register(app)
comparing.register(app)
exporting.register(app)
layout.register(app)
rig.register(app)
