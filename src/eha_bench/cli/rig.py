"""`eha-bench rig` and `eha-bench clear`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import say

_TARGET = typer.Argument(help="target.yaml of the drive to play (default: the shipped eha_drive).")


def rig(
    target: Annotated[Path | None, _TARGET] = None,
    listen: Annotated[
        str,
        typer.Option(
            "--listen",
            help="pty, pty:LINK, socket://127.0.0.1:PORT or socketcan:INTERFACE "
            "(default: the target's bus).",
        ),
    ] = "",
    model: Annotated[
        Path | None, typer.Option("--model", help="model.yaml of the actuator that is played.")
    ] = None,
    controller: Annotated[
        Path | None, typer.Option("--controller", help="The drive's own controllers.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            help="KIND[=VALUE][@START[+LENGTH]], START in s after the torque came on: silent, "
            "frozen=CHANNEL, late=5ms, lost=0.1, scale=CHANNEL:2, over-pressure, bus-off, "
            "emergency-stop.",
        ),
    ] = None,
    watchdog: Annotated[
        str,
        typer.Option(
            "--watchdog", help="Longest time without a command before the watchdog stops the drive."
        ),
    ] = "20 ms",
    log: Annotated[
        Path | None, typer.Option("--log", help="The drive's own log (JSON lines).")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of noise and lost frames.")] = 0,
    priority: Annotated[
        int,
        typer.Option(
            "--priority", min=0, max=99, help="SCHED_FIFO priority where permitted, 0: none."
        ),
    ] = 50,
    duration: Annotated[str, typer.Option("--for", help="Stop after this time.")] = "",
) -> None:
    """Play a drive and its actuator behind a CAN adapter.

    In real time, on this machine only.
    """
    from eha_bench.core.interruption import Interruption
    from eha_bench.core.shipped import shipped_rig
    from eha_bench.core.units import positive
    from eha_bench.rig.drive import DriveLimits
    from eha_bench.rig.faults import parse_fault
    from eha_bench.rig.process import Rig, RigOptions

    chosen = target or shipped_rig("eha_drive.yaml")
    options = RigOptions(
        listen=listen,
        model=model,
        controller=controller,
        limits=DriveLimits(watchdog=positive("--watchdog", watchdog, "s")),
        faults=tuple(parse_fault(text) for text in fault or ()),
        seed=seed,
        log=log,
        priority=priority,
    )
    length = positive("--for", duration, "s") if duration else float("inf")
    with Interruption() as stopping:
        playing = Rig(chosen, options)
        try:
            typer.echo(playing.channel)
            say(f"the rig listens on {playing.channel}; run: eha-bench run SUITE --target {chosen}")
            playing.serve(stopping, length)
        finally:
            playing.close()


def clear(
    target: Annotated[Path, typer.Argument(help="target.yaml of the rig.")],
    by: Annotated[str, typer.Option("--by", help="Name of the person who inspected the rig.")],
) -> None:
    """Clear a rig's latch and fault, after a person inspected it."""
    from eha_bench.core.errors import InputError
    from eha_bench.targets.can.target import CanTarget
    from eha_bench.targets.resolve import open_target

    opened = open_target(target)
    if not isinstance(opened, CanTarget):
        raise InputError(f"'{target}' is not a rig, so it has no latch")
    if not by.strip():
        raise InputError(
            "the person who inspected the rig is not named", hint="give a name: --by NAME"
        )
    say(opened.clear(by))


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(rig)
    app.command()(clear)
