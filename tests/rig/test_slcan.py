"""The adapter's side of slcan."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.rig.slcan import Adapter, frame_as_text
from eha_bench.targets.can.drive import Frame

standard = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))
extended = st.builds(Frame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.just(True))


@given(frames=st.lists(standard | extended, max_size=6), cut=st.integers(1, 40))
def test_frames_survive_however_the_bytes_are_cut(frames: list[Frame], cut: int) -> None:
    adapter = Adapter()
    adapter.feed(b"C\rS8\r\rO\r")
    data = b"".join(frame_as_text(frame) for frame in frames)
    found = []
    for start in range(0, len(data), cut):
        found += adapter.feed(data[start : start + cut])[0]
    assert found == frames


@given(data=st.lists(st.binary(max_size=60), max_size=8))
def test_no_bytes_do_any_harm(data: list[bytes]) -> None:
    adapter = Adapter()
    for part in data:
        frames, _ = adapter.feed(part)
        assert all(len(frame.data) <= 8 for frame in frames)
    adapter.feed(b"\r")
    adapter.feed(b"O\r")
    assert adapter.feed(b"t10011F\r") == ([Frame(0x100, b"\x1f")], b"z\r")


@pytest.mark.parametrize(
    ("sent", "answer"),
    [
        (b"V\r", b"V1013\r"),
        (b"S6\r", b"\r"),
        (b"q\r", b"\a"),
        (b"t1009\r", b"\a"),
        (b"t10021F\r", b"\a"),
    ],
)
def test_commands_are_answered_as_the_manual_says(sent: bytes, answer: bytes) -> None:
    adapter = Adapter()
    adapter.feed(b"O\r")
    assert adapter.feed(sent) == ([], answer)


def test_no_frame_passes_a_closed_channel() -> None:
    adapter = Adapter()
    assert adapter.feed(b"t10011F\r")[0] == []
    adapter.feed(b"O\r")
    assert adapter.open
    adapter.feed(b"C\r")
    assert adapter.feed(b"t10011F\r")[0] == []
