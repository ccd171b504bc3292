"""A file's bytes as an array, read by the system when they are looked at."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.arrays import Bytes

_AROUND = 1 << 16
"""So many bytes around one that is looked at the system reads as well."""


def map_file(path: Path) -> Bytes:
    """Return a file's bytes without reading them."""
    with path.open("rb") as stream:
        if not path.stat().st_size:
            return np.empty(0, dtype=np.uint8)
        return np.frombuffer(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ), dtype=np.uint8)


def forget(buffer: Bytes, start: int, stop: int) -> None:
    """Give back the memory of bytes of a mapped file; they are read again if they are looked at.

    Without it a long file would stay in memory as far as it was read.
    """
    view: Any = buffer.base
    mapped = view.obj if isinstance(view, memoryview) else None
    if start < stop and isinstance(mapped, mmap.mmap) and hasattr(mapped, "madvise"):
        first = max(start - _AROUND, 0) // mmap.PAGESIZE * mmap.PAGESIZE
        mapped.madvise(mmap.MADV_DONTNEED, first, min(stop + _AROUND, buffer.size) - first)
