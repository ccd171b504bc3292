"""`LiveWriter`: a recording that grows tick by tick and survives whatever stops the run."""

from __future__ import annotations

import os
import struct
import threading
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from eha_bench.core.channels import unit_of
from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings import sample
from eha_bench.recordings.mcap.sink import McapSink
from eha_bench.recordings.sample import NANOSECONDS, WideMessage
from eha_bench.recordings.writer import begin

CHUNK_SIZE = 64 << 10
"""Bytes of a chunk before compression: a larger one would break a 1 kHz deadline when written."""
FLUSH_AFTER = 0.1
"""Seconds after which waiting ticks are written, even if no further tick comes."""


class LiveWriter:
    """Writes ticks as they come; a torn file reads up to its tear.

    Ticks wait in memory until 64 KiB or a tenth of a second are full, then they go to the
    operating system as one small chunk. At most a quarter of a second is at risk when the process
    is killed; with `fsync` also when the power goes.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Mapping[str, str] | Sequence[str],
        *,
        epoch_ns: int,
        metadata: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
        fsync: bool = False,
    ) -> None:
        """Open the file and write all that stands before the first tick.

        Args:
            path: the file; it exists under this name from the start.
            channels: channel -> SI unit, or names of channels that eha_bench knows.
            epoch_ns: time zero in ns since 1970.
            metadata: text by key.
            attachments: files by name.
            fsync: whether the disk is asked to keep every chunk, also against a loss of power.

        Raises:
            RecordingError: the file cannot be written.
        """
        self._path = Path(path)
        units = (
            dict(channels)
            if isinstance(channels, Mapping)
            else {name: unit_of(name) for name in channels}
        )
        self._message = WideMessage.of(sample.checked_units(units, tuple(units)))
        self._epoch = epoch_ns
        self._fsync = fsync
        self._lock = threading.Lock()
        self._closed = False
        self._failure: OSError | None = None
        self._last = -float("inf")
        self._shift: int | None = None
        try:
            self._stream = self._path.open("wb", buffering=0)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            self._sink = McapSink(self._stream)
            self._channel = begin(
                self._sink, self._message, epoch_ns, metadata or {}, attachments or {}
            )
        except OSError as error:
            self._stream.close()
            raise self._unwritable(error) from error
        size = self._message.record.itemsize
        self._rows = max(CHUNK_SIZE // size, 1)
        self._records = self._message.records(self._rows, self._channel)
        self._bytes = self._records.view(np.uint8).data
        self._offsets = np.arange(self._rows, dtype=np.uint64) * np.uint64(size)
        self._size = size
        names: Mapping[str, Any] = self._message.record.fields or {}
        self._head = struct.Struct("<IQQ")
        self._head_at = names["sequence"][1]
        self._stamp = struct.Struct("<II")
        self._stamp_at = names["sec"][1]
        self._values = struct.Struct(f"<{1 + len(units)}d")
        self._values_at = names[sample.TIME][1]
        self._waiting = 0
        self._written = 0
        self._oldest = 0.0
        self._stop = threading.Event()
        self._flusher = threading.Thread(target=self._flush_stale, daemon=True)
        self._flusher.start()

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels, in the order in which `append` takes their values."""
        return self._message.channels

    def __len__(self) -> int:
        """Number of ticks appended."""
        return self._written + self._waiting

    def append(self, time: float, values: Sequence[float]) -> None:
        """Add a tick.

        Args:
            time: s since the epoch, later than the tick before.
            values: one a channel, SI, in the order of `channels`; NaN where nothing was measured.

        Raises:
            RecordingError: the time does not increase, the number of values is wrong, the writer is
                closed, or the disk failed (what was written before stays readable).
        """
        if not time > self._last or self._closed or self._failure is not None:
            raise self._refusal(time)
        stamp = self._stamp_of(time)
        with self._lock:
            start = self._waiting * self._size
            try:
                self._values.pack_into(self._bytes, start + self._values_at, time, *values)
            except struct.error as error:
                raise RecordingError(
                    f"a tick has {len(values)} values for {len(self.channels)} channels",
                    where=Place(file=str(self._path), time=time),
                ) from error
            self._head.pack_into(
                self._bytes, start + self._head_at, len(self) & 0xFFFFFFFF, stamp, stamp
            )
            seconds, rest = divmod(stamp, NANOSECONDS)
            self._stamp.pack_into(self._bytes, start + self._stamp_at, seconds & 0xFFFFFFFF, rest)
            self._last = time
            now = clock.monotonic()
            if not self._waiting:
                self._oldest = now
            self._waiting += 1
            if self._waiting == self._rows or now - self._oldest >= FLUSH_AFTER:
                self._flush()
        if self._failure is not None:
            raise self._unwritable(self._failure)

    def flush(self) -> None:
        """Write what waits.

        Raises:
            RecordingError: the disk failed.
        """
        with self._lock:
            self._flush()
        if self._failure is not None:
            raise self._unwritable(self._failure)

    def settle(self) -> None:
        """Wait until no write is under way; a disk that does not answer is waited for."""
        with self._lock:
            pass

    def add_metadata(self, metadata: Mapping[str, str]) -> None:
        """Add text by key, such as how the run ended; a key that is there is replaced."""
        with self._lock:
            self._flush()
            self._try_to_write(lambda: self._sink.metadata(sample.METADATA, dict(metadata)))

    def close(self) -> None:
        """Write what waits and the index, and close the file; a second call does nothing.

        Raises:
            RecordingError: the disk failed; what was written before stays readable.
        """
        if self._closed:
            return
        self._closed = True
        self._stop.set()
        self._flusher.join()
        with self._lock:
            self._flush()
            self._try_to_write(self._sink.finish)
            if self._fsync:
                self._try_to_write(lambda: os.fsync(self._stream.fileno()))
            with suppress(OSError):
                self._stream.close()
        if self._failure is not None:
            raise self._unwritable(self._failure)

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file; a failing disk does not hide the error that ended the run."""
        try:
            self.close()
        except RecordingError:
            if kind is None:
                raise

    def _stamp_of(self, time: float) -> int:
        relative = round(time * 1e9)
        if self._shift is None:
            # a run without an epoch may start below zero, but a stamp cannot
            self._shift = self._epoch if self._epoch + relative >= 0 else -relative
        stamp = self._shift + relative
        if not 0 <= stamp < 2**63:
            raise RecordingError(
                "the time has no stamp", where=Place(file=str(self._path), time=time)
            )
        return stamp

    def _flush(self) -> None:
        """Write the waiting ticks as a chunk; called with the lock held."""
        count = self._waiting
        if not count:
            return
        self._waiting = 0
        self._written += count
        times = self._records["log_time"][:count]
        self._try_to_write(
            lambda: self._sink.chunk(
                self._bytes[: count * self._size],
                {self._channel: (times, self._offsets[:count])},
                level=1,
            )
        )

    def _try_to_write(self, act: object) -> None:
        """Do something with the file; after a failure nothing more is written."""
        if self._failure is not None or not callable(act):
            return
        try:
            act()
        except OSError as error:
            self._failure = error

    def _flush_stale(self) -> None:
        """Write ticks that wait although no further tick comes, and sync them if asked to."""
        synced = 0
        while not self._stop.wait(FLUSH_AFTER / 2):
            if self._waiting and clock.monotonic() - self._oldest >= FLUSH_AFTER:
                with self._lock:
                    if self._waiting and clock.monotonic() - self._oldest >= FLUSH_AFTER:
                        self._flush()
            if self._fsync and self._written != synced and self._failure is None:
                synced = self._written
                try:
                    os.fsync(self._stream.fileno())
                except OSError as error:
                    self._failure = error

    def _refusal(self, time: float) -> RecordingError:
        where = Place(file=str(self._path), time=time)
        if self._failure is not None:
            return self._unwritable(self._failure)
        if self._closed:
            return RecordingError("the recording is closed", where=where)
        return RecordingError(
            f"the time does not increase (the tick before is at {self._last:.9g} s)", where=where
        )

    def _unwritable(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"cannot be written ({error.strerror or error})",
            where=Place(file=str(self._path)),
            hint="check the disk; what was written before can be read",
        )
