"""Names of a package that are imported when they are first used, so that its rooms load apart."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def later(module: str, name: str) -> Callable[..., Any]:
    """Return a function of another room that is imported when it is first called.

    With it an object of the floor offers what rooms above it do: `recording.plot()`.
    """

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(importlib.import_module(module), name)(*arguments, **options)

    return call


def lazy_names(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a package's `__getattr__` (PEP 562): name -> the object in its home module.

    Args:
        package: the package's name, for messages.
        homes: public name -> full name of the module that holds it.

    Raises:
        AttributeError: (the returned function) the package has no such name.
    """

    def find(name: str) -> Any:
        home = homes.get(name)
        if home is None:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(importlib.import_module(home), name)

    return find
