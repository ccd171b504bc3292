"""The recording of a running trial, written by a separate process.

The loop hands a tick over by one small write to a pipe; compressing and writing happen in the
other process, with its own interpreter lock. When the loop's process is killed, the recorder finds
the end of the pipe, notes it in the recording and closes the file.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import struct
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from eha_bench.core.errors import RecordingError
from eha_bench.targets.can.heartbeat import Heartbeat, Silence
from eha_bench.targets.can.recorder_process import LENGTH, REAL_TIME

_PIPE_BYTES = 1 << 20
_CHECK_EVERY = 20
_CLOSE_TIMEOUT = 1.5
"""Seconds that closing a recording may take: a run that has ended leaves within two."""
_END_TIMEOUT = 0.3
_OPEN_TIMEOUT = 30.0
_HINT = "check the disk; what was written can be read"


class Recorder:
    """The loop's end of the pipe; one process for all trials of a run."""

    def __init__(self, *, real_time: bool = False) -> None:
        """Start the process; with `real_time` it gets the lowest SCHED_FIFO priority it may have.

        It needs little of a processor, but on a busy machine an ordinary process may wait longer
        for it than the pipe lasts.
        """
        self._heartbeat = Heartbeat.make()
        shared = self._heartbeat.descriptor
        command = [sys.executable, "-m", "eha_bench.targets.can.recorder_process", str(shared)]
        if real_time:
            command.append(REAL_TIME)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            pass_fds=(shared,),
        )  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in = self._process.stdin.fileno()
        self._out = self._process.stdout
        with suppress(OSError):  # what the kernel gives by default lasts half a second
            fcntl.fcntl(self._in, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._in, False)
        os.set_blocking(self._out.fileno(), False)
        self._row = struct.Struct("<I")
        self._ticks = 0
        self._silence = Silence(time.monotonic())
        self._opened = False
        self._open = False
        self._failure = ""

    @property
    def pid(self) -> int:
        """The process."""
        return self._process.pid

    def open(
        self,
        path: Path,
        channels: Mapping[str, str],
        epoch_ns: int,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
    ) -> None:
        """Begin a recording.

        Args:
            path: its file.
            channels: channel -> SI unit.
            epoch_ns: time zero in ns since 1970.
            metadata: text by key.
            attachments: files by name.
        """
        self._failure = ""
        self._opened = False
        self._row = struct.Struct(f"<I{1 + len(channels)}d")
        files = {name: base64.b64encode(data).decode() for name, data in attachments.items()}
        self._say(
            {
                "path": str(path.resolve()),
                "channels": dict(channels),
                "epoch_ns": epoch_ns,
                "metadata": dict(metadata),
                "attachments": files,
            }
        )
        self._open = True
        # it loads its libraries first: only then can a stall be noticed
        until = time.monotonic() + _OPEN_TIMEOUT
        while not self._failure and not self._opened:
            if not select.select([self._out], [], [], max(until - time.monotonic(), 0.0))[0]:
                self._failure = "the recorder does not answer"
            self._heard()
        self._silence = Silence(time.monotonic())

    def append(self, at: float, values: Sequence[float]) -> None:
        """Add a tick: s since the epoch, SI; takes microseconds.

        Raises:
            RecordingError: the file cannot be written, or the recorder has stalled.
        """
        self._ticks += 1
        if self._failure or (self._ticks % _CHECK_EVERY == 0 and self._heard()):
            raise RecordingError(self._failure, hint="what was written before can be read")
        row = self._row.pack(0, at, *values)
        try:
            # shorter than PIPE_BUF: all of it or nothing
            os.write(self._in, row)
        except BlockingIOError as error:
            self._failure = "the disk does not keep up with the recording"
            raise RecordingError(self._failure) from error
        except OSError as error:
            self._failure = f"the recorder is gone ({error.strerror})"
            raise RecordingError(self._failure) from error
        self.watch()

    def watch(self) -> None:
        """See whether the recorder beats; asked every few milliseconds it finds a stall in 0.1 s.

        Raises:
            RecordingError: it has stalled.
        """
        if not self._open or self._failure:
            return
        silent = self._silence.of(self._heartbeat.count, time.monotonic())
        if silent:
            self._failure = f"the recorder has stalled: no sign of it for {1000 * silent:.0f} ms"
            raise RecordingError(self._failure, hint=_HINT)

    def close(self, metadata: Mapping[str, str]) -> str:
        """End the recording with what is known at its end; return what failed, "" if nothing."""
        if not self._open:
            return self._failure
        self._open = False
        if not self._failure:
            with suppress(RecordingError):
                self._say({"close": dict(metadata)})
        while not self._failure:
            if not select.select([self._out], [], [], _CLOSE_TIMEOUT)[0]:
                self._failure = "the recording could not be closed in time"
            elif not self._heard(closed=True):
                break
        return self._failure

    def stop(self) -> None:
        """End the process."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        try:
            # one that has failed has nothing to bring to its end
            self._process.wait(_END_TIMEOUT if self._failure else _CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            with suppress(subprocess.TimeoutExpired):  # a dead disk keeps even a killed process
                self._process.wait(_END_TIMEOUT)
        self._heartbeat.close()

    def _say(self, what: Mapping[str, Any]) -> None:
        data = json.dumps(what).encode()
        data = LENGTH.pack(len(data)) + data
        try:
            while data:
                if not select.select([], [self._in], [], _CLOSE_TIMEOUT)[1]:
                    raise TimeoutError("the disk does not answer")
                with suppress(BlockingIOError):
                    data = data[os.write(self._in, data[: select.PIPE_BUF]) :]
        except OSError as error:
            self._failure = f"the recorder is gone ({error.strerror})"
            raise RecordingError(self._failure) from error

    def _heard(self, *, closed: bool = False) -> bool:
        """Whether the recorder has reported a failure; `closed` waits for its good-bye."""
        with suppress(OSError):
            line = self._out.readline()
            if line.startswith(b"opened"):
                self._opened = True
            elif line and not line.startswith(b"closed"):
                self._failure = line.decode(errors="replace").strip()
            elif not line and (closed or self._process.poll() is not None):
                self._failure = "the recorder is gone"
        return bool(self._failure)
