"""controller.yaml as a kind of file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind
from eha_bench.core.trial import MODES


def _check(path: Path) -> object:
    from eha_bench.control.controller_file import load_controllers

    return load_controllers(path)


def _schema() -> dict[str, Any]:
    from eha_bench.control.controller_file import ControllerFile

    return ControllerFile.model_json_schema()


def _blocks(content: Mapping[Any, Any]) -> bool:
    """Whether a block of any name says what controller it is of."""
    return any(isinstance(block, dict) and "controller" in block for block in content.values())


KIND = FileKind(
    "controller",
    frozenset((*(mode.name for mode in MODES), "extends")),
    0,
    _check,
    _schema,
    recognises=_blocks,
    use="a line 'controller: FILE' of a target or suite",
)
