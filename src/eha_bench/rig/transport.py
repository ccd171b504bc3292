"""Where the rig is plugged in: a pseudo-terminal, a socket of this machine, or a CAN bus."""

from __future__ import annotations

import os
import pty
import select
import socket
import tty
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from eha_bench.core.errors import InputError
from eha_bench.rig.slcan import Adapter, frame_as_text
from eha_bench.targets.can.bus import check_channel
from eha_bench.targets.can.drive import Frame
from eha_bench.targets.can.target_file import BusFile

_MOST_BYTES = 8192


class Transport(ABC):
    """A way by which frames come and go; nothing in it ever blocks."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What a bench gives as its channel."""

    @abstractmethod
    def receive(self, timeout: float) -> list[Frame]:
        """Return the frames that have come, after at most `timeout` s."""

    @abstractmethod
    def send(self, frames: list[Frame]) -> None:
        """Send frames in one go; what cannot be sent is lost, as on a bus without a reader."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it."""


class SlcanTransport(Transport):
    """An adapter's side of slcan, on a stream of bytes."""

    def __init__(self) -> None:
        self._adapter = Adapter()

    def send(self, frames: list[Frame]) -> None:
        """Send frames, if a host has opened the channel."""
        if self._adapter.open:
            self._write(b"".join(frame_as_text(frame) for frame in frames))

    def _feed(self, data: bytes) -> list[Frame]:
        """Return the frames in what the host wrote, and answer it."""
        frames, answer = self._adapter.feed(data)
        self._write(answer)
        return frames

    @abstractmethod
    def _write(self, data: bytes) -> None:
        """Write what can be written without waiting."""


class Terminal(SlcanTransport):
    """slcan on a pseudo-terminal, as a USB adapter shows itself."""

    def __init__(self, link: Path | None = None) -> None:
        """Open a terminal, and let `link` point to it."""
        super().__init__()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._name = os.ttyname(self._slave)
        self._link = link
        if link is not None:
            if link.is_symlink():
                link.unlink()
            link.symlink_to(self._name)

    @property
    def name(self) -> str:
        """The terminal, or the link to it."""
        return str(self._link) if self._link is not None else self._name

    def receive(self, timeout: float) -> list[Frame]:
        """Return the frames that have come."""
        if not select.select([self._master], [], [], max(timeout, 0.0))[0]:
            return []
        return self._feed(os.read(self._master, _MOST_BYTES))

    def _write(self, data: bytes) -> None:
        with suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Close the terminal and take the link away."""
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()
        for descriptor in (self._master, self._slave):
            with suppress(OSError):
                os.close(descriptor)


class LoopbackSocket(SlcanTransport):
    """slcan on a TCP port of 127.0.0.1, for pyserial's `socket://`; one host at a time."""

    def __init__(self, port: int) -> None:
        """Listen on a port; 0 takes a free one."""
        super().__init__()
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(
                f"port {port} of 127.0.0.1 is not free ({error.strerror})",
                hint="is another rig running? Give another port, or 0 for any",
            ) from error
        self._listener.listen(1)
        self._listener.setblocking(False)
        self._port = self._listener.getsockname()[1]
        self._host: socket.socket | None = None

    @property
    def name(self) -> str:
        """URL for python-can."""
        return f"socket://127.0.0.1:{self._port}"

    def receive(self, timeout: float) -> list[Frame]:
        """Return the frames that have come; a second host is turned away."""
        watched = [self._listener] + ([self._host] if self._host is not None else [])
        frames: list[Frame] = []
        for ready in select.select(watched, [], [], max(timeout, 0.0))[0]:
            if ready is self._listener:
                self._accept()
            elif self._host is not None:
                frames += self._read(self._host)
        return frames

    def _accept(self) -> None:
        try:
            host, _ = self._listener.accept()
        except OSError:
            return
        if self._host is not None:
            host.close()
            return
        host.setblocking(False)
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._host, self._adapter = host, Adapter()

    def _read(self, host: socket.socket) -> list[Frame]:
        try:
            data = host.recv(_MOST_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._drop()
            return []
        return self._feed(data)

    def _write(self, data: bytes) -> None:
        if self._host is None or not data:
            return
        try:
            self._host.send(data)
        except BlockingIOError:
            pass
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._host is not None:
            self._host.close()
        self._host, self._adapter = None, Adapter()

    def close(self) -> None:
        """Close both sockets."""
        self._drop()
        self._listener.close()


class SocketCan(Transport):
    """A CAN bus of this machine (vcan0, can0 ...), as one more node on it."""

    def __init__(self, channel: str) -> None:
        """Join the bus."""
        import can

        try:
            self._bus = can.Bus(interface="socketcan", channel=channel)
        except Exception as error:
            raise InputError(
                f"the bus '{channel}' cannot be joined ({error})",
                hint="make one: ip link add dev vcan0 type vcan && ip link set vcan0 up",
            ) from error
        self._message: Any = can.Message
        self._channel = channel

    @property
    def name(self) -> str:
        """The network interface."""
        return self._channel

    def receive(self, timeout: float) -> list[Frame]:
        """Return the frames that have come."""
        frames: list[Frame] = []
        wait = max(timeout, 0.0)
        while len(frames) < 100 and (message := self._bus.recv(wait)) is not None:
            wait = 0.0
            if not message.is_error_frame:
                data = bytes(message.data)
                frames.append(Frame(message.arbitration_id, data, message.is_extended_id))
        return frames

    def send(self, frames: list[Frame]) -> None:
        """Send frames."""
        with suppress(Exception):
            for frame in frames:
                self._bus.send(
                    self._message(
                        arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended
                    )
                )

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


def open_transport(where: str, bus: BusFile) -> Transport:
    """Return the transport that a text stands for.

    Args:
        where: `pty`, `pty:LINK`, `socket://127.0.0.1:PORT` or `socketcan:INTERFACE`; "" for
            what the target file's `bus` says.
        bus: of the target file.

    Raises:
        InputError: neither of these, or it cannot be opened.
        TargetFault: it is not on this machine.
    """
    if not where:
        where = f"socketcan:{bus.channel}" if bus.interface == "socketcan" else bus.channel
    if where == "pty" or where.startswith("pty:"):
        link = where.partition(":")[2]
        return Terminal(Path(link) if link else None)
    if where.startswith("socketcan:"):
        return SocketCan(where.partition(":")[2])
    check_channel(BusFile(interface="slcan", channel=where))
    if where.startswith("socket://"):
        return LoopbackSocket(urlsplit(where).port or 0)
    raise InputError(
        f"the rig cannot be reached at '{where}'",
        hint="give pty, pty:LINK, socket://127.0.0.1:PORT or socketcan:INTERFACE",
    )
