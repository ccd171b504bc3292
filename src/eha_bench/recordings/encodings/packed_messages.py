"""Messages that rosbag2 compressed one by one with zstd, as plain ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eha_bench.core.arrays import IndexArray
from eha_bench.recordings.decompress import decompress_blob
from eha_bench.recordings.encodings.payloads import Payloads

_MAGIC = 0xFD2FB528


def are_packed(payloads: Payloads) -> bool:
    """Whether messages start as a zstd frame does; no CDR message starts like that."""
    return payloads.size > 4 and payloads.count > 0 and payloads.column(0, "<u4")[0] == _MAGIC


def unpacked_messages(payloads: Payloads) -> Iterator[tuple[IndexArray, Payloads]]:
    """Yield the messages decompressed, those of one size together, and which ones they are.

    Raises:
        DamagedChunk: one of them cannot be decompressed.
    """
    plain = [decompress_blob(bytes(payloads.payload(row))) for row in range(payloads.count)]
    sizes = np.fromiter(map(len, plain), np.intp, len(plain))
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        buffer = np.frombuffer(b"".join(plain[row] for row in rows.tolist()), dtype=np.uint8)
        yield rows, Payloads(buffer, int(rows.size), size, 0, size)
