"""Splits the records of a stretch of MCAP into messages by channel, many at a time.

Rigs write the same topics in the same order every tick. So records are walked one by one only
until their sizes and channels repeat; then the whole run of repetitions is checked and taken as
one strided array.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from eha_bench.recordings.payloads import Bytes, Payloads

MESSAGE = 5
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQH")
RECORD_HEAD = 9
MESSAGE_HEAD = 22
PAYLOAD = RECORD_HEAD + MESSAGE_HEAD
LOG_TIME = -16
PUBLISH_TIME = -8
_LONGEST_PERIOD = 256
_FIRST_LOOK = 2


@dataclass
class Split:
    """What a stretch of records holds.

    Attributes:
        buffer: the bytes that everything else points into.
        messages: (channel id, payloads) in order of their first message.
        others: (opcode, start of the content, length) of every record that is not a message.
        end: where the last whole record ends.
    """

    buffer: Bytes
    messages: list[tuple[int, Payloads]] = field(default_factory=list)
    others: list[tuple[int, int, int]] = field(default_factory=list)
    end: int = 0


def split(buffer: Bytes, start: int, stop: int, *, only_messages: bool = False) -> Split:
    """Return the records of buffer[start:stop]; ends early at one that does not fit.

    With `only_messages` it also ends at the first record that is not a message.
    """
    found = Split(buffer, end=start)
    data = buffer.data
    position = start
    walked: list[tuple[int, int, int]] = []  # (size, channel, start) since the last repetition
    look = _FIRST_LOOK
    while position + RECORD_HEAD <= stop:
        opcode, length = _RECORD.unpack_from(data, position)
        following = position + RECORD_HEAD + length
        if following > stop or opcode == 0:
            break
        if opcode != MESSAGE:
            if only_messages:
                break
            found.others.append((opcode, position + RECORD_HEAD, length))
            position = following
            _flush(found, buffer, walked)
            look = _FIRST_LOOK
            continue
        if length < MESSAGE_HEAD:
            break
        channel = _MESSAGE.unpack_from(data, position)[2]
        walked.append((length, channel, position))
        position = following
        if len(walked) == look:
            period = _period(walked)
            repeated = _repeat(found, buffer, walked, period, position, stop) if period else 0
            if repeated:
                position += repeated
                look = _FIRST_LOOK
            else:
                look = min(look * 2, look + 2 * _LONGEST_PERIOD)
    _flush(found, buffer, walked)
    found.end = position
    return found


def _period(walked: list[tuple[int, int, int]]) -> int:
    """Return the shortest number of records after which the last ones repeat, or 0."""
    kinds = [(size, channel) for size, channel, _ in walked[-2 * _LONGEST_PERIOD :]]
    for period in range(1, len(kinds) // 2 + 1):
        if kinds[-1] == kinds[-1 - period] and kinds[-period:] == kinds[-2 * period : -period]:
            return period
    return 0


def _repeat(
    found: Split,
    buffer: Bytes,
    walked: list[tuple[int, int, int]],
    period: int,
    position: int,
    stop: int,
) -> int:
    """Take the repetitions of the last `period` records that follow; return their bytes."""
    cycle = [(size, channel) for size, channel, _ in walked[-period:]]
    step = sum(size + RECORD_HEAD for size, _ in cycle)
    most = (stop - position) // step
    count = 0
    block = 64
    while count < most:
        tried = min(block, most - count)
        same = _same(buffer, position + count * step, step, cycle, tried)
        count += same
        if same < tried:
            break
        block *= 16
    if count * period < 4:
        return 0
    # what was walked before comes first; its last cycle joins the repetitions
    before = walked[-period][2]
    del walked[-period:]
    _flush(found, buffer, walked)
    offset = before
    for size, channel in cycle:
        found.messages.append(
            (
                channel,
                Payloads(buffer, count + 1, size - MESSAGE_HEAD, offset + PAYLOAD, step),
            )
        )
        offset += size + RECORD_HEAD
    return count * step


def _same(buffer: Bytes, start: int, step: int, cycle: list[tuple[int, int]], count: int) -> int:
    """Return how many cycles from `start` have the expected opcodes, sizes and channels."""
    good = count
    offset = start
    for size, channel in cycle:
        head = _MESSAGE.pack(MESSAGE, size, channel)
        for delta, code in ((0, "<u8"), (7, "<u4")):
            column = np.ndarray((good,), code, buffer.data, offset + delta, (step,))
            equal = column == np.frombuffer(head, code, 1, delta)[0]
            if not equal.all():
                good = int(np.argmin(equal))
                if not good:
                    return 0
        offset += size + RECORD_HEAD
    return good


def _flush(found: Split, buffer: Bytes, walked: list[tuple[int, int, int]]) -> None:
    """Turn records that did not repeat into groups of one channel and size."""
    groups: dict[tuple[int, int], list[int]] = {}
    for size, channel, start in walked:
        groups.setdefault((channel, size), []).append(start + PAYLOAD)
    for (channel, size), starts in groups.items():
        where = np.array(starts, dtype=np.int64)
        found.messages.append(
            (channel, Payloads(buffer, len(starts), size - MESSAGE_HEAD, starts=where))
        )
    walked.clear()
