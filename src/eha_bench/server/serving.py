"""The application on a socket, until it is stopped."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn

from eha_bench.core.errors import InputError, Place
from eha_bench.server.app import application
from eha_bench.server.guard import Rules
from eha_bench.server.watch import Watch


def serve(folder: Path, *, host: str, port: int, token: str, tell: Callable[[str], None]) -> None:
    """Serve a folder's pages until it is interrupted.

    Args:
        folder: the results.
        host: name or address to be bound to.
        port: 0 for any that is free.
        token: what must be shown; "" for none on this machine only, elsewhere for a new one.
        tell: is given the address once it can be asked.

    Raises:
        InputError: no such folder, or the address cannot be used.
    """
    if not folder.is_dir():
        raise InputError(
            "no such folder",
            where=Place(file=str(folder)),
            hint="give a folder of result folders, e.g. reports/SUITE",
        )
    listening = _listening_socket(host, port)
    try:
        here = is_loopback(listening.getsockname()[0])
        asked = token or ("" if here else secrets.token_urlsafe(24))
        app = application(folder, Rules(asked), Watch(folder))
        number = listening.getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        tell(f"http://{shown}:{number}/" + (f"?token={asked}" if asked else ""))
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, server_header=False, ws="none"
        )
        with suppress(
            KeyboardInterrupt
        ):  # how it is ended; uvicorn raises it once it has tidied up
            uvicorn.Server(config).run(sockets=[listening])
    finally:
        listening.close()


def is_loopback(address: str) -> bool:
    """Whether an address is of this machine only."""
    return ipaddress.ip_address(address.partition("%")[0]).is_loopback


def _listening_socket(host: str, port: int) -> socket.socket:
    try:
        family, kind, _, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind)
    except OSError as error:
        raise _unusable(host, port, error) from error
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        raise _unusable(host, port, error) from error
    return listening


def _unusable(host: str, port: int, error: OSError) -> InputError:
    return InputError(
        f"{host} port {port} cannot be listened on ({error.strerror or error})",
        hint="give another --port (0: any that is free) or --host",
    )
