"""controller.yaml as a kind of file."""

from __future__ import annotations

from eha_bench.control.controller_file import ControllerFile, load_controllers
from eha_bench.core.file_kind import FileKind
from eha_bench.core.trial import ControlMode

KIND = FileKind(
    "controller",
    frozenset(mode.value for mode in ControlMode),
    0,
    load_controllers,
    ControllerFile.model_json_schema,
)
