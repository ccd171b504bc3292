"""The command `eha-bench`."""

from __future__ import annotations

import gc
import os

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
from eha_bench.cli.console import errors_as_sentences, say_what_the_product_logs

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


def main() -> None:
    """Entry point of the command: errors become sentences, results become exit statuses."""
    # starting makes many objects and hardly any garbage: looking for it took a tenth of the time
    gc.set_threshold(200_000)
    # pydantic would look through all installed packages for plug-ins of its own, which none are
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    say_what_the_product_logs()
    with errors_as_sentences():
        app()
