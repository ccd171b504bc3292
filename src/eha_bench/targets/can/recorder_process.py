"""The recorder's process: takes ticks from a pipe and writes them.

On the pipe: `<u32 length>` and a JSON object open or close a recording, `0` and a tick of
1 + n doubles add to it. While it takes them or waits for them, the process beats in memory that it
shares with the loop; held up by a disk or by anything else, it does not, and the loop sees that.
"""

from __future__ import annotations

import base64
import json
import os
import select
import signal
import struct
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from eha_bench.core.errors import EhaBenchError, RecordingError
from eha_bench.targets.can.heartbeat import BEAT_EVERY, Heartbeat

if TYPE_CHECKING:
    from eha_bench.recordings import LiveWriter

LENGTH: Final = struct.Struct("<I")
"""What stands before each order."""
REAL_TIME: Final = "--real-time"
"""Asks for the lowest priority of SCHED_FIFO."""
_READ: Final = 1 << 16


class _Orders:
    """What comes on the pipe."""

    def __init__(self, descriptor: int, alive: Callable[[], None]) -> None:
        self._descriptor = descriptor
        self._alive = alive
        self._held = bytearray()

    def read(self, size: int) -> bytes:
        """Return `size` bytes, fewer at the end; `alive` is called again and again until then."""
        self._alive()
        while len(self._held) < size:
            if select.select([self._descriptor], [], [], BEAT_EVERY)[0]:
                data = os.read(self._descriptor, _READ)
                if not data:
                    break
                self._held += data
            self._alive()
        taken = bytes(self._held[:size])
        del self._held[:size]
        return taken


class _Writing:
    """The recording that is written, if there is one."""

    def __init__(self, answers: BinaryIO) -> None:
        self._answers = answers
        self._writer: LiveWriter | None = None
        self.row = struct.Struct("<d")

    def settle(self) -> None:
        """Wait for a write that is under way."""
        if self._writer is not None:
            self._writer.settle()

    def open(self, order: Mapping[str, Any]) -> None:
        """Begin a recording."""
        from eha_bench.recordings import LiveWriter

        self.row = struct.Struct(f"<{1 + len(order['channels'])}d")
        files = {name: base64.b64decode(text) for name, text in order["attachments"].items()}
        try:
            self._writer = LiveWriter(
                order["path"],
                order["channels"],
                epoch_ns=order["epoch_ns"],
                metadata=order["metadata"],
                attachments=files,
            )
            self.answer("opened")
        except RecordingError as error:
            self._answer_failure(error)

    def append(self, data: bytes) -> None:
        """Add a tick."""
        if self._writer is None:
            return
        time, *values = self.row.unpack(data)
        try:
            self._writer.append(time, values)
        except RecordingError as error:
            self._answer_failure(error)
            with suppress(RecordingError):
                self._writer.close()
            self._writer = None

    def close(self, metadata: Mapping[str, str]) -> None:
        """End the recording."""
        if self._writer is None:
            return
        closing, self._writer = self._writer, None
        try:
            closing.add_metadata(metadata)
            closing.close()
        except RecordingError as error:
            self._answer_failure(error)

    def answer(self, line: str) -> None:
        """Tell the loop; it may be gone."""
        with suppress(OSError):
            self._answers.write(f"{line}\n".encode())
            self._answers.flush()

    def _answer_failure(self, error: EhaBenchError) -> None:
        self.answer(" ".join(str(error).split()))


def serve(descriptor: int, answers: BinaryIO, beat: Callable[[], None]) -> None:
    """Write what comes on a pipe until it ends; say `closed`, or what failed, on `answers`.

    Args:
        descriptor: the pipe.
        answers: takes a line an answer.
        beat: called every few milliseconds as long as nothing holds up the writing.
    """
    writing = _Writing(answers)

    def alive() -> None:
        writing.settle()
        beat()

    orders = _Orders(descriptor, alive)
    while True:
        head = orders.read(LENGTH.size)
        if len(head) < LENGTH.size:
            break
        (length,) = LENGTH.unpack(head)
        size = length or writing.row.size
        data = orders.read(size)
        if len(data) < size:
            break
        if not length:
            writing.append(data)
            continue
        order = json.loads(data)
        if "close" in order:
            writing.close(order["close"])
            writing.answer("closed")
        else:
            writing.open(order)
    writing.close(
        {"ending": "fault", "ending_reason": "the bench ended without closing the recording"}
    )


def main() -> None:
    """Entry point of the process: a Ctrl-C is the loop's business, its end comes by the pipe."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if REAL_TIME in sys.argv:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    serve(sys.stdin.fileno(), sys.stdout.buffer, Heartbeat(int(sys.argv[1])).beat)


if __name__ == "__main__":
    main()
