"""dataset.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.diagnosis.data.dataset import load_dataset
    from eha_bench.recordings.channel_map import load_channel_map

    dataset = load_dataset(path)
    for channels in dict.fromkeys(run.channels for run in dataset.runs if run.channels):
        load_channel_map(channels)
    return dataset


def _schema() -> dict[str, Any]:
    from eha_bench.diagnosis.data.dataset import DatasetFile

    return DatasetFile.model_json_schema()


KIND = FileKind("dataset", frozenset({"runs"}), 4, _check, _schema)
