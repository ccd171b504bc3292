"""controller.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind
from eha_bench.core.trial import ControlMode


def _check(path: Path) -> object:
    from eha_bench.control.controller_file import load_controllers

    return load_controllers(path)


def _schema() -> dict[str, Any]:
    from eha_bench.control.controller_file import ControllerFile

    return ControllerFile.model_json_schema()


KIND = FileKind("controller", frozenset(mode.value for mode in ControlMode), 0, _check, _schema)
