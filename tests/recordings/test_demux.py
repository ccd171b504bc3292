"""Records are split the same, however regular they are and whether there is an index."""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.recordings.mcap.demux import Split, Splitter

Record = tuple[int, int, bytes]


def build(records: list[Record]) -> tuple[bytes, dict[int, list[int]]]:
    """Bytes of (opcode, channel, payload), and where the messages of each channel start."""
    content = b""
    index: dict[int, list[int]] = {}
    for number, (opcode, channel, payload) in enumerate(records):
        head = b""
        if opcode == 5:
            index.setdefault(channel, []).append(len(content))
            head = struct.pack("<HIQQ", channel, number, number * 7, number * 7 + 1)
        content += struct.pack("<BQ", opcode, len(head + payload)) + head + payload
    return content, index


def messages(found: Split) -> list[tuple[int, int, bytes]]:
    """All messages as (start, channel, payload) in order."""
    return sorted(
        (payloads.start(row), channel, bytes(payloads.payload(row)))
        for channel, payloads in found.messages
        for row in range(payloads.count)
    )


def expected(records: list[Record]) -> list[tuple[int, bytes]]:
    return [(channel, payload) for opcode, channel, payload in records if opcode == 5]


def split(content: bytes, splitter: Splitter | None = None, index: Any = None) -> Split:
    buffer = np.frombuffer(content, dtype=np.uint8)
    return (splitter or Splitter()).split(buffer, 0, buffer.size, index)


record = st.tuples(
    st.sampled_from([5, 5, 5, 5, 5, 5, 3, 4, 200]),
    st.integers(0, 3),
    st.sampled_from([b"", b"a", b"bb", b"dddd", bytes(40)]),
)
stretches = st.lists(
    st.tuples(st.lists(record, min_size=1, max_size=6), st.integers(1, 40)), max_size=4
).map(lambda parts: [one for cycle, times in parts for one in cycle * times])


@given(first=stretches, second=stretches)
def test_nothing_is_lost_or_made_up(first: list[Record], second: list[Record]) -> None:
    splitter = Splitter()
    for records in (first, second, first):
        content, _ = build(records)
        found = split(content, splitter)
        assert found.end == len(content)
        assert [(channel, payload) for _, channel, payload in messages(found)] == expected(records)
        assert [opcode for opcode, _, _ in found.others] == [r[0] for r in records if r[0] != 5]


@pytest.mark.slow
@given(records=st.lists(record, min_size=150, max_size=400), data=st.data())
def test_an_index_changes_nothing(records: list[Record], data: st.DataObject) -> None:
    content, index = build(records)
    arrays = {number: np.array(starts, dtype=np.int64) for number, starts in index.items()}
    if arrays and data.draw(st.booleans()):
        # an index that lies: it leaves one out, points elsewhere or names the wrong channel
        number = data.draw(st.sampled_from(sorted(arrays)))
        match data.draw(st.integers(0, 3)):
            case 0:
                arrays[number] = arrays[number][1:]
            case 1:
                arrays[number] = arrays[number] + data.draw(st.integers(-(2**63) // 2, 2**62))
            case 2:
                arrays[number + 1] = arrays.pop(number)
            case 3:
                arrays[number] = np.append(arrays[number], arrays[number][:1])
    asked = []

    def give() -> dict[int, Any]:
        asked.append(True)
        return arrays

    found = split(content, index=give)
    assert [(channel, payload) for _, channel, payload in messages(found)] == expected(records)
    assert sorted(opcode for opcode, _, _ in found.others) == sorted(
        opcode for opcode, _, _ in records if opcode != 5
    )


def test_an_irregular_log_asks_its_index_and_a_regular_one_does_not() -> None:
    choice = np.random.default_rng(0)
    irregular = [(5, int(choice.integers(0, 9)), b"12345678") for _ in range(3000)]
    content, index = build(irregular)
    arrays = {number: np.array(starts, dtype=np.int64) for number, starts in index.items()}
    asked = []

    def give() -> dict[int, Any]:
        asked.append(True)
        return arrays

    found = split(content, index=give)
    assert asked
    assert len(found.messages) == 9
    asked.clear()
    content, _ = build([(5, k % 9, b"12345678") for k in range(3000)])
    assert len(split(content, index=give).messages) <= 18
    assert not asked


@given(records=stretches, cut=st.integers(1, 60))
def test_a_torn_end_gives_the_whole_records_before(records: list[Record], cut: int) -> None:
    content, _ = build(records)
    torn = content[:-cut]
    found = split(torn)
    whole = [row for row in messages(split(content)) if row[0] + len(row[2]) <= len(torn)]
    assert messages(found) == whole
    assert found.end <= len(torn)
