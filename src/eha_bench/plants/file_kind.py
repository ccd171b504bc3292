"""model.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.core.file_kind import FileKind
from eha_bench.plants.model import ModelFile, load_model

KIND = FileKind("model", frozenset({"model"}), 1, load_model, ModelFile.model_json_schema)
