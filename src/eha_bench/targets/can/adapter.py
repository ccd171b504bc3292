"""Which adapter a target's bus leads to, under whatever name it is written."""

from __future__ import annotations

import os
import re
import socket
import stat
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from eha_bench.targets.can.target_file import BusFile

_SOCKETCAN = ("socketcan", "socketcan_native", "socketcan_ctypes", "socketcand")


def adapter_of(file: BusFile) -> str:
    """Return one name for one adapter: links, relative paths and other names of a host lead to it.

    A device is known by its number, a port of this machine by its number (another machine's is
    refused elsewhere), a network interface by its index, anything else by what is written.
    """
    channel = file.channel.strip()
    if "://" in channel:
        parts = urlsplit(channel)
        with suppress(ValueError):
            if parts.port is not None:
                return f"tcp-{parts.port}"
        return _plain(f"{parts.scheme}-{parts.netloc}{parts.path}")
    # python-can's slcan takes `port@baudrate`
    for path in (Path(channel), Path(channel.partition("@")[0])):
        with suppress(OSError, ValueError):
            found = path.stat()
            if stat.S_ISCHR(found.st_mode):
                return f"device-{os.major(found.st_rdev)}-{os.minor(found.st_rdev)}"
            return f"file-{found.st_dev}-{found.st_ino}"
    if file.interface.lower() in _SOCKETCAN:
        with suppress(OSError):
            return f"can-{socket.if_nametoindex(channel)}"
    return _plain(f"{file.interface}-{channel}")


def _plain(text: str) -> str:
    return re.sub(r"[^a-z0-9_-]+", "_", text.lower())[:80]
