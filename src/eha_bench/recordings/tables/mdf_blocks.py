"""How many bytes of samples the data blocks of an MDF 4 file hold, by the blocks themselves.

A library reads as many samples as a channel group declares; what lies beyond that count it passes
over. Blocks as in ASAM MDF 4.1: a header of identifier, length and number of links, then the links.
"""

from __future__ import annotations

import mmap
import struct
from typing import Final

from eha_bench.recordings.budget import budget

_HEAD: Final = struct.Struct("<4s4xQQ")
_LINK: Final = struct.Struct("<Q")
_UNPACKED: Final = struct.Struct("<2sBxIQ")
"""Of a compressed block: original type, method, its parameter, length once decompressed."""


def stored_bytes(content: mmap.mmap | bytes, address: int) -> int | None:
    """Return how many bytes of samples lie behind a data link; None where it cannot be followed."""
    total = 0
    seen: set[int] = set()
    waiting = [address]
    while waiting:
        budget().tick()
        place = waiting.pop()
        if not place:
            continue
        if place in seen or place + _HEAD.size > len(content):
            return None
        seen.add(place)
        kind, length, links = _HEAD.unpack_from(content, place)
        body = place + _HEAD.size
        if kind == b"##DT":
            total += max(length - _HEAD.size, 0)
        elif kind == b"##DZ" and body + _UNPACKED.size <= len(content):
            original, _, _, size = _UNPACKED.unpack_from(content, body)
            if original != b"DT":
                return None
            total += size
        elif kind in (b"##DL", b"##HL") and body + links * _LINK.size <= len(content):
            waiting += [link for (link,) in _LINK.iter_unpack(content[body : body + 8 * links])]
        else:
            return None
    return total
