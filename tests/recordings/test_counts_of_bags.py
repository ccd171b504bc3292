"""What a bag says of itself is compared with what it holds."""

import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from eha_bench.recordings import info, read
from eha_bench.recordings.shared_memory import SharedMemory

COUNT = 200


@pytest.mark.parametrize("declared", [0, 150, 4_000_000_000])
def test_an_index_that_counts_other_messages_than_it_lists(tmp_path: Path, declared: int) -> None:
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / "a.bag"
    kind = store.types["std_msgs/msg/Float64"]
    with Writer(path) as writer:
        connection = writer.add_connection("/f", kind.__msgtype__, typestore=store)
        for k in range(COUNT):
            raw = store.serialize_ros1(kind(float(k)), kind.__msgtype__)
            writer.write(connection, 10**9 + k * 10**6, raw)
    assert info(path).health == "good"
    content = path.read_bytes()
    told = b"count=" + struct.pack("<I", COUNT)
    assert content.count(told) == 1
    path.write_bytes(content.replace(told, b"count=" + struct.pack("<I", declared)))
    found = info(path)
    assert found.health == "damaged"
    assert f"counts {declared} messages and lists {COUNT}" in found.notes[0]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as file:
        file.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
            "serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB);"
            "INSERT INTO topics VALUES(1, '/f', 'std_msgs/msg/Float64', 'cdr', '');"
        )
        file.executemany(
            "INSERT INTO messages VALUES(?, 1, ?, ?)",
            [(k + 1, k * 10**6, b"\0\1\0\0" + struct.pack("<d", k)) for k in range(COUNT)],
        )
    return path


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("UPDATE messages SET topic_id = 77 WHERE id = 5", "1 messages belong to no topic"),
        (
            "INSERT INTO topics VALUES(2, '/f', 'std_msgs/msg/String', 'cdr', '')",
            "'/f' is declared twice, as 'std_msgs/msg/Float64' and 'std_msgs/msg/String'",
        ),
    ],
)
def test_topics_of_a_rosbag2_that_are_not_what_they_say(bag: Path, change: str, said: str) -> None:
    assert info(bag).health == "good"
    with sqlite3.connect(bag) as file:
        file.execute(change)
    found = info(bag)
    assert found.health == "damaged"
    assert said in found.notes[0]


def test_times_that_no_clock_gives_are_said(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/f", "cdr", schema)
        for k in range(10):
            stamp = 2**63 + k * 1000
            writer.add_message(channel, stamp, b"\0\1\0\0" + bytes(8), stamp)
        writer.finish()
    said = "topic '/f': 10 of 10 messages have a time out of range"
    mapping = {"channels": {"force": {"topic": "/f", "field": "data", "unit": "N"}}}
    assert said in read(path, channels=mapping).notes
    found = info(path)
    assert said in found.notes
    assert found.health == "damaged"


def test_columns_of_one_memory_are_known_without_comparing_all_pairs() -> None:
    table = np.zeros((50, 3))
    columns = {"a": table[:, 0], "own": np.zeros(50), "b": table[:, 1], "same": table[:, 0]}
    memory = SharedMemory(columns)
    assert memory.leave("a")
    assert not memory.leave("own")
    assert memory.leave("b")
    assert not memory.leave("same")
    many = {f"c{k}": np.zeros(3) for k in range(20_000)}
    memory = SharedMemory(many)
    assert not any(memory.leave(name) for name in many)
