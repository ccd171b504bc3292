"""Writes the source of a kernel: the plant's hooks filled with the effects, then its own modules.

A function of an effect names what it needs. A name stands for the effect's own state or parameter,
a quantity of the hook, a measured signal, or a parameter of the plant; an argument annotated with a
NamedTuple gets each of its fields in the same way.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable, Mapping
from types import ModuleType

from eha_bench.core.errors import PluginError
from eha_bench.plants import compiled
from eha_bench.plants.effect import Effect
from eha_bench.plants.layout import Layout

_VECTORS = ("P", "S")

# Dividing needs no test for zero: all of them together take long to compile. What is cached is what
# Python calls; the rest is compiled into it.
_HEAD = """import math

import numba
import numpy as np
from numpy.typing import NDArray

from eha_bench.plants.compiled import njit as inner
from eha_bench.plants.pointer import behind, pointer


def njit(function=None, **options):
    kind = numba.njit if "cache" in options else inner
    mark = kind(error_model="numpy", **options)
    return mark if function is None else mark(function)

"""


def compose(layout: Layout, modules: tuple[ModuleType, ...], hooks: ModuleType) -> str:
    """Return the kernel's source: the hooks filled with the effects, then its own modules."""
    signatures = {
        name: list(inspect.signature(getattr(hooks, name).py_func).parameters)
        for name in layout.hooks
    }
    lines = ['"""Generated: the kernel with all registered effects in its hooks."""', "", _HEAD]
    bodies: dict[str, list[str]] = {name: [] for name in signatures}
    guards: dict[str, list[str]] = {name: [] for name in signatures}
    for number, effect in enumerate(sorted(layout.effects, key=lambda e: (e.order, e.id))):
        strength = layout.index[f"{effect.id}.{effect.strength.name}"]
        guard = f"P[{strength}] != {effect.neutral!r}"
        for serial, (hook, changed, function) in enumerate(_uses(layout, effect, signatures)):
            alias = f"_e{number}_{serial}"
            lines.append(f"from {function.__module__} import {function.__name__} as {alias}_py")
            for group in _groups(function).values():
                lines.append(f"from {group.__module__} import {group.__name__} as {_alias(group)}")
            lines.append(f"{alias} = njit({alias}_py)")
            arguments = _arguments(layout, effect, function, signatures[hook])
            bodies[hook] += [f"    if {guard}:", f"        {changed} = {alias}({arguments})"]
            guards[hook].append(guard)
    lines += ["", "", "@njit", "def activate(P, S):"]
    for name, place in layout.flags.items():
        test = " or ".join(guards[name])
        lines.append(f"    S[{place}] = {f'1.0 if {test} else 0.0' if test else '0.0'}")
    for name, body in bodies.items():
        lines += _hook(name, signatures[name], body, layout.flags[name])
    replaced = {"__future__", compiled.__name__, hooks.__name__, *(m.__name__ for m in modules)}
    own = [_without_imports(module, replaced) for module in modules]
    return "\n".join([*lines, "", "", *own])


def _uses(
    layout: Layout, effect: Effect, signatures: Mapping[str, list[str]]
) -> Iterable[tuple[str, str, Callable[..., object]]]:
    """Yield (hook, quantity that is changed, function) for all that an effect does."""
    action = effect.action(layout.plant)
    for hook, function in action.hooks.items():
        if hook not in signatures:
            raise PluginError(
                f"effect '{effect.id}' uses the hook '{hook}' that {layout.plant} does not have",
                hint=f"it has: {', '.join(signatures)}",
            )
        yield hook, signatures[hook][0], function
    start, advance = action.start or effect.start, action.advance or effect.advance
    for hook, functions in (("start_states", start), ("advance_states", advance)):
        for state, function in functions.items():
            yield hook, f"S[{layout.states[f'{effect.id}.{state}']}]", function


def _hook(name: str, arguments: list[str], body: list[str], flag: int) -> list[str]:
    """Return the lines of a hook: one cheap test, and the chain of effects behind it."""
    listed = ", ".join(arguments)
    state = name.endswith("_states")
    back = [] if state else [f"    return {arguments[0]}"]
    if not body:
        return ["", "", "@njit", f"def {name}({listed}):", *(back or ["    pass"])]
    call = f"_chain_{name}({listed})"
    return [
        *("", "", "@njit", f"def _chain_{name}({listed}):", *body, *back),
        *("", "", "@njit", f"def {name}({listed}):", f"    if S[{flag}] != 0.0:"),
        f"        {'' if state else 'return '}{call}",
        *back,
    ]


def _without_imports(module: ModuleType, replaced: set[str]) -> str:
    """Return a module's source without what it imports from the replaced modules."""
    source = inspect.getsource(module)
    lines = source.splitlines()
    for node in ast.parse(source).body:
        if isinstance(node, ast.ImportFrom) and node.module in replaced:
            for number in range(node.lineno - 1, node.end_lineno or node.lineno):
                lines[number] = ""
    return "\n".join(lines)


def _groups(function: Callable[..., object]) -> dict[str, type]:
    """Return the NamedTuples that a function takes, by the names of its arguments."""
    found = {}
    for name, said in function.__annotations__.items():
        kind = function.__globals__.get(said) if isinstance(said, str) else said
        if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
            found[name] = kind
    return found


def _alias(group: type) -> str:
    return f"_{group.__module__.replace('.', '_')}_{group.__name__}"


def _arguments(
    layout: Layout, effect: Effect, function: Callable[..., object], have: list[str]
) -> str:
    """Return the arguments that bind a function's names, and its NamedTuples' fields, to values."""

    def bound(name: str) -> str:
        found = _bound(layout, effect, name, have)
        if found is None:
            raise PluginError(
                f"effect '{effect.id}' asks for '{name}' in {function.__name__}",
                hint=f"there: {', '.join(n for n in have if n not in _VECTORS)}, "
                f"{', '.join(layout.signals)}, the plant's parameters, its own, its states",
            )
        return found

    groups = _groups(function)
    parts = []
    for name in inspect.signature(function).parameters:
        if name in groups:
            fields = (bound(field) for field in groups[name].__annotations__)
            parts.append(f"{_alias(groups[name])}({', '.join(fields)})")
        else:
            parts.append(bound(name))
    return ", ".join(parts)


def _bound(layout: Layout, effect: Effect, name: str, have: list[str]) -> str | None:
    """Return what a name stands for in a hook, None where it stands for nothing."""
    key = f"{effect.id}.{name}"
    if key in layout.states:
        return f"S[{layout.states[key]}]"
    if key in layout.index:
        return _parameter(layout, key)
    if name in have and name not in _VECTORS:
        return name
    if name in layout.signals:
        return f"S[{layout.signals.index(name)}]"
    return _parameter(layout, name) if name in layout.index else None


def _parameter(layout: Layout, key: str) -> str:
    """Return a parameter's value in `P`, as an array where it has several."""
    place, size = layout.index[key], layout.by_key[key].size
    return f"P[{place}]" if size == 1 else f"numba.carray(behind(P, {place}), {size})"


def modules_of(layout: Layout) -> set[str]:
    """Return the names of the modules whose source decides what the effects compile to."""
    seen: set[Callable[..., object]] = set()
    waiting = [function for effect in layout.effects for function in _functions(layout, effect)]
    while waiting:
        function = waiting.pop()
        if function not in seen:
            seen.add(function)
            namespace = function.__globals__
            helpers = [
                getattr(namespace.get(n), "py_func", None) for n in function.__code__.co_names
            ]
            waiting += [helper for helper in helpers if helper is not None]
    return {function.__module__ for function in seen}


def _functions(layout: Layout, effect: Effect) -> list[Callable[..., object]]:
    action = effect.action(layout.plant)
    return [
        *action.hooks.values(),
        *(action.advance or effect.advance).values(),
        *(action.start or effect.start).values(),
    ]
