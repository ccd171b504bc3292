"""`eha-bench serve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import say


def serve(
    folder: Annotated[Path, typer.Argument(help="Folder of result folders; it is only read.")],
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port to listen on; 0: any free one.")
    ] = 8765,
    host: Annotated[
        str,
        typer.Option(
            "--host", help="Name or address to listen on; other than this machine: with a token."
        ),
    ] = "127.0.0.1",
    token: Annotated[
        str,
        typer.Option(
            "--token",
            envvar="EHA_BENCH_TOKEN",
            help="Token that browsers must send (default: none on this machine, else a new one).",
        ),
    ] = "",
) -> None:
    """Serve a folder's runs and trends as pages, live runs too.

    Two runs are compared by click; the folder is only read.
    """
    from eha_bench.core.errors import InputError
    from eha_bench.core.extras import way_to_install

    try:
        from eha_bench.server.serving import serve as go_on
    except ImportError as error:
        raise InputError(
            f"pages are served with Starlette and uvicorn ({error})",
            hint=way_to_install("serve"),
        ) from error

    def tell(address: str) -> None:
        say(f"{folder} is served at {address} (Ctrl-C ends it)")
        typer.echo(address)

    go_on(folder, host=host, port=port, token=token, tell=tell)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(serve)
