"""dataset.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.core.file_kind import FileKind
from eha_bench.diagnosis.dataset import DatasetFile, load_dataset

KIND = FileKind("dataset", frozenset({"runs"}), 4, load_dataset, DatasetFile.model_json_schema)
