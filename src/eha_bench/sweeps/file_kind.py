"""sweep.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.sweeps.sweep_file import load_sweep

    return load_sweep(path)


def _schema() -> dict[str, Any]:
    from eha_bench.sweeps.sweep_file import SweepForm

    return SweepForm.model_json_schema()


KIND = FileKind(
    "sweep",
    frozenset({"over"}),
    5,
    _check,
    _schema,
    use="eha-bench sweep SUITE --over FILE",
)
