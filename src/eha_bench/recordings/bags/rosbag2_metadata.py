"""`metadata.yaml`: makes a folder of our recordings a rosbag2, so that `ros2 bag` takes it.

Format: rosbag2_storage, version 5 (ROS 2 Humble), which later versions read as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.mcap.demux import LOG_TIME
from eha_bench.recordings.mcap.source import McapSource
from eha_bench.recordings.writer import writing

_VERSION = 5


def write_rosbag2_metadata(folder: str | Path) -> Path:
    """Describe all MCAP files of a folder as one rosbag2, in order of time; return the file.

    Call it when the recordings are closed; files that are not MCAP are left out.

    Raises:
        RecordingError: the folder holds no MCAP file, or cannot be written to.
    """
    place = Path(folder)
    files = sorted(place.glob("*.mcap"))
    if not files:
        raise RecordingError(
            "the folder holds no MCAP file", where=Place(file=str(place)), hint="record first"
        )
    parts = [(_BagFile.of(file), file.name) for file in files]
    parts.sort(key=lambda part: (part[0].start, part[1]))
    start = min(part.start for part, _ in parts)
    stop = max(part.stop for part, _ in parts)
    topics: dict[str, tuple[str, str, int]] = {}
    for part, _ in parts:
        for topic, (kind, encoding, count) in part.topics.items():
            topics[topic] = (kind, encoding, topics.get(topic, ("", "", 0))[2] + count)
    content = {
        "rosbag2_bagfile_information": {
            "version": _VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": stop - start},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": sum(count for _, _, count in topics.values()),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic,
                        "type": kind,
                        "serialization_format": encoding,
                        "offered_qos_profiles": "",
                    },
                    "message_count": count,
                }
                for topic, (kind, encoding, count) in topics.items()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name for _, name in parts],
            "files": [
                {
                    "path": name,
                    "starting_time": {"nanoseconds_since_epoch": part.start},
                    "duration": {"nanoseconds": part.stop - part.start},
                    "message_count": sum(count for _, _, count in part.topics.values()),
                }
                for part, name in parts
            ],
        }
    }
    from ruamel.yaml import YAML

    text = StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # annotated None
    yaml.dump(content, text)
    target = place / "metadata.yaml"
    with writing(target) as stream:
        stream.write(text.getvalue().encode())
    return target


@dataclass(frozen=True)
class _BagFile:
    """What one file holds: start and stop in ns, and (type, encoding, count) by topic."""

    start: int
    stop: int
    topics: dict[str, tuple[str, str, int]]

    @classmethod
    def of(cls, file: Path) -> _BagFile:
        """Scan a file."""
        source = McapSource(file)
        counts: dict[int, int] = {}
        start, stop = 2**63 - 1, 0
        for split in source.reader.splits(None):
            for channel, payloads in split.messages:
                stamps = payloads.column(LOG_TIME, "<i8")
                start = min(start, int(stamps.min()))
                stop = max(stop, int(stamps.max()))
                counts[channel] = counts.get(channel, 0) + payloads.count
        topics: dict[str, tuple[str, str, int]] = {}
        for number, channel_record in source.file.channels.items():
            schema = source.file.schemas.get(channel_record.schema_id)
            before = topics.get(channel_record.topic, ("", "", 0))[2]
            topics[channel_record.topic] = (
                schema.name if schema else "",
                channel_record.message_encoding,
                before + counts.get(number, 0),
            )
        return cls(start if counts else 0, stop, topics)
