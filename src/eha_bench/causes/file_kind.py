"""nightly.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.causes.settings import load_cause_settings
    from eha_bench.trends.nightly_file import load_nightly

    nightly = load_nightly(path)
    return nightly if nightly.diagnose is None else load_cause_settings(path)


def _schema() -> dict[str, Any]:
    from eha_bench.trends.nightly_file import Nightly

    return Nightly.model_json_schema()


KIND = FileKind(
    "nightly", frozenset({"send", "diagnose"}), 5, _check, _schema,
    title="nightly file", use="eha-bench history DIR --config FILE",
)  # fmt: skip
