"""The bus through python-can: frames out, frames in, and every failure as a lost bus."""

from __future__ import annotations

import fcntl
import os
import select
import socket
import stat
import termios
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from eha_bench.core.errors import TargetFault
from eha_bench.core.extras import way_to_install
from eha_bench.targets.can.drive import Frame
from eha_bench.targets.can.target_file import BusFile

if TYPE_CHECKING:
    import can

_LOOPBACK = ("127.0.0.1", "localhost", "::1", "[::1]")
_SEND_TIMEOUT = 0.05
_MOST_MALFORMED = 100
"""Lines in a row that are not frames after which others get their turn."""
_LONGEST_LINE = 256


class BusLost(TargetFault):
    """The bus or its adapter does not answer any more."""


class Bus:
    """A CAN bus; closed more than once without harm.

    Attributes:
        malformed: lines of the adapter that were no frames, and were left out.
    """

    def __init__(self, file: BusFile) -> None:
        """Open the bus.

        Raises:
            BusLost: the adapter cannot be opened.
            TargetFault: a channel that would leave this machine by the network.
        """
        self._name = f"{file.interface} {file.channel}"
        check_channel(file)
        try:
            import can
        except ImportError as error:
            raise TargetFault(
                "CAN needs the packages python-can and pyserial",
                hint=way_to_install("can"),
            ) from error
        options: dict[str, Any] = {"bitrate": file.bitrate, **file.options}
        if file.interface == "slcan":
            options.setdefault("sleep_after_open", 0.05)
        try:
            self._bus = can.Bus(interface=file.interface, channel=file.channel, **options)
        except Exception as error:  # python-can's drivers raise what their libraries raise
            raise BusLost(
                f"the bus {self._name} cannot be opened ({_first(error)})",
                hint="check the adapter and `bus:` in the target; `eha-bench rig` plays a drive",
            ) from error
        self.malformed = 0
        self._message = can.Message
        self._port: _BufferedPort | None = None
        serial_port = getattr(self._bus, "serialPortOrig", None)
        if serial_port is not None:
            self._take_alone(serial_port)
            self._port = _BufferedPort(serial_port)
            self._bus.serialPortOrig = self._port  # type: ignore[attr-defined]  # slcan only
        self._closed = False

    @property
    def name(self) -> str:
        """Interface and channel, for people."""
        return self._name

    def send(self, frame: Frame) -> None:
        """Send a frame.

        Raises:
            BusLost: it cannot be sent.
        """
        try:
            self._bus.send(
                self._message(
                    arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended
                ),
                timeout=_SEND_TIMEOUT,
            )
        except Exception as error:
            raise self._loss_error(error) from error

    def receive(self, timeout: float) -> can.Message | None:
        """Return the next frame, or None where none comes within `timeout` s.

        Raises:
            BusLost: the adapter is gone.
        """
        if self._port is not None:
            self._port.wait = max(timeout, 0.0)
        for _ in range(_MOST_MALFORMED):
            try:
                message = self._bus.recv(timeout)
            except Exception as error:
                if not self._is_malformed(error):
                    raise self._loss_error(error) from error
                # noise on the port, or a line that was cut short: the next one may be whole
                self.malformed += 1
                timeout = 0.0
                continue
            if message is None or message.is_error_frame:
                return None
            if message.is_remote_frame or len(message.data) == message.dlc:
                return message
            self.malformed += 1
            timeout = 0.0
        return None

    def _is_malformed(self, error: Exception) -> bool:
        """Whether a line of a serial adapter is not a frame; what was read of it is forgotten."""
        kinds = (ValueError, IndexError, KeyError)
        if self._port is None or not any(isinstance(e, kinds) for e in (error, error.__cause__)):
            return False
        buffer = getattr(self._bus, "_buffer", None)
        if isinstance(buffer, bytearray):
            buffer.clear()
        return True

    def _take_alone(self, port: Any) -> None:
        """Lock a serial port while this bus has it open.

        Raises:
            BusLost: another process has it already.
        """
        descriptor = port.fileno()
        if not os.isatty(descriptor):
            return
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
        except OSError as error:
            with suppress(Exception):
                self._bus.shutdown()
            raise BusLost(
                f"the port {self._name} is in use by another program",
                hint="close the other program: two never share an adapter",
            ) from error

    def close(self) -> None:
        """Close the bus."""
        if not self._closed:
            self._closed = True
            with suppress(Exception):
                self._bus.shutdown()

    def _loss_error(self, error: Exception) -> BusLost:
        return BusLost(
            f"the bus {self._name} is lost ({_first(error)})",
            hint="check the adapter, its cable and the drive's supply",
        )


def check_channel(file: BusFile) -> None:
    """Refuse a channel that leaves this machine: a drive is never driven over a network.

    Raises:
        TargetFault: it does.
    """
    if file.interface == "udp_multicast":
        raise TargetFault(
            "udp_multicast frames leave this machine, and any machine may send them",
            hint="use slcan, socketcan or another adapter of this machine",
        )
    if "://" not in file.channel:
        return
    parts = urlsplit(file.channel)
    if parts.scheme == "socket" and parts.hostname in _LOOPBACK:
        return
    raise TargetFault(
        f"'{file.channel}' is not on this machine",
        hint="a network cannot keep a drive safe: give a port, a device or socket://127.0.0.1:PORT",
    )


def _first(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


class _BufferedPort:
    """A serial port that python-can's slcan reads byte by byte: here from memory.

    One system call fetches all that waits, where pyserial needs two for every byte: at 1 kHz the
    difference between a tenth of the period and more than all of it.

    Attributes:
        wait: how long `read` waits for the first byte, s.
    """

    def __init__(self, port: Any) -> None:
        self._port = port
        self._descriptor = port.fileno()
        self._buffer = b""
        self._place = 0
        self._endless = 0
        self.wait = 0.0
        self.write_timeout: float | None = None
        if stat.S_ISSOCK(os.fstat(self._descriptor).st_mode):
            # a small frame must not wait until the one before is acknowledged
            with socket.socket(fileno=os.dup(self._descriptor)) as connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def in_waiting(self) -> int:
        """Bytes in memory, or 0 where the port has to be asked."""
        return len(self._buffer) - self._place

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes; none where nothing comes within `wait`."""
        if self._place >= len(self._buffer):
            if not select.select([self._descriptor], [], [], self.wait)[0]:
                return b""
            self._buffer, self._place = os.read(self._descriptor, 4096), 0
            if not self._buffer:
                raise ConnectionError("the adapter closed the connection")
            self._endless += 1 + len(self._buffer) if b"\r" not in self._buffer else -self._endless
            if self._endless > _LONGEST_LINE:
                self._endless, self._buffer = 0, b"\r"  # a line without an end ends here
        start = self._place
        self._place = start + size
        return self._buffer[start : self._place]

    def write(self, data: bytes) -> int:
        """Write all of the data, or fail within the timeout."""
        sent = 0
        while sent < len(data):
            try:
                sent += os.write(self._descriptor, data[sent:])
            except BlockingIOError:
                wait = _SEND_TIMEOUT if self.write_timeout is None else self.write_timeout
                if not select.select([], [self._descriptor], [], wait)[1]:
                    raise TimeoutError("the adapter takes no more data") from None
        return sent

    def flush(self) -> None:
        """Nothing waits here: every frame is written at once."""

    def reset_input_buffer(self) -> None:
        """Forget what has come."""
        self._buffer, self._place = b"", 0
        self._port.reset_input_buffer()

    def fileno(self) -> int:
        """The port's descriptor."""
        return int(self._descriptor)

    def close(self) -> None:
        """Close the port."""
        self._port.close()
