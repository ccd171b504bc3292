"""The commands of `eha-bench`, put together."""

from __future__ import annotations

from typing import Final

import typer
from typer.main import get_command

from eha_bench.cli import (
    closing,
    comparing,
    experiment,
    exporting,
    files,
    layout,
    listing,
    project,
    recording_files,
    rig,
    running,
    serving,
    sweeping,
    tuning,
)
from eha_bench.cli.help import WordedCommand

_WELCOME = """\
eha-bench tests, scores and explains electro-hydrostatic actuators.

  eha-bench init my-bench    write a project that runs at once
  eha-bench run smoke        run a shipped suite on the simulator
  eha-bench list suites      what there is (also metrics, effects, plants, elements …)

eha-bench -h lists all commands, eha-bench COMMAND -h explains one."""

app = typer.Typer(
    name="eha-bench",
    help="Test, score and understand electro-hydrostatic actuators.",
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
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
    if context.invoked_subcommand is None:
        typer.echo(_WELCOME)


project.register(app)
listing.register(app)
running.register(app)
sweeping.register(app)
tuning.register(app)
files.register(app)
recording_files.register(app)
closing.register(app)
experiment.register(app)
comparing.register(app)
exporting.register(app)
layout.register(app)
rig.register(app)
serving.register(app)

for registered in app.registered_commands:
    registered.cls = WordedCommand

command: Final = get_command(app)
"""The command line, made of all of them once for a process."""
