"""suite.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.suites.load import load_suite

    suite = load_suite(path)
    for key in ("model", "controller", "target"):
        suite.file(key)
    return suite


def _schema() -> dict[str, Any]:
    from eha_bench.suites.schema import suite_schema

    return suite_schema()


KIND = FileKind("suite", frozenset({"trials"}), 10, _check, _schema, use="eha-bench run FILE")
