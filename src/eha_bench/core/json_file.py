"""JSON files that eha-bench wrote, read back with an error that names the file and the way out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from eha_bench.core import yaml_file
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.file_kind import kind_by_keys
from eha_bench.core.input_files import note_input


def read_object(path: Path, what: str, hint: str) -> dict[str, Any]:
    """Return the object that a JSON file holds.

    Args:
        path: the file. what: its usual name, e.g. `diagnosis.json`. hint: where it comes from.

    Raises:
        InputError: no such file, no JSON, or no object; a YAML file of ours is named by its kind.
    """
    where = Place(file=str(path))
    note_input(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"no such {what}", where=where, hint=hint) from error
    except (OSError, ValueError) as error:
        raise InputError(_not_json(path, what, error), where=where, hint=hint) from error
    if not isinstance(content, dict):
        raise InputError(f"this is not a {what}", where=where, hint=hint)
    return content


def _not_json(path: Path, what: str, error: Exception) -> str:
    try:
        kind = kind_by_keys(yaml_file.peek(path))
    except EhaBenchError:
        kind = None
    if kind is not None:
        return f"this is a {kind.name} file, and a {what} is expected"
    return f"cannot be read as JSON ({error})"
