"""A file's bytes as an array, read by the system when they are looked at."""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np

from eha_bench.recordings.encodings.payloads import Bytes


def map_file(path: Path) -> Bytes:
    """Return a file's bytes without reading them."""
    with path.open("rb") as stream:
        if not path.stat().st_size:
            return np.empty(0, dtype=np.uint8)
        return np.frombuffer(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ), dtype=np.uint8)
