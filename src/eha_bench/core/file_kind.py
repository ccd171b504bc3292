"""The kinds of YAML file: how each is recognised, checked and described to editors.

A kind is one object, registered as an entry point of `eha_bench.file_kinds`, so that
`eha-bench validate` and `eha-bench schema` know the files of plug-ins as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eha_bench.core import plugins, yaml_file
from eha_bench.core.errors import InputError, Place


@dataclass(frozen=True)
class FileKind:
    """A kind of YAML file.

    Attributes:
        name: as in `eha-bench schema NAME`.
        keys: top-level keys of which one is enough to recognise the kind.
        priority: kinds are tried from high to low; more telling keys stand higher.
        check: reads a file and raises an InputError where it is wrong.
        schema: returns the JSON Schema.

    All kinds are loaded to tell which one a file is, so a module that registers one imports what
    checks it inside these functions.
    """

    name: str
    keys: frozenset[str]
    priority: int
    check: Callable[[Path], object]
    schema: Callable[[], dict[str, Any]]


def kinds() -> tuple[FileKind, ...]:
    """Return all registered kinds, the most telling first."""
    found = [plugins.load("file_kinds", name) for name in plugins.names("file_kinds")]
    return tuple(sorted(found, key=lambda kind: (-kind.priority, kind.name)))


def kind_named(name: str) -> FileKind:
    """Return the kind of that name.

    Raises:
        PluginError: no such kind.
    """
    kind = plugins.load("file_kinds", name)
    assert isinstance(kind, FileKind)
    return kind


def kind_of(path: Path) -> FileKind:
    """Return the kind of a YAML file by its top-level keys.

    Raises:
        InputError: not YAML, or of no known kind.
    """
    content = yaml_file.peek(path)
    keys = set(content) if isinstance(content, dict) else set()
    for kind in kinds():
        if kind.keys & keys:
            return kind
    known = "; ".join(f"{kind.name} ({', '.join(sorted(kind.keys))})" for kind in kinds())
    raise InputError(
        "is of no known kind",
        where=Place(file=str(path), line=1),
        hint=f"one of these keys tells the kind: {known}",
    )
