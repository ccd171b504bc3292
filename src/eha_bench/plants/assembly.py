"""Puts a plant's kernel together from its equations and all registered effects, compiled once.

The kernel module of a plant imports its hooks (places where effects act) from a module in which
they do nothing. Here a module is written in which each hook is the chain of the effects that use
it, followed by the kernel's own source; Numba compiles it and caches the result on disk. Every
effect's parameters live in the one parameter vector `P`, so trying another candidate is another
vector, never another compilation. An effect is skipped by a branch where its strength is neutral.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import PluginError
from eha_bench.plants.effect import Effect
from eha_bench.plants.parameter import Parameter

_VECTORS = ("P", "S")


@dataclass(frozen=True)
class Layout:
    """Where each parameter and effect state lives in the vectors `P` and `S`.

    Attributes:
        plant: plant id.
        parameters: the plant's own, first in `P`.
        effects: registered effects that apply to the plant, in the order of their ids.
    """

    plant: str
    parameters: tuple[Parameter, ...]
    effects: tuple[Effect, ...]

    @cached_property
    def index(self) -> dict[str, int]:
        """Place of each parameter: `name` for the plant's, `effect.name` for an effect's."""
        places: dict[str, int] = {}
        position = 0
        for key, parameter in self.items():
            places[key] = position
            position += parameter.size
        return places

    def items(self) -> Iterable[tuple[str, Parameter]]:
        """All parameters with their keys, in the order of `P`."""
        for parameter in self.parameters:
            yield parameter.name, parameter
        for effect in self.effects:
            for parameter in effect.parameters:
                yield f"{effect.id}.{parameter.name}", parameter

    @cached_property
    def by_key(self) -> dict[str, Parameter]:
        """Parameters by key."""
        return dict(self.items())

    @cached_property
    def states(self) -> dict[str, int]:
        """Place of each effect's state in `S`, as `effect.state`."""
        names = [f"{effect.id}.{state}" for effect in self.effects for state in effect.states]
        return {name: position for position, name in enumerate(names)}

    @property
    def size(self) -> int:
        """Length of `P`."""
        return sum(parameter.size for _, parameter in self.items())

    def defaults(self) -> NDArray[np.float64]:
        """Return `P` with the plant's defaults and every effect off."""
        vector = np.zeros(self.size)
        for key, parameter in self.items():
            at = self.index[key]
            vector[at : at + parameter.size] = parameter.default
        for effect in self.effects:
            vector[self.index[f"{effect.id}.{effect.strength.name}"]] = effect.neutral
        return vector

    def effect(self, name: str) -> Effect:
        """Return a registered effect of this plant.

        Raises:
            PluginError: no such effect, or not for this plant.
        """
        for effect in self.effects:
            if effect.id == name:
                return effect
        known = ", ".join(effect.id for effect in self.effects)
        raise PluginError(f"unknown effect '{name}' for {self.plant}", hint=f"known: {known}")


def assemble(layout: Layout, kernel: ModuleType, hooks: ModuleType) -> ModuleType:
    """Return the kernel module with the layout's effects in its hooks.

    Raises:
        PluginError: an effect names a hook or a quantity that the plant does not have.
    """
    text = _compose(layout, kernel, hooks)
    digest = hashlib.sha256(text.encode())
    digest.update(f"{numba.__version__} {np.__version__}".encode())
    for module in sorted({_module_of(function) for function in _functions(layout)}):
        digest.update(inspect.getsource(sys.modules[module]).encode())
    name = f"eha_bench_kernel_{layout.plant}_{digest.hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    path = _write(name, text)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"the kernel of {layout.plant} cannot be loaded from {path}")
    module_object = importlib.util.module_from_spec(spec)
    sys.modules[name] = module_object
    spec.loader.exec_module(module_object)
    return module_object


def kernel_folder() -> Path:
    """Folder of the generated kernels: `$EHA_BENCH_CACHE`, or the user's cache folder."""
    base = os.environ.get("EHA_BENCH_CACHE")
    if base:
        return Path(base)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eha-bench"


def _write(name: str, text: str) -> Path:
    folder = kernel_folder()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if not path.exists():
        temporary = folder / f".{name}.{os.getpid()}.part"
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    return path


def _module_of(function: Callable[..., object]) -> str:
    return str(function.__module__)


def _functions(layout: Layout) -> list[Callable[..., object]]:
    found: list[Callable[..., object]] = []
    for effect in layout.effects:
        found += effect.action(layout.plant).hooks.values()
        found += [*effect.advance.values(), *effect.start.values()]
    return found


def _compose(layout: Layout, kernel: ModuleType, hooks: ModuleType) -> str:
    lines = ['"""Generated: the kernel with all registered effects in its hooks."""', ""]
    lines += ["from numba import njit", ""]
    signatures = {
        name: list(inspect.signature(item.py_func).parameters)
        for name, item in vars(hooks).items()
        if hasattr(item, "py_func")
    }
    bodies: dict[str, list[str]] = {name: [] for name in signatures}
    for number, effect in enumerate(layout.effects):
        strength = layout.index[f"{effect.id}.{effect.strength.name}"]
        guard = f"    if P[{strength}] != {effect.neutral!r}:"
        action = effect.action(layout.plant)
        uses: list[tuple[str, str, Callable[..., object]]] = []
        for hook, function in action.hooks.items():
            if hook not in signatures:
                raise PluginError(
                    f"effect '{effect.id}' uses the hook '{hook}' that {layout.plant} does not have"
                )
            uses.append((hook, signatures[hook][0], function))
        for state, function in effect.start.items():
            uses.append(("start_states", f"S[{layout.states[f'{effect.id}.{state}']}]", function))
        for state, function in effect.advance.items():
            uses.append(("advance_states", f"S[{layout.states[f'{effect.id}.{state}']}]", function))
        for serial, (hook, changed, function) in enumerate(uses):
            alias = f"_e{number}_{serial}"
            lines.append(f"from {_module_of(function)} import {function.__name__} as {alias}_py")
            lines.append(f"{alias} = njit({alias}_py)")
            arguments = _arguments(layout, effect, function, signatures[hook])
            bodies[hook] += [guard, f"        {changed} = {alias}({arguments})"]
    for name, body in bodies.items():
        arguments = signatures[name]
        returns = [] if name.endswith("_states") else [f"    return {arguments[0]}"]
        lines += ["", "", "@njit", f"def {name}({', '.join(arguments)}):"]
        lines += (body + returns) or ["    pass"]
    source = inspect.getsource(kernel)
    before, marker, after = source.partition(f"from {hooks.__name__} import (")
    if not marker:
        raise PluginError(f"the kernel {kernel.__name__} does not import its hooks")
    rest = after[after.index(")") + 1 :]
    preamble = before[before.index("import math") :]
    return "\n".join([*lines, "", "", preamble, rest])


def _arguments(
    layout: Layout, effect: Effect, function: Callable[..., object], have: list[str]
) -> str:
    parts = []
    own = {parameter.name: parameter for parameter in effect.parameters}
    for name in inspect.signature(function).parameters:
        key = f"{effect.id}.{name}"
        if key in layout.states:
            parts.append(f"S[{layout.states[key]}]")
        elif name in own:
            at = layout.index[key]
            size = own[name].size
            parts.append(f"P[{at}]" if size == 1 else f"P[{at}:{at + size}]")
        elif name in have and name not in _VECTORS:
            parts.append(name)
        elif name in layout.index:
            parts.append(f"P[{layout.index[name]}]")
        else:
            raise PluginError(
                f"effect '{effect.id}' asks for '{name}' in {function.__name__}",
                hint=f"there: {', '.join(n for n in have if n not in _VECTORS)}, "
                "parameters of the plant, its own parameters and states",
            )
    return ", ".join(parts)
