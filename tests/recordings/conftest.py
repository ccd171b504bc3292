"""Logs of other people's making, written by other people's libraries."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

FLOAT = "float64 data"
HEADER = (
    "std_msgs/Header header\nfloat64 value\n" + "=" * 80 + "\nMSG: std_msgs/Header\n"
    "builtin_interfaces/Time stamp\nstring frame_id\n" + "=" * 80 + "\n"
    "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
EPOCH = 1_760_000_000_000_000_000

Messages = Sequence[tuple[int, Any]]
"""(log time in ns after EPOCH, content)."""
LogMaker = Callable[..., Path]


@pytest.fixture
def float_log(tmp_path: Path) -> LogMaker:
    """A function that writes an MCAP of std_msgs/Float64 topics: {topic: [(ns, value)]}."""
    from mcap_ros2.writer import Writer

    def make(topics: Mapping[str, Messages], name: str = "log.mcap", **options: Any) -> Path:
        path = tmp_path / name
        with path.open("wb") as stream:
            writer = Writer(stream, **options)
            schema = writer.register_msgdef("std_msgs/msg/Float64", FLOAT)
            everything = [
                (stamp, topic, value) for topic, rows in topics.items() for stamp, value in rows
            ]
            for stamp, topic, value in sorted(everything, key=lambda row: row[0]):
                writer.write_message(
                    topic, schema, {"data": value}, EPOCH + stamp, EPOCH + stamp - 500
                )
            writer.finish()
        return path

    return make


@pytest.fixture
def typed_log(tmp_path: Path) -> LogMaker:
    """A function that writes one topic of any type, in the order given: [(ns, dict)]."""
    from mcap_ros2.writer import Writer

    def make(
        topic: str, kind: str, definition: str, rows: Messages, name: str = "typed.mcap"
    ) -> Path:
        path = tmp_path / name
        with path.open("wb") as stream:
            writer = Writer(stream)
            schema = writer.register_msgdef(kind, definition)
            for stamp, content in rows:
                writer.write_message(topic, schema, content, EPOCH + stamp, EPOCH + stamp)
            writer.finish()
        return path

    return make


@pytest.fixture
def stamped() -> str:
    """The definition of a message with a header and one number."""
    return HEADER
