"""suite.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.core.file_kind import FileKind
from eha_bench.suites.load import load_suite
from eha_bench.suites.schema import suite_schema

KIND = FileKind("suite", frozenset({"trials"}), 10, load_suite, suite_schema)
