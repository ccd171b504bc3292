"""Files to recordings and back: any log as a `Recording`, and a `Recording` as MCAP."""

from eha_bench.recordings.channel_map import ChannelMap, ChannelMapFile, load_channel_map
from eha_bench.recordings.information import RecordingInformation, TopicInformation, info
from eha_bench.recordings.live import LiveWriter
from eha_bench.recordings.reader import read
from eha_bench.recordings.recover import RecoveryReport, recover
from eha_bench.recordings.rosbag2_metadata import write_rosbag2_metadata
from eha_bench.recordings.writer import write

__all__ = [
    "ChannelMap",
    "ChannelMapFile",
    "LiveWriter",
    "RecordingInformation",
    "RecoveryReport",
    "TopicInformation",
    "info",
    "load_channel_map",
    "read",
    "recover",
    "write",
    "write_rosbag2_metadata",
]
