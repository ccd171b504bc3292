"""target.yaml as a kind of file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eha_bench.core.file_kind import FileKind


def _check(path: Path) -> object:
    from eha_bench.targets.resolve import open_target

    return open_target(path)


def _schema() -> dict[str, Any]:
    from pydantic import TypeAdapter

    from eha_bench.targets.can.target_file import CanTargetFile
    from eha_bench.targets.fmu.target_file import FmuFile
    from eha_bench.targets.simulator import SimulatorFile

    kinds: TypeAdapter[Any] = TypeAdapter(SimulatorFile | CanTargetFile | FmuFile)
    return kinds.json_schema()


KIND = FileKind(
    "target", frozenset({"target"}), 3, _check, _schema, use="eha-bench run SUITE --target FILE"
)
