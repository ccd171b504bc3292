"""The kinds of YAML file: how each is recognised, checked and described to editors.

A kind is one object, registered as an entry point of `eha_bench.file_kinds`, so that
`eha-bench validate` and `eha-bench schema` know the files of plug-ins as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eha_bench.core import plugins
from eha_bench.core.errors import PluginError


@dataclass(frozen=True)
class FileKind:
    """A kind of YAML file.

    Attributes:
        name: as in `eha-bench schema NAME`.
        keys: top-level keys of which one is enough to recognise the kind.
        priority: kinds are tried from high to low; more telling keys stand higher.
        check: reads a file and raises an InputError where it is wrong.
        schema: returns the JSON Schema.
        remarks: says what is allowed in a checked file, and may not be meant.
        model: reads the file as a model that can be simulated; None for files that hold none.
        recognises: whether content without any of the keys is of this kind all the same.
        title: what a sentence calls it, `name` if that will do.
        use: the command that takes it.

    All kinds are loaded to tell which one a file is, so a module that registers one imports what
    checks it inside these functions.
    """

    name: str
    keys: frozenset[str]
    priority: int
    check: Callable[[Path], object]
    schema: Callable[[], dict[str, Any]]
    remarks: Callable[[Any], Sequence[str]] = field(default=lambda _: ())
    model: Callable[[Path], object] | None = None
    recognises: Callable[[Mapping[Any, Any]], bool] | None = None
    title: str = ""
    use: str = ""

    def __post_init__(self) -> None:
        """Call a kind by its name by default."""
        object.__setattr__(self, "title", self.title or self.name)


def kinds() -> tuple[FileKind, ...]:
    """Return all registered kinds, the most telling first."""
    found = [kind_named(name) for name in plugins.names("file_kinds")]
    return tuple(sorted(found, key=lambda kind: (-kind.priority, kind.name)))


def kind_named(name: str) -> FileKind:
    """Return the kind of that name.

    Raises:
        PluginError: no such kind, or it is not a FileKind.
    """
    kind = plugins.load("file_kinds", name)
    if not isinstance(kind, FileKind):
        raise PluginError(f"file kind '{name}' is not a FileKind but {type(kind).__name__}")
    return kind


def kind_by_keys(content: object) -> FileKind | None:
    """Return the kind that the top-level keys tell; None where they tell none."""
    if not isinstance(content, dict) or not content:
        return None
    for kind in kinds():
        if kind.keys & set(content) or (kind.recognises and kind.recognises(content)):
            return kind
    return None
