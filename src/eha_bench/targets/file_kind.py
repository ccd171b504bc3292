"""target.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.core.file_kind import FileKind
from eha_bench.targets.resolve import open_target
from eha_bench.targets.simulator import SimulatorFile

KIND = FileKind("target", frozenset({"target"}), 3, open_target, SimulatorFile.model_json_schema)
