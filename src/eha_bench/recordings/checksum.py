"""CRC-32, by the fastest implementation that is there."""

from __future__ import annotations

try:
    from zlib_ng.zlib_ng import crc32
except ImportError:  # there are no wheels for every machine
    from zlib import crc32

__all__ = ["crc32"]
