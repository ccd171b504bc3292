"""A plug-in's class held against its base: nothing required is missing, no name is misspelt.

What a base class offers with a default can be misspelt without a word from Python: a target with
`make_saf` would run, and never take its torque off.
"""

from __future__ import annotations

import inspect
from typing import Any

from eha_bench.core.errors import Place, PluginError
from eha_bench.core.near_miss import nearest

_LIKENESS = 0.85
"""Of a public name to the one that it is taken for, 0 to 1. `makesafe` has 0.94 to `make_safe`, and
the innocent `current` 0.82 to `concurrent`."""


def check_class(kind: type, base: type, name: str, *, where: Place | None = None) -> None:
    """Refuse a class that lacks what its base requires, or misspells what that calls.

    Args:
        kind: the plug-in's class. base: the one that it is derived from.
        name: what a sentence calls it: `target 'press'`. where: the file that asks for it.

    Raises:
        PluginError: a required method is missing, or a public name is all but one of the base's
            that the class does not define.
    """
    own = sorted(_public(kind) - _public(base))
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        near = nearest(missing[0], own)
        raise PluginError(
            f"{name} does not define {' and '.join(missing)}",
            where=where,
            hint=f"write the method, or {f'rename {near!r}' if near else 'check its name'}",
        )
    inherited = [other for other in sorted(_public(base)) if not _defines(kind, base, other)]
    for other in own:
        near = nearest(other, inherited, likeness=_LIKENESS)
        if near:
            raise PluginError(
                f"{name} defines '{other}', which nothing calls",
                where=where,
                hint=f"did you mean '{near}'? What is its own begins with an underscore",
            )


def check_attributes(plugin: Any, base: type, name: str, *, where: Place | None = None) -> None:
    """Refuse an instance without an attribute that its base declares and gives no value.

    Raises:
        PluginError: one is missing.
    """
    declared = [
        attribute
        for each in base.__mro__
        for attribute in inspect.get_annotations(each)
        if not hasattr(base, attribute)
    ]
    missing = [attribute for attribute in declared if not hasattr(plugin, attribute)]
    if missing:
        raise PluginError(
            f"{name} does not have {' and '.join(missing)}",
            where=where,
            hint=f"set {'it' if len(missing) == 1 else 'them'} in the class, or in __init__",
        )


def _public(kind: type) -> set[str]:
    """Public names of a class and its bases."""
    return {name for each in kind.__mro__ for name in vars(each) if not name.startswith("_")}


def _defines(kind: type, base: type, name: str) -> bool:
    """Whether a class below the base defines a name."""
    above = base.__mro__
    return any(name in vars(each) for each in kind.__mro__ if each not in above)
