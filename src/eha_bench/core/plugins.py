"""Plug-ins by entry point: the built-in ones register the same way as others.

A Python class named as `module:Class` is loaded only where a file given on the command line names
it; nothing that a recording holds is ever loaded.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from eha_bench.core.errors import Place, PluginError
from eha_bench.core.near_miss import suggest


@cache
def _entry_points() -> Any:
    """Return those of all groups: one group takes as long to find, and commands ask for several."""
    return entry_points()


@cache
def _group(name: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name.

    Raises:
        PluginError: two packages give one name to different things: neither may hide the other.
    """
    found: dict[str, EntryPoint] = {}
    for point in sorted(_entry_points().select(group=f"eha_bench.{name}")):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise PluginError(
                f"two packages provide the {name[:-1].replace('_', ' ')} '{point.name}': "
                f"{_provider(other)} and {_provider(point)}",
                hint="uninstall one of them, or rename what is yours",
            )
    return found


def _provider(point: EntryPoint) -> str:
    package = point.dist.name if point.dist is not None else "an unknown package"
    return f"{package} ({point.value})"


def names(group: str) -> tuple[str, ...]:
    """Return the names registered in a group, e.g. targets, signals, metrics."""
    return tuple(_group(group))


def load(group: str, name: str, *, where: Place | None = None) -> Any:
    """Return the object that the entry point `name` of `eha_bench.<group>` refers to.

    Raises:
        PluginError: no such entry point, or its module cannot be imported.
    """
    point = _group(group).get(name)
    if point is None:
        hint = suggest(name, names(group))
        what = group[:-1].replace("_", " ")
        raise PluginError(f"unknown {what} '{name}'", where=where, hint=hint)
    try:
        return point.load()
    except Exception as error:
        raise PluginError(
            f"{group[:-1]} '{name}' cannot be loaded ({type(error).__name__}: {error})",
            where=where,
            hint=f"check the package that provides {point.value}",
        ) from error


def module_of(group: str, name: str) -> ModuleType:
    """Return the module in which the entry point `name` of `eha_bench.<group>` stands.

    Raises:
        PluginError: as `load` does.
    """
    load(group, name)
    return sys.modules[_group(group)[name].module]


def check_id(what: str, name: str, found: str) -> None:
    """Refuse a plug-in whose entry point has another name than it: it could hide one that ships.

    Args:
        what: `effect`, `element`. name: of the entry point. found: what the plug-in says.

    Raises:
        PluginError: they differ.
    """
    if found != name:
        raise PluginError(
            f"the entry point '{name}' of eha_bench.{what}s names the {what} '{found}'",
            hint=f"give the entry point and the {what} one id",
        )


_unseen: ContextVar[list[str] | None] = ContextVar("unseen", default=None)


@contextmanager
def running_nothing() -> Iterator[list[str]]:
    """Import no class that a file names, as long as files are only checked.

    Yields:
        The classes that were not looked into, in the order in which they were met.
    """
    found: list[str] = []
    token = _unseen.set(found)
    try:
        yield found
    finally:
        _unseen.reset(token)


def load_class(
    reference: str, *, base: Path | None = None, where: Place | None = None
) -> Any | None:
    """Import `module:Class`; `base` is put first on the search path (the YAML file's folder).

    Returns:
        The class; None inside of `running_nothing`.

    Raises:
        PluginError: the text is not `module:Class`, or it cannot be imported.
    """
    module_name, colon, attribute = reference.partition(":")
    if not colon or not module_name or not attribute:
        raise PluginError(f"'{reference}' is not of the form module:Class", where=where)
    unseen = _unseen.get()
    if unseen is not None:
        unseen.append(reference)
        return None
    if base is not None and str(base) not in sys.path:
        sys.path.insert(0, str(base))
    try:
        return getattr(importlib.import_module(module_name), attribute)
    except Exception as error:
        raise PluginError(
            f"'{reference}' cannot be loaded ({type(error).__name__}: {error})",
            where=where,
            hint="the module must be importable, or in the same folder as the file that names it",
        ) from error
