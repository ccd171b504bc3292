"""channels.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.core.file_kind import FileKind
from eha_bench.recordings.channel_map import ChannelMapFile, load_channel_map

KIND = FileKind(
    "channels", frozenset({"channels"}), 2, load_channel_map, ChannelMapFile.model_json_schema
)
