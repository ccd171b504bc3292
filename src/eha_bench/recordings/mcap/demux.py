"""Splits the records of a stretch of MCAP into messages by channel, many at a time.

Rigs write the same topics in the same order every tick. So records are walked one by one only
until their sizes and channels repeat; then the whole run of repetitions is checked and taken as
one strided array a topic. The cycle that was found is tried first in the next chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import Bytes
from eha_bench.recordings.budget import ReadingBudget
from eha_bench.recordings.encodings.payloads import Payloads

MESSAGE = 5
RECORD_HEAD = 9
MESSAGE_HEAD = 22
PAYLOAD = RECORD_HEAD + MESSAGE_HEAD
LOG_TIME = -16
PUBLISH_TIME = -8
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQH")
_LONGEST_PERIOD = 256
_FEWEST_CYCLES = 4
_PATIENCE = 128
_MOST_WALKED = 1 << 14
_CHECKED = 4096
"""Records that are compared at one go: few enough to stay in the processor's cache."""

Cycle = tuple[tuple[int, int], ...]
"""(length, channel) of records that follow each other again and again."""
Index = Callable[[], Mapping[int, NDArray[np.int64]]]
"""Gives the starts of the records by channel."""


@dataclass
class Split:
    """What a stretch of records holds.

    Attributes:
        buffer: the bytes that everything else points into.
        messages: (channel id, payloads) in order of their first message.
        others: (opcode, start of the content, length) of every record that is not a message.
        end: where the last whole record ends.
        chunk: the chunk that the buffer is the content of, None for a part of the file itself.
    """

    buffer: Bytes
    messages: list[tuple[int, Payloads]] = field(default_factory=list)
    others: list[tuple[int, int, int]] = field(default_factory=list)
    end: int = 0
    chunk: object = None

    @property
    def whole(self) -> bool:
        """Whether every byte of the buffer belongs to a record."""
        return self.end == self.buffer.size


@dataclass
class _Walked:
    """Records that were walked one by one, without a break: (length, channel), and the start."""

    kinds: list[tuple[int, int]] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)

    def clear(self) -> None:
        """Forget them."""
        self.kinds.clear()
        self.starts.clear()


class Splitter:
    """Splits one stretch after the other; remembers the cycle of the one before."""

    def __init__(self) -> None:
        self._cycle: Cycle = ()

    def split(
        self,
        buffer: Bytes,
        start: int,
        stop: int,
        index: Index | None = None,
        allowed: ReadingBudget | None = None,
    ) -> Split:
        """Return the records of buffer[start:stop]; ends early at one that does not fit.

        Args:
            buffer: bytes.
            start: where the first record starts.
            stop: where the last record must end at the latest.
            index: gives where each channel's messages are declared to start; it is used only where
                the records agree and there is no cycle.
            allowed: budget of the recording.

        Raises:
            OverBudget: there are too many records that do not repeat.
        """
        found = Split(buffer, end=start)
        data = buffer.data
        position = start
        walked = _Walked()
        look = 2
        while position + RECORD_HEAD <= stop:
            if not walked.kinds and self._cycle:
                position += _take(found, buffer, self._cycle, position, stop)
                if position + RECORD_HEAD > stop:
                    break
            opcode, length = _RECORD.unpack_from(data, position)
            following = position + RECORD_HEAD + length
            if following > stop or opcode == 0 or (opcode == MESSAGE and length < MESSAGE_HEAD):
                break
            if opcode != MESSAGE:
                found.others.append((opcode, position + RECORD_HEAD, length))
                position = following
                _flush(found, walked)
                look = 2
                continue
            walked.kinds.append((length, _MESSAGE.unpack_from(data, position)[2]))
            walked.starts.append(position)
            position = following
            if len(walked.kinds) == look:
                taken = self._repeat(found, walked, stop)
                position = taken or position
                look = 2 if taken else min(look * 2, look + 2 * _LONGEST_PERIOD)
                if not taken and index is not None and look > _PATIENCE:
                    indexed = _split_by_index(buffer, start, stop, index())
                    if indexed is not None:
                        return indexed
                    index = None
            if len(walked.kinds) >= _MOST_WALKED:
                # one by one they take many times the memory that they take as an array
                _flush(found, walked)
                look = 2
                if allowed is not None:
                    allowed.tick()
        _flush(found, walked)
        found.end = position
        return found

    def _repeat(self, found: Split, walked: _Walked, stop: int) -> int:
        """Take the repetitions that the last walked records began; return where they end, or 0."""
        kinds = walked.kinds
        period = _period(kinds)
        if not period:
            return 0
        first = len(kinds) - 2 * period
        while first and kinds[first - 1] == kinds[first - 1 + period]:
            first -= 1
        cycle = tuple(kinds[first : first + period])
        start = walked.starts[first]
        fresh = Split(found.buffer)
        taken = _take(fresh, found.buffer, cycle, start, stop)
        step = sum(length + RECORD_HEAD for length, _ in cycle)
        if taken < _FEWEST_CYCLES * step or start + taken < walked.starts[-1]:
            return 0
        _flush(found, _Walked(kinds[:first], walked.starts[:first]))
        walked.clear()
        found.messages += fresh.messages
        self._cycle = cycle
        return start + taken


def _period(kinds: list[tuple[int, int]]) -> int:
    """Return the shortest number of records after which the last ones repeat, or 0."""
    for period in range(1, min(len(kinds) // 2, _LONGEST_PERIOD) + 1):
        if kinds[-1] == kinds[-1 - period] and kinds[-period:] == kinds[-2 * period : -period]:
            return period
    return 0


def _split_by_index(
    buffer: Bytes, start: int, stop: int, index: Mapping[int, NDArray[np.int64]]
) -> Split | None:
    """Return the records by their index, or None unless it names every message there is.

    Records must follow each other without a break from `start` to `stop`; where the index leaves
    something out, only records that are not messages may stand there.
    """
    if not index:
        return None
    channels = np.concatenate([np.full(starts.size, number) for number, starts in index.items()])
    starts = np.concatenate(list(index.values()))
    order = np.argsort(starts, kind="stable")
    starts, channels = starts[order], channels[order]
    if not starts.size or starts[0] < start or starts[-1] + PAYLOAD > stop:
        return None
    heads = Payloads(buffer, starts.size, 0, starts=starts)
    lengths = heads.column(1, "<i8")
    if (
        (heads.column(0, "<u1") != MESSAGE).any()
        or (heads.column(RECORD_HEAD, "<u2") != channels).any()
        or ((lengths < MESSAGE_HEAD) | (lengths > stop)).any()
    ):
        return None
    ends = starts + lengths + RECORD_HEAD
    found = Split(buffer)
    edges = np.concatenate(([start], ends))
    nexts = np.concatenate((starts, [stop]))
    for gap in np.flatnonzero(edges != nexts).tolist():
        others = _others(buffer, int(edges[gap]), int(nexts[gap]))
        if others is None:
            return None
        found.others += others
    for number in index:
        for length in np.unique(lengths[channels == number]).tolist():
            rows = (channels == number) & (lengths == length)
            found.messages.append(
                (
                    number,
                    Payloads(
                        buffer,
                        int(np.count_nonzero(rows)),
                        length - MESSAGE_HEAD,
                        starts=starts[rows] + PAYLOAD,
                    ),
                )
            )
    found.end = stop
    return found


def _others(buffer: Bytes, start: int, stop: int) -> list[tuple[int, int, int]] | None:
    """Return records that are not messages and fill buffer[start:stop] wholly, or None."""
    found = []
    while start < stop:
        if start + RECORD_HEAD > stop:
            return None
        opcode, length = _RECORD.unpack_from(buffer.data, start)
        if opcode in (0, MESSAGE) or start + RECORD_HEAD + length > stop:
            return None
        found.append((opcode, start + RECORD_HEAD, length))
        start += RECORD_HEAD + length
    return found if start == stop else None


def _take(found: Split, buffer: Bytes, cycle: Cycle, start: int, stop: int) -> int:
    """Take all repetitions of a cycle from `start` on; return their bytes."""
    step = sum(length + RECORD_HEAD for length, _ in cycle)
    most = (stop - start) // step
    count = 0
    block, larger = 16, max(_CHECKED // len(cycle), 16)
    while count < most:
        tried = min(block, most - count)
        same = _same(buffer, start + count * step, step, cycle, tried)
        count += same
        if same < tried:
            break
        block = larger
    if not count:
        return 0
    offset = start + PAYLOAD
    for length, channel in cycle:
        payloads = Payloads(buffer, count, length - MESSAGE_HEAD, offset, step)
        found.messages.append((channel, payloads))
        offset += length + RECORD_HEAD
    return count * step


def _same(buffer: Bytes, start: int, step: int, cycle: Cycle, count: int) -> int:
    """Return how many cycles from `start` have the expected opcodes, lengths and channels."""
    lengths = {length for length, _ in cycle}
    if len(lengths) == 1 and len(cycle) > 1:
        # records of one length: look at all of them at once
        stride = step // len(cycle)
        head = np.ndarray((count * len(cycle),), "<u8", buffer.data, start, (stride,))
        equal = head == (MESSAGE | lengths.pop() << 8)
        channels = np.ndarray(equal.shape, "<u4", buffer.data, start + 7, (stride,))
        equal &= channels == _pattern(cycle, count)
        if np.count_nonzero(equal) != equal.size:
            count = int(np.argmin(equal)) // len(cycle)
        return count
    heads = [_MESSAGE.pack(MESSAGE, length, channel) for length, channel in cycle]
    offset = start
    for (length, _), wanted in zip(cycle, heads, strict=True):
        for delta, code in ((0, "<u8"), (7, "<u4")):
            column = np.ndarray((count,), code, buffer.data, offset + delta, (step,))
            equal = column == np.frombuffer(wanted, code, 1, delta)[0]
            if np.count_nonzero(equal) != count:
                count = int(np.argmin(equal))
                if not count:
                    return 0
        offset += length + RECORD_HEAD
    return count


def _pattern(cycle: Cycle, count: int) -> NDArray[np.uint32]:
    """Return the upper two bytes of the length, and the channel, of `count` cycles of records."""
    heads = b"".join(_MESSAGE.pack(MESSAGE, length, channel)[7:] for length, channel in cycle)
    return np.tile(np.frombuffer(heads, "<u4"), count)


def _flush(found: Split, walked: _Walked) -> None:
    """Turn records that did not repeat into groups of one channel and length."""
    groups: dict[tuple[int, int], list[int]] = {}
    for (length, channel), start in zip(walked.kinds, walked.starts, strict=True):
        groups.setdefault((channel, length), []).append(start + PAYLOAD)
    for (channel, length), starts in groups.items():
        where = np.array(starts, dtype=np.int64)
        found.messages.append(
            (channel, Payloads(found.buffer, len(starts), length - MESSAGE_HEAD, starts=where))
        )
    walked.clear()
