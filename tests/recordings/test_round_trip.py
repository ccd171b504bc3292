"""What is written is read back bit for bit, and other people's readers agree."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.core.recording import Recording

NAMES = st.text(
    st.characters(exclude_categories=["C", "Zl", "Zp"]), min_size=1, max_size=12
).filter(lambda name: name != "time" and name.strip() != "")


@st.composite
def recordings_strategy(draw: st.DrawFn) -> Recording:
    count = draw(st.integers(1, 40))
    steps = draw(arrays(np.float64, count, elements=st.floats(1e-7, 1.0, allow_subnormal=False)))
    start = draw(st.floats(-5, 5))
    time = start + np.cumsum(steps)
    names = draw(st.lists(NAMES, min_size=0, max_size=5, unique=True))
    values = {name: draw(arrays(np.float64, count, elements=st.floats(width=64))) for name in names}
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    return Recording(
        time,
        values,
        {name: draw(st.sampled_from(["Pa", "A", "rad/s", "", "m"])) for name in names},
        epoch_ns=draw(st.sampled_from([0, 1, 1_700_000_000_123_456_789])),
        metadata=draw(st.dictionaries(text, text, max_size=3)),
        attachments=draw(st.dictionaries(text, st.binary(max_size=30), max_size=3)),
        notes=tuple(draw(st.lists(text.filter(bool), max_size=3, unique=True))),
    )


def same_bits(left: np.ndarray, right: np.ndarray) -> bool:
    return bool(np.array_equal(left.view(np.uint64), right.view(np.uint64)))


@pytest.mark.slow
@given(recordings_strategy())
def test_everything_survives(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording
) -> None:
    path = tmp_path_factory.mktemp("trip") / "a.mcap"
    recordings.write(path, recording)
    back = recordings.read(path)
    assert same_bits(back.time, recording.time)
    assert list(back.values) == list(recording.values)
    assert all(same_bits(back.values[name], recording.values[name]) for name in back.values)
    assert dict(back.units) == dict(recording.units)
    assert back.epoch_ns == recording.epoch_ns
    assert dict(back.metadata) == dict(recording.metadata)
    assert dict(back.attachments) == dict(recording.attachments)
    assert back.notes[: len(recording.notes)] == recording.notes
    assert back.source == str(path)


def long_recording(count: int = 30_000) -> Recording:
    generator = np.random.default_rng(1)
    time = np.arange(count) / 1000.0
    return Recording(
        time,
        {
            "reference": np.sin(time),
            "pressure_a": generator.normal(1e6, 1e4, count),
            "current": generator.normal(size=count),
        },
        {"reference": "Pa"},
        epoch_ns=1_760_000_000_000_000_000,
        metadata={"trial": "sine", "seed": "7"},
        attachments={"suite.yaml": b"suite: paper\n"},
    )


def test_mcap_library_reads_the_same(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    recording = long_recording()
    path = recordings.write(tmp_path / "a.mcap", recording)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(recording)
        assert summary.statistics.channel_message_counts == {1: len(recording)}
        assert len(summary.chunk_indexes) > 1
        assert [a.name for a in reader.iter_attachments()] == ["suite.yaml"]
        assert {m.name for m in reader.iter_metadata()} >= {"eha_bench.metadata"}
        rows = [
            (message.log_time, decoded) for _, _, message, decoded in reader.iter_decoded_messages()
        ]
    assert [row.pressure_a for _, row in rows] == recording["pressure_a"].tolist()
    assert [row.time for _, row in rows] == recording.time.tolist()
    assert rows[1][0] == recording.epoch_ns + 1_000_000
    assert rows[1][1].header.stamp.nanosec == 1_000_000


def test_rosbags_reads_the_same(tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    recording = long_recording(2000)
    path = recordings.write(tmp_path / "a.mcap", recording)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        values = [
            reader.deserialize(raw, connection.msgtype).pressure_a
            for connection, _, raw in reader.messages()
        ]
    assert values == recording["pressure_a"].tolist()


def test_nothing_is_left_when_writing_fails(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        recordings.write(tmp_path / "no" / "folder.mcap", long_recording(10))
    bad = Recording(np.array([0.0, 1e30]), {})
    with pytest.raises(RecordingError, match="no stamp"):
        recordings.write(tmp_path / "a.mcap", bad)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_recording_is_refused_when_read(tmp_path: Path) -> None:
    path = recordings.write(tmp_path / "a.mcap", Recording(np.empty(0), {"current": np.empty(0)}))
    with pytest.raises(RecordingError, match="empty"):
        recordings.read(path)


def test_names_inside_a_recording_stay_text(tmp_path: Path) -> None:
    recording = Recording(
        np.array([0.0, 1.0]), {"../x": np.zeros(2)}, attachments={"../../evil": b"1"}
    )
    back = recordings.read(recordings.write(tmp_path / "a.mcap", recording))
    assert dict(back.attachments) == {"../../evil": b"1"}
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]


def test_a_folder_with_a_description_is_a_rosbag2(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader

    first, second = long_recording(500), long_recording(800)
    recordings.write(tmp_path / "b.mcap", first)
    later = Recording(
        second.time, dict(second.values), dict(second.units), epoch_ns=second.epoch_ns + 10**12
    )
    recordings.write(tmp_path / "a.mcap", later)
    described = recordings.write_rosbag2_metadata(tmp_path)
    assert described.name == "metadata.yaml"
    with Reader(tmp_path) as reader:
        assert reader.message_count == 1300
        assert reader.start_time == first.epoch_ns
        assert {c.topic for c in reader.connections} == {"/eha_bench/sample"}
        assert sum(1 for _ in reader.messages()) == 1300
    with pytest.raises(RecordingError, match=r"2 recordings of eha-bench \(b\.mcap, a\.mcap\)"):
        recordings.read(tmp_path)
    with pytest.raises(RecordingError, match="no MCAP file"):
        recordings.write_rosbag2_metadata(tmp_path / "none")
