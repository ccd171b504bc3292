"""channels.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.file_kind import FileKind

if TYPE_CHECKING:
    from eha_bench.recordings.channel_map import ChannelMapFile


def _check(path: Path) -> object:
    from eha_bench.recordings.channel_map import load_channel_map

    return load_channel_map(path)


def _schema() -> dict[str, Any]:
    from eha_bench.recordings.channel_map import ChannelMapFile

    return ChannelMapFile.model_json_schema()


def _remarks(mapping: ChannelMapFile) -> list[str]:
    return mapping.strangers()


KIND = FileKind(
    "channels",
    frozenset({"channels"}),
    2,
    _check,
    _schema,
    _remarks,
    title="channel map",
    use="eha-bench score LOG --channels FILE",
)
