"""A recording that is cut, holed or damaged gives what is whole, and says what is not."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings import LiveWriter, info, recover
from eha_bench.recordings.mcap.file import Chunk, open_mcap

TICKS = 5000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    generator = np.random.default_rng(3)
    rows = generator.normal(size=(TICKS, 4))
    with LiveWriter(
        path,
        ["pressure_a", "pressure_b", "current", "motor_speed"],
        epoch_ns=1_760_000_000_000_000_000,
        metadata={"trial": "t"},
    ) as writer:
        for tick, row in enumerate(rows):
            writer.append(tick / 1000, row)
            if tick % 500 == 499:
                writer.flush()
    return path


def readable(content: bytes, folder: Path) -> int:
    """Count the messages of whole records as the mcap library's stream reader has them."""
    path = folder / "count.mcap"
    path.write_bytes(content)
    count = 0
    try:
        with path.open("rb") as stream:
            for record in StreamReader(stream).records:
                count += isinstance(record, Message)
    except Exception:
        pass
    return count


@given(data=st.data())
@settings(max_examples=40)
def test_cut_anywhere(
    data: st.DataObject, whole: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    content = whole.read_bytes()
    cut = data.draw(st.integers(0, len(content) - 1))
    path = folder / "cut.mcap"
    path.write_bytes(content[:cut])
    expected = readable(content[:cut], folder)
    complete = recordings.read(whole)
    if not expected:
        with pytest.raises(
            RecordingError,
            match=r"empty|neither a rec|not an MCAP|no topics|torn|not a table",
        ):
            recordings.read(path)
        return
    torn = recordings.read(path)
    assert len(torn) >= expected
    assert np.array_equal(torn["current"], complete["current"][: len(torn)])
    assert any("torn" in note or "not closed" in note for note in torn.notes)
    report = recover(path, folder / "clean.mcap")
    assert report.messages == {"/eha_bench/sample": len(torn)}
    assert report.notes
    clean = recordings.read(folder / "clean.mcap")
    assert clean.notes == ()
    assert np.array_equal(clean.time, torn.time)
    assert all(np.array_equal(clean[name], torn[name]) for name in torn)
    assert dict(clean.metadata) == {"trial": "t"}
    with (folder / "clean.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(torn)


def chunks(path: Path) -> list[Chunk]:
    return [part for part in open_mcap(path).parts if isinstance(part, Chunk)]


def test_a_whole_recording_needs_no_recovery(whole: Path, tmp_path: Path) -> None:
    report = recover(whole, tmp_path / "copy.mcap")
    assert report.whole
    assert report.messages == {"/eha_bench/sample": TICKS}
    assert report.duration == pytest.approx((TICKS - 1) / 1000)
    assert (tmp_path / "copy.mcap").stat().st_size == pytest.approx(whole.stat().st_size, rel=0.01)


def test_a_hole_is_jumped_over(whole: Path, tmp_path: Path) -> None:
    content = bytearray(whole.read_bytes())
    third = chunks(whole)[2]
    content[third.offset - 40 : third.offset + 60] = bytes(100)
    path = tmp_path / "hole.mcap"
    path.write_bytes(content)
    back = recordings.read(path)
    complete = recordings.read(whole)
    assert any("hole" in note for note in back.notes)
    assert 0.7 * TICKS < len(back) < TICKS
    assert back.time[-1] == complete.time[-1]
    kept = np.isin(complete.time, back.time)
    assert np.array_equal(back["current"], complete["current"][kept])
    assert recover(path, tmp_path / "r.mcap").messages == {"/eha_bench/sample": len(back)}


def test_a_chunk_with_a_wrong_checksum_is_lost_and_said(whole: Path, tmp_path: Path) -> None:
    content = bytearray(whole.read_bytes())
    chunk = chunks(whole)[1]
    content[chunk.offset + 9 + 24] ^= 1  # its CRC
    path = tmp_path / "crc.mcap"
    path.write_bytes(content)
    back = recordings.read(path)
    assert len(back) < TICKS
    assert any("checksum is wrong" in note for note in back.notes)
    assert info(path).health == "damaged"
    report = recover(path, tmp_path / "r.mcap")
    assert report.chunks_lost == 1


def test_an_open_chunk_of_endless_length_is_read(whole: Path, tmp_path: Path) -> None:
    """Some writers, when killed, leave 2^64 - 1 as the length of the chunk that was open."""
    content = bytearray(whole.read_bytes())
    last = chunks(whole)[-1]
    del content[last.data_start + last.data_size :]
    struct.pack_into("<Q", content, last.offset + 1, 2**64 - 1)
    struct.pack_into("<Q", content, last.data_start - 8, 2**64 - 1)
    path = tmp_path / "open.mcap"
    path.write_bytes(content)
    back = recordings.read(path)
    assert len(back) == TICKS
    assert any("torn" in note for note in back.notes)


@pytest.mark.parametrize("size", [2**60, 2**63, 2**33])
def test_impossible_sizes_are_refused_before_memory_is_taken(
    whole: Path, tmp_path: Path, size: int
) -> None:
    import tracemalloc

    content = bytearray(whole.read_bytes())
    chunk = chunks(whole)[0]
    struct.pack_into("<Q", content, chunk.offset + 9 + 16, size)
    path = tmp_path / "huge.mcap"
    path.write_bytes(content)
    tracemalloc.start()
    back = recordings.read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert any("declares" in note for note in back.notes)
    assert peak < 50e6


def test_zeros_at_the_end_are_a_tear(whole: Path, tmp_path: Path) -> None:
    """What a file system may leave after a loss of power."""
    content = whole.read_bytes()
    path = tmp_path / "zeros.mcap"
    path.write_bytes(content[: chunks(whole)[5].offset] + bytes(9000))
    back = recordings.read(path)
    assert any("torn" in note for note in back.notes)
    complete = recordings.read(whole)
    assert np.array_equal(back.time, complete.time[: len(back)])


def test_messages_outside_of_chunks_are_recovered(tmp_path: Path) -> None:
    from mcap.writer import CompressionType, Writer

    path = tmp_path / "bare.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False, compression=CompressionType.NONE)
        writer.start(profile="x", library="y")
        schema = writer.register_schema("a", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for k in range(300):
            writer.add_message(channel, k * 1000, b'{"v": %d}' % k, k * 1000, k)
        # no finish: the file was cut
    mapping = {"channels": {"v": {"topic": "/a", "field": "v", "unit": ""}}}
    assert len(recordings.read(path, channels=mapping)) == 300
    report = recover(path, tmp_path / "clean.mcap")
    assert report.messages == {"/a": 300}
    clean = recordings.read(tmp_path / "clean.mcap", channels=mapping)
    assert clean["v"].tolist() == list(range(300))
    with (tmp_path / "clean.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert [m.sequence for _, _, m in reader.iter_messages()] == list(range(300))
        assert reader.get_header().profile == "x"


def test_recover_refuses_what_it_cannot_do(whole: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        recover(tmp_path / "none.mcap", tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="the recording itself"):
        recover(whole, whole)
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(RecordingError, match="not an MCAP"):
        recover(tmp_path / "text.mcap", tmp_path / "a.mcap")
    (tmp_path / "head.mcap").write_bytes(whole.read_bytes()[:8])
    with pytest.raises(RecordingError, match="nothing"):
        recover(tmp_path / "head.mcap", tmp_path / "a.mcap")
    assert not (tmp_path / "a.mcap").exists()


def test_only_the_span_is_decompressed(whole: Path, tmp_path: Path) -> None:
    """Chunks that are damaged, but outside of the span, do not matter."""
    content = bytearray(whole.read_bytes())
    for chunk in chunks(whole)[:3]:
        content[chunk.data_start + 20] ^= 0xFF
    path = tmp_path / "span.mcap"
    path.write_bytes(content)
    complete = recordings.read(whole)
    part = recordings.read(path, start=4.0, stop=4.5)
    assert part.notes == ()
    assert np.array_equal(part.time, complete.between(4.0, 4.5).time)
    assert np.array_equal(part["current"], complete.between(4.0, 4.5)["current"])
    with pytest.raises(RecordingError, match="no samples"):
        recordings.read(whole, start=100.0)
    assert isinstance(part, Recording)
