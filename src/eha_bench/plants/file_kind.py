"""model.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.plants.model import load_model

    return load_model(path)


def _schema() -> dict[str, Any]:
    from eha_bench.plants.model_file import ModelFile

    return ModelFile.model_json_schema()


KIND = FileKind("model", frozenset({"model"}), 1, _check, _schema)
