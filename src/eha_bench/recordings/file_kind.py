"""channels.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.recordings.channel_map import load_channel_map

    return load_channel_map(path)


def _schema() -> dict[str, Any]:
    from eha_bench.recordings.channel_map import ChannelMapFile

    return ChannelMapFile.model_json_schema()


KIND = FileKind("channels", frozenset({"channels"}), 2, _check, _schema)
