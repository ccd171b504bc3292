"""Files to recordings and back: any log as a `Recording`, and a `Recording` as a file."""

from typing import TYPE_CHECKING

from eha_bench.core.lazy import lazy_names

if TYPE_CHECKING:
    from eha_bench.recordings.bags.rosbag2_metadata import write_rosbag2_metadata
    from eha_bench.recordings.channel_map import ChannelMap, ChannelMapFile, load_channel_map
    from eha_bench.recordings.exporting import export
    from eha_bench.recordings.information import RecordingInformation, TopicInformation, info
    from eha_bench.recordings.live import LiveWriter
    from eha_bench.recordings.reader import read, read_topics
    from eha_bench.recordings.recovery import RecoveryReport, recover
    from eha_bench.recordings.saving import write

__all__ = [
    "ChannelMap",
    "ChannelMapFile",
    "LiveWriter",
    "RecordingInformation",
    "RecoveryReport",
    "TopicInformation",
    "export",
    "info",
    "load_channel_map",
    "read",
    "read_topics",
    "recover",
    "write",
    "write_rosbag2_metadata",
]

# A channel map is checked without a single format's reader.
__getattr__ = lazy_names(
    __name__,
    {
        "ChannelMap": "eha_bench.recordings.channel_map",
        "ChannelMapFile": "eha_bench.recordings.channel_map",
        "LiveWriter": "eha_bench.recordings.live",
        "RecordingInformation": "eha_bench.recordings.information",
        "RecoveryReport": "eha_bench.recordings.recovery",
        "TopicInformation": "eha_bench.recordings.information",
        "export": "eha_bench.recordings.exporting",
        "info": "eha_bench.recordings.information",
        "load_channel_map": "eha_bench.recordings.channel_map",
        "read": "eha_bench.recordings.reader",
        "read_topics": "eha_bench.recordings.reader",
        "recover": "eha_bench.recordings.recovery",
        "write": "eha_bench.recordings.saving",
        "write_rosbag2_metadata": "eha_bench.recordings.bags.rosbag2_metadata",
    },
)
