"""Decompression with a limit: what a file declares is checked before memory is taken."""

from __future__ import annotations

import bz2
from typing import Any

import lz4.frame
import numpy as np
import zstandard

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.budget import ReadingBudget, budget
from eha_bench.recordings.checksum import crc32

_RATIO = {"zstd": 40_000, "lz4": 256, "bz2": 50_000, "": 1, "none": 1}
_PIECE = 256
"""Bytes of a torn chunk that are decompressed at a time: they may hold ten million."""


class DamagedChunk(Exception):
    """A chunk cannot be decompressed; says why."""


class DecompressBuffer:
    """Memory that one chunk after the other is decompressed into."""

    def __init__(self) -> None:
        self._memory: Bytes = np.empty(0, dtype=np.uint8)

    def take(self, size: int) -> Bytes:
        """Return `size` bytes; what was in them is overwritten."""
        if size > self._memory.size:
            self._memory = np.empty(size, dtype=np.uint8)
        return self._memory[:size]


def decompress(
    data: memoryview,
    compression: str,
    size: int,
    crc: int = 0,
    room: DecompressBuffer | None = None,
    allowed: ReadingBudget | None = None,
) -> Bytes:
    """Return a chunk's `size` bytes, checked against `crc` (0 means there is none).

    They may be in `room`, where the next chunk overwrites them.

    Raises:
        DamagedChunk: unknown compression, a size that cannot be, damaged data, or a wrong CRC.
        OverBudget: it is larger than the recording may take.
    """
    if compression not in _RATIO:
        raise DamagedChunk(f"its compression '{compression[:20]}' is not known")
    if size > (len(data) + 64) * _RATIO[compression]:
        raise DamagedChunk(f"it declares {size} bytes, which {len(data)} bytes cannot hold")
    if compression:
        allowed = allowed or budget()
        allowed.hold(size, "a chunk")
        allowed.tick()
    try:
        raw = _whole(data, compression, size, room)
    except (zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError) as error:
        raise DamagedChunk(f"it cannot be decompressed ({error})") from error
    if len(raw) != size:
        raise DamagedChunk(f"it holds {len(raw)} bytes where {size} are declared")
    if crc and crc32(raw) != crc:
        raise DamagedChunk("its checksum is wrong")
    return np.frombuffer(raw, dtype=np.uint8)


def decompress_torn(
    data: memoryview, compression: str, allowed: ReadingBudget | None = None
) -> Bytes:
    """Return what can be had of a chunk whose end is missing.

    Raises:
        OverBudget: it is larger than the recording may take.
    """
    if compression in {"", "none"}:
        return np.frombuffer(data, dtype=np.uint8)
    if compression not in _RATIO:
        return np.empty(0, dtype=np.uint8)
    stream = _stream(compression)
    allowed = allowed or budget()
    parts: list[bytes] = []
    total = 0
    for start in range(0, len(data), _PIECE):
        try:
            part = stream.decompress(data[start : start + _PIECE])
        except (zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError):
            break
        total += len(part)
        parts.append(part)
        allowed.hold(2 * total, "a torn chunk")
        allowed.tick()
    return np.frombuffer(b"".join(parts), dtype=np.uint8)


def _whole(data: memoryview, compression: str, size: int, room: DecompressBuffer | None) -> Any:
    if compression in {"", "none"}:
        return data
    if not size:
        return b""
    if compression == "zstd":
        declared = zstandard.frame_content_size(data)
        if declared == size and room is None:
            return zstandard.ZstdDecompressor().decompress(data)
        if declared == size and room is not None:
            memory = room.take(size)
            with zstandard.ZstdDecompressor().stream_reader(data, read_size=len(data)) as reader:
                return memory[: reader.readinto(memory)]
        if declared >= 0:
            raise DamagedChunk(f"its frame holds {declared} bytes where {size} are declared")
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            whole = reader.read(size)
            if reader.read(1):
                raise _more(size)
            return whole
    stream = _stream(compression)
    whole = stream.decompress(data, max_length=size)
    if not stream.eof and (stream.decompress(b"", max_length=1) or not stream.needs_input):
        raise _more(size)
    return whole


def _more(size: int) -> DamagedChunk:
    return DamagedChunk(f"it holds more than the {size} bytes that are declared")


def _stream(compression: str) -> Any:
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj()
    return lz4.frame.LZ4FrameDecompressor() if compression == "lz4" else bz2.BZ2Decompressor()


def decompress_blob(data: bytes) -> bytes:
    """Return one message that is compressed with zstd.

    Raises:
        DamagedChunk: it cannot be decompressed.
    """
    try:
        size = zstandard.frame_content_size(data)
        if size < 0:
            return decompress_torn(memoryview(data), "zstd").tobytes()
    except zstandard.ZstdError as error:
        raise DamagedChunk(f"it cannot be decompressed ({error})") from error
    return decompress(memoryview(data), "zstd", size).tobytes()
