"""vary.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.tuning.vary_file import load_vary

    return load_vary(path)


def _schema() -> dict[str, Any]:
    from eha_bench.tuning.vary_file import VaryForm

    return VaryForm.model_json_schema()


KIND = FileKind(
    "vary",
    frozenset({"vary"}),
    5,
    _check,
    _schema,
    title="vary file",
    use="eha-bench tune SUITE --vary FILE",
)
