"""Every format gives the same numbers as its own library."""

import shutil
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from ruamel.yaml import YAML

from eha_bench import recordings
from eha_bench.core.errors import EhaBenchError, RecordingError
from eha_bench.recordings import info

RIG = "ABCDEF"


def one(topic: str, field: str, unit: str = "V", **options: Any) -> dict[str, Any]:
    return {"channels": {"probe": {"topic": topic, "field": field, "unit": unit}}, **options}


@pytest.mark.parametrize("case", RIG)
def test_every_log_of_the_rig_reads_through_its_map(shared_data: Path, case: str) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    folder = shared_data / "rig_samples" / case
    dataset = YAML(typ="safe").load(folder / "dataset.yaml")
    assert len(dataset["runs"]) == 10
    for number, run in enumerate(dataset["runs"]):
        back = recordings.read(folder / run["log"], channels=folder / run["channels"])
        assert len(back) == 4000
        assert back.time[0] == 0.0
        assert np.allclose(np.diff(back.time), 0.001, atol=1e-9)
        assert back.notes == ()
        assert len(back.values) == 8
        if number:
            continue
        with (folder / run["log"]).open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            messages = [
                (channel.topic, message)
                for _, channel, _, message in reader.iter_decoded_messages()
            ]
        bar = [m.fluid_pressure for topic, m in messages if topic == "/block/p_a"]
        rpm = [m.velocity[0] for topic, m in messages if topic == "/drive/state"]
        assert np.allclose(back["pressure_a"], np.array(bar) * 1e5, rtol=1e-12)
        assert np.allclose(back["motor_speed"], np.array(rpm) * 2 * np.pi / 60, rtol=1e-12)


@pytest.mark.parametrize("name", ["example", "example-lz4", "example-bz2"])
def test_ros1_bags(shared_data: Path, name: str) -> None:
    from rosbags.highlevel import AnyReader

    path = shared_data / f"bags/rosbag1/{name}.bag"
    with AnyReader([path]) as reader:
        chosen = [c for c in reader.connections if c.topic == "/turtle1/pose"]
        theirs = [
            (stamp, reader.deserialize(raw, c.msgtype))
            for c, stamp, raw in reader.messages(connections=chosen)
        ]
        counts = {topic: t.msgcount for topic, t in reader.topics.items()}
    back = recordings.read(path, channels=one("/turtle1/pose", "theta"))
    assert back["probe"].tolist() == [message.theta for _, message in theirs]
    assert back.epoch_ns == theirs[0][0]
    assert {topic.name: topic.count for topic in info(path).topics} == counts
    assert info(path).health == "good"


def test_ros1_chunks_out_of_order_are_put_in_order(shared_data: Path) -> None:
    path = shared_data / "bags/rosbag1/example-unsorted-chunks.bag"
    description = info(path)
    assert description.topics[0].steps_back == 0
    assert any("not in order of time" in note for note in description.notes)


def test_a_torn_ros1_bag_reads_up_to_its_tear(shared_data: Path, tmp_path: Path) -> None:
    content = (shared_data / "bags/rosbag1/example.bag").read_bytes()
    complete = recordings.read(
        shared_data / "bags/rosbag1/example.bag", channels=one("/turtle1/pose", "x")
    )
    path = tmp_path / "torn.bag"
    path.write_bytes(content[: len(content) // 2])
    torn = recordings.read(path, channels=one("/turtle1/pose", "x"))
    assert 0 < len(torn) < len(complete)
    assert np.array_equal(torn["probe"], complete["probe"][: len(torn)])
    assert any("torn" in note for note in torn.notes)
    assert info(path).health == "damaged"


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_split_rosbag2_folders(shared_data: Path, kind: str) -> None:
    from rosbags.rosbag2 import Reader

    folder = shared_data / f"bags/rosbag2_{kind}/wbag"
    with Reader(folder) as reader:
        counts: dict[str, int] = {}
        for connection, _, _ in reader.messages():
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
    description = info(folder)
    assert {topic.name: topic.count for topic in description.topics} == counts
    assert sum(counts.values()) == 6074
    assert description.duration == pytest.approx(4.11e-7 + 0.0, abs=1.6e-6)


@pytest.mark.parametrize("folder", ["rosbag2_mcap/talker", "rosbag2_sqlite3/talker"])
def test_talker(shared_data: Path, folder: str) -> None:
    description = info(shared_data / "bags" / folder)
    assert {topic.name: topic.count for topic in description.topics} == {
        "/rosout": 10,
        "/parameter_events": 0,
        "/topic": 10,
    }


def test_a_field_between_texts_of_changing_length(shared_data: Path) -> None:
    folder = shared_data / "bags/rosbag2_mcap/talker"
    back = recordings.read(folder, channels=one("/rosout", "line"))
    assert len(back) == 10
    assert (back["probe"] > 0).all()


def test_cdr_of_every_basic_type(shared_data: Path) -> None:
    from rosbags.highlevel import AnyReader

    folder = shared_data / "bags/rosbag2_mcap/cdr_test"
    with AnyReader([folder]) as reader:
        theirs = [(c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
    basic = [message for topic, message in theirs if topic == "/test_topic"]
    arrays = [message for topic, message in theirs if topic == "/array_topic"]
    for kind in ("float32", "float64", "int8", "uint8", "int16", "uint32", "int64", "bool"):
        back = recordings.read(folder, channels=one("/test_topic", f"{kind}_value"))
        assert back["probe"].tolist() == [float(getattr(m, f"{kind}_value")) for m in basic]
    back = recordings.read(
        folder, channels=one("/array_topic", "basic_types_values[2].float64_value")
    )
    assert back["probe"].tolist() == [m.basic_types_values[2].float64_value for m in arrays]
    back = recordings.read(folder, channels=one("/array_topic", "alignment_check"))
    assert back["probe"].tolist() == [m.alignment_check for m in arrays]


def test_a_foreign_serialization_is_refused_with_the_reason(shared_data: Path) -> None:
    folder = shared_data / "bags/rosbag2_mcap/wrong_rmw_test"
    for channels in (None, one("/test_topic", "float64_value")):
        with pytest.raises(RecordingError, match="serialized as 'wrong_format'"):
            recordings.read(folder, channels=channels)
    assert all("wrong_format" in topic.readable for topic in info(folder).topics)


def test_service_events_are_skipped_with_a_note(shared_data: Path) -> None:
    folder = shared_data / "bags/rosbag2_mcap/bag_with_topics_and_service_events"
    description = info(folder)
    skipped = [topic.name for topic in description.topics if "service" in topic.readable]
    assert sorted(skipped) == ["/test_service1/_service_event", "/test_service2/_service_event"]
    assert sum(topic.count for topic in description.topics) == 10
    assert any("service events" in note for note in description.notes)
    with pytest.raises(RecordingError, match="service events"):
        recordings.read(folder, channels=one(skipped[0], "x"))


def test_a_description_never_leads_out_of_its_folder(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    shutil.copytree(shared_data / "bags/rosbag2_mcap/talker", folder)
    (folder / "talker.mcap").rename(tmp_path / "talker.mcap")
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("talker.mcap", "../talker.mcap"))
    with pytest.raises(RecordingError, match=r"missing: talker\.mcap"):
        info(folder)


def test_a_folder_without_description_is_read_by_name(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    shutil.copytree(shared_data / "bags/rosbag2_sqlite3/wbag", folder)
    (folder / "metadata.yaml").unlink()
    description = info(folder)
    assert sum(topic.count for topic in description.topics) == 6074
    assert any("no metadata.yaml" in note for note in description.notes)
    with pytest.raises(RecordingError, match="holds no recording"):
        info(tmp_path)


def test_compressed_rosbag2(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["std_msgs/msg/Float64"]
    source = tmp_path / "plain"
    with Writer(source, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/f", kind.__msgtype__, typestore=store)
        for k in range(50):
            writer.write(connection, k * 10**6, store.serialize_cdr(kind(k / 3), kind.__msgtype__))
    compressor = zstandard.ZstdCompressor()
    by_file = tmp_path / "by_file"
    by_file.mkdir()
    packed = compressor.compress((source / "plain.db3").read_bytes())
    (by_file / "plain.db3.zstd").write_bytes(packed)
    yaml = YAML(typ="safe")
    described = yaml.load(source / "metadata.yaml")
    inside = described["rosbag2_bagfile_information"]
    inside["relative_file_paths"] = ["plain.db3.zstd"]
    inside["compression_mode"] = "FILE"
    yaml.dump(described, by_file / "metadata.yaml")
    by_message = tmp_path / "by_message"
    shutil.copytree(source, by_message)
    inside["relative_file_paths"] = ["plain.db3"]
    inside["compression_mode"] = "MESSAGE"
    yaml.dump(described, by_message / "metadata.yaml")
    database = sqlite3.connect(by_message / "plain.db3")
    for number, data in database.execute("SELECT id, data FROM messages").fetchall():
        database.execute(
            "UPDATE messages SET data = ? WHERE id = ?", (compressor.compress(data), number)
        )
    database.commit()
    database.close()
    plain = recordings.read(source, channels=one("/f", "data"))
    assert plain["probe"].tolist() == [k / 3 for k in range(50)]
    for folder in (by_file, by_message):
        back = recordings.read(folder, channels=one("/f", "data"))
        assert back["probe"].tolist() == plain["probe"].tolist()
        assert back.time.tolist() == plain.time.tolist()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.mcap", b"", "the file is empty"),
        ("head.mcap", b"\x89MCAP0\r\n", "no topics"),
        ("text.mcap", b"hello world", "not a table|no recording"),
        ("binary.bin", bytes(range(256)) * 4, "not a recording"),
        ("old.bag", b"#ROSBAG V1.2\n" + bytes(50), "another version"),
        ("empty.bag", b"#ROSBAG V2.0\n", "no topics"),
        ("broken.db3", b"SQLite format 3\0" + bytes(100), "not a rosbag2 database"),
        ("broken.parquet", b"PAR1 nothing more", "damaged or torn"),
        ("new.mat", b"MATLAB 7.3 MAT-file" + bytes(200), "not a MAT file of version 5 or 7.3"),
        ("broken.mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\x0e" * 40, "damaged"),
        ("packed.gz", b"\x1f\x8b" + bytes(50), "archive"),
        ("packed.mcap.zstd", b"\x28\xb5\x2f\xfd" + bytes(50), "the file is empty"),
    ],
)
def test_what_is_no_recording(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(EhaBenchError, match=message) as caught:
        recordings.read(path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_topic_and_map(tmp_path: Path, shared_data: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        recordings.read(tmp_path / "none.mcap")
    log = shared_data / "rig_samples/A/locked_steps.mcap"
    with pytest.raises(RecordingError, match=r"no channel map.*'?/block/p_a"):
        recordings.read(log)
    with pytest.raises(EhaBenchError, match=r"'probe' is not in.*/bench/reference"):
        recordings.read(log, channels=one("/none", "data"))
    with pytest.raises(RecordingError, match=r"no field 'dta'; did you mean 'data'"):
        recordings.read(log, channels=one("/bench/reference", "dta"))
    with pytest.raises(RecordingError, match=r"add an index, e\.g\. \[0\]"):
        recordings.read(log, channels=one("/drive/state", "velocity"))
    with pytest.raises(RecordingError, match="is not a number but text"):
        recordings.read(log, channels=one("/drive/state", "name[0]"))
    with pytest.raises(RecordingError, match=r"element velocity\[7\]"):
        recordings.read(log, channels=one("/drive/state", "velocity[7]"))
    with pytest.raises(RecordingError, match="names columns"):
        recordings.read(log, channels={"channels": {"current": {"column": "i", "unit": "A"}}})


def test_an_element_is_found_by_its_joints_name(shared_data: Path) -> None:
    log = shared_data / "rig_samples/A/free_sine.mcap"
    names = ["motor", "rod"]
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with log.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        first = next(reader.iter_decoded_messages(topics=["/drive/state"]))[3]
    names = list(first.name)
    by_name = recordings.read(log, channels=one("/drive/state", f"velocity[{names[1]}]"))
    by_index = recordings.read(log, channels=one("/drive/state", "velocity[1]"))
    assert by_name["probe"].tolist() == by_index["probe"].tolist()
    with pytest.raises(RecordingError, match=r"element velocity\[nobody\]"):
        recordings.read(log, channels=one("/drive/state", "velocity[nobody]"))


def test_info_as_json(shared_data: Path) -> None:
    import json

    log = shared_data / "rig_samples/A/locked_steps.mcap"
    content = json.loads(json.dumps(info(log).as_dict(), allow_nan=False))
    assert content["duration"] == pytest.approx(3.999)
    state = next(t for t in content["topics"] if t["name"] == "/drive/state")
    assert state["type"] == "sensor_msgs/msg/JointState"
    assert state["rate"] == pytest.approx(1000.0)
    assert state["count"] == 4000
    assert content["health"] == "good"


def test_names_in_a_log_do_not_spoil_a_message(float_log: Any) -> None:
    bad = "/a\nb\x1b[31m" + "x" * 3000
    path = float_log({bad: [(0, 1.0), (1000, 2.0)]})
    for channels in (None, one("/none", "data"), one(bad, "nothing")):
        with pytest.raises(RecordingError) as caught:
            recordings.read(path, channels=channels)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 2000
    assert recordings.read(path, channels=one(bad, "data"))["probe"].tolist() == [1.0, 2.0]


def test_a_description_cannot_fill_the_memory(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    shutil.copytree(shared_data / "bags/rosbag2_mcap/talker", folder)
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 30)]
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text("\n".join(lines) + "\n" + text)
    assert sum(topic.count for topic in info(folder).topics) == 20


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        ("SQLITE3", "FILE"),
        ("SQLITE3", "MESSAGE"),
        ("MCAP", "FILE"),
        ("MCAP", "MESSAGE"),
        ("MCAP", "STORAGE"),
    ],
)
def test_rosbag2_compressed_by_rosbags(tmp_path: Path, storage: str, mode: str) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["std_msgs/msg/String"]
    number = store.types["std_msgs/msg/Float64"]
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        first = writer.add_connection("/f", number.__msgtype__, typestore=store)
        second = writer.add_connection("/s", kind.__msgtype__, typestore=store)
        for k in range(50):
            raw = store.serialize_cdr(number(k / 3), number.__msgtype__)
            writer.write(first, k * 10**6, raw)
            text = kind("x" * k)
            writer.write(second, k * 10**6, store.serialize_cdr(text, kind.__msgtype__))
    file = next(f for f in (tmp_path / "bag").iterdir() if f.suffix != ".yaml")
    for path in (tmp_path / "bag", tmp_path / "bag" / "metadata.yaml", file):
        back = recordings.read(path, channels=one("/f", "data"))
        assert back["probe"].tolist() == [k / 3 for k in range(50)]
    with pytest.raises(RecordingError, match="not a number but text") as caught:
        recordings.read(file, channels=one("/s", "data"))
    assert str(file) in str(caught.value)


def test_a_misspelt_topic_is_guessed(float_log: Any) -> None:
    path = float_log({"/drive/speed": [(0, 1.0)], "/drive/current": [(0, 1.0)]})
    with pytest.raises(RecordingError, match=r"did you mean '/drive/speed'\?.*its topics are"):
        recordings.read(path, channels=one("/drive/sped", "data"))


def test_a_yaml_file_of_ours_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "channels.yaml"
    path.write_text("time: {column: t, unit: s}\nchannels:\n  voltage: {column: u, unit: V}\n")
    with pytest.raises(RecordingError, match=r"yaml:1: this is a channel map, not a recording; a"):
        info(path)
    # names lie: a table is one by any name
    path.write_text("t,n\n0,1\n0.1,2\n0.2,3\n")
    assert info(path).format == "csv"


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        (
            "a.mcap",
            b"not a recording",
            "this is not an MCAP, as its name says .it does not begin",
        ),
        ("a.MCAP", b"time of day, what\nnoon, nothing\n", "not an MCAP, as its name says"),
        ("a.mcap", b"\x89NCAP0\r\n" + bytes(200), "not an MCAP, as its name says"),
        ("a.bag", b"#ROSBUG V2.0\n" + bytes(200), "not a ROS 1 bag, as its name says"),
        ("a.mcap", b"version https://git-lfs.github.com/spec/v1\nsize 9,9\n", "git lfs pull"),
        ("a.csv", b"version https://git-lfs.github.com/spec/v1\nsize 9,9\n", "git lfs pull"),
    ],
)
def test_what_a_name_says_and_the_content_is_not(
    tmp_path: Path, name: str, content: bytes, says: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=rf"{name}: .*{says}"):
        recordings.read(tmp_path / name)


@pytest.mark.parametrize("content", ["t,n\n0,1\n0.1,2\n0.2,3\n", "t\tn\n0\t1e-3\n1\t-2.5\n"])
def test_a_table_is_one_by_any_name(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.mcap").write_text(content)
    assert info(tmp_path / "a.mcap").format == "csv"
