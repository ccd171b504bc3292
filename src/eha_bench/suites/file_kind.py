"""suite.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.file_kind import FileKind

if TYPE_CHECKING:
    from eha_bench.suites.suite import Suite


def _check(path: Path) -> Suite:
    from eha_bench.suites.load import load_suite

    suite = load_suite(path)
    for key in ("model", "controller", "target"):
        suite.file(key)
    return suite


def _remarks(suite: Suite) -> list[str]:
    from eha_bench.suites.remarks import remarks

    return remarks(suite)


def _schema() -> dict[str, Any]:
    from eha_bench.suites.schema import suite_schema

    return suite_schema()


KIND = FileKind(
    "suite", frozenset({"trials"}), 10, _check, _schema, _remarks, use="eha-bench run FILE"
)
