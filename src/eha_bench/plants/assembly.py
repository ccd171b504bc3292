"""Puts a plant's kernel together from its equations and all registered effects, compiled once.

The kernel modules of a plant import its hooks (places where effects act) from a module in which
they do nothing. Here a module is written in which each hook is the chain of the effects that use
it, followed by the kernel's own source; Numba compiles it and caches the result on disk. Every
effect's parameters live in the one parameter vector `P`, so trying another candidate is another
vector, never another compilation. An effect is skipped by a branch where its strength is neutral.

Inside the kernel `P` and `S` are records over the vectors' memory: a record is one bare pointer,
while Numba counts the references of every array that it passes on, which took longer than the
equations.
"""

from __future__ import annotations

import ast
import atexit
import hashlib
import importlib.util
import inspect
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import PluginError
from eha_bench.plants import compiled
from eha_bench.plants.effect import Effect, Equation
from eha_bench.plants.parameter import Parameter

SENSOR = "measured_"
"""How the names of the hooks begin where what a sensor reads is changed."""

_VECTORS = ("P", "S")
# functions of a hooks module that are no hooks: written anew for each layout
_GENERATED = ("parameter_record", "memory_record", "activate")
_LOG = logging.getLogger("eha_bench")

# Inner functions need no way in from Python, and dividing needs no test for zero: both halve the
# time that compiling takes.
_HEAD = """import math

import numba
import numpy as np
from numpy.typing import NDArray


def njit(function=None, **options):
    if function is None and not options:
        return njit
    if function is None:
        return numba.njit(error_model="numpy", **options)
    lean = numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
    return lean(function)

"""


@dataclass(frozen=True)
class Layout:
    """Where each parameter and effect state lives in the vectors `P` and `S`.

    Attributes:
        plant: plant id.
        parameters: the plant's own, first in `P`.
        effects: registered effects that apply to the plant, in the order of their ids.
        hooks: names of the places where effects act, each with a flag in `S` that says whether
            any effect is on there.
        signals: measured signals that effects may look at by name, first in `S`.
    """

    plant: str
    parameters: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    hooks: tuple[str, ...]
    signals: tuple[str, ...] = ()

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
    def flags(self) -> dict[str, int]:
        """Place of each hook's flag in `S`, after the signals."""
        return {name: place for place, name in enumerate(self.hooks, len(self.signals))}

    @cached_property
    def states(self) -> dict[str, int]:
        """Place of each effect's state in `S`, as `effect.state`."""
        names = [f"{effect.id}.{state}" for effect in self.effects for state in effect.states]
        first = len(self.signals) + len(self.hooks)
        return {name: position for position, name in enumerate(names, first)}

    @property
    def memory(self) -> int:
        """Length of `S`: signals, flags of the hooks, effects' states."""
        return max(1, len(self.signals) + len(self.hooks) + len(self.states))

    @cached_property
    def ordinals(self) -> dict[str, int]:
        """Number of each parameter among the fields of the record over `P`."""
        return {key: number for number, (key, _) in enumerate(self.items())}

    @property
    def size(self) -> int:
        """Length of `P`."""
        return sum(parameter.size for _, parameter in self.items())

    @cached_property
    def _senses(self) -> tuple[tuple[Effect, ...], NDArray[np.intp], NDArray[np.float64]]:
        """Effects that may act on what sensors read, places of their strengths, neutral values."""
        found = tuple(
            effect
            for effect in self.effects
            if any(hook.startswith(SENSOR) for hook in effect.action(self.plant).hooks)
        )
        places = [self.index[f"{effect.id}.{effect.strength.name}"] for effect in found]
        return found, np.array(places, dtype=np.intp), np.array([item.neutral for item in found])

    def sensors_are_ideal(self, vector: NDArray[np.float64]) -> bool:
        """Whether every sensor reads the state itself with these parameters."""
        effects, places, neutral = self._senses
        on = np.flatnonzero(vector[places] != neutral)
        return not any(self._acts_on_a_sensor(effects[k], vector) for k in on)

    def _acts_on_a_sensor(self, effect: Effect, vector: NDArray[np.float64]) -> bool:
        """Whether an effect is one of measurement, with the choice that decides its equation."""
        choice = effect.action(self.plant).chosen_by
        values = {choice: float(vector[self.index[f"{effect.id}.{choice}"]])} if choice else {}
        return effect.equation(self.plant, values) is Equation.MEASUREMENT

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


def hook_names(hooks: ModuleType) -> tuple[str, ...]:
    """Return the names of the compiled functions of a module of hooks, in its order."""
    return tuple(
        name
        for name, item in vars(hooks).items()
        if hasattr(item, "py_func") and name not in _GENERATED
    )


def assemble(
    layout: Layout, modules: tuple[ModuleType, ...], hooks: ModuleType, entry: str = "simulate"
) -> ModuleType:
    """Return the kernel with the layout's effects in its hooks.

    Args:
        layout: where parameters and states live.
        modules: the kernel's own modules, each importing only from the ones before it; the last
            one holds the entry points.
        hooks: the module of the places where effects act.
        entry: the compiled function that is called; the log says when it has to be compiled.

    Raises:
        PluginError: an effect names a hook or a quantity that the plant does not have.
    """
    import numba  # here, because a layout alone needs no compiler

    text = _compose(layout, modules, hooks)
    digest = hashlib.sha256(text.encode())
    digest.update(f"{numba.__version__} {np.__version__}".encode())
    for module in sorted(_modules(_functions(layout))):
        digest.update(inspect.getsource(sys.modules[module]).encode())
    name = f"eha_bench_kernel_{layout.plant}_{digest.hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    path = _write(name, text)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"the kernel of {layout.plant} cannot be loaded from {path}")
    kernel = importlib.util.module_from_spec(spec)
    sys.modules[name] = kernel
    spec.loader.exec_module(kernel)
    cache = Path(getattr(kernel, entry).stats.cache_path)
    if not any(cache.glob(f"{name}.{entry}-*.nbi")):
        _LOG.info("compiling the kernel of %s (once per machine)", layout.plant)
    return kernel


def kernel_folder() -> Path:
    """Folder of the generated kernels: `$EHA_BENCH_CACHE`, or the user's cache folder."""
    base = os.environ.get("EHA_BENCH_CACHE")
    if base:
        return Path(base)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eha-bench"


def _write(name: str, text: str) -> Path:
    """Write the kernel's source where it stays, or where nothing stays for this process alone."""
    try:
        return _write_in(kernel_folder(), name, text)
    except OSError as error:
        _LOG.warning(
            "the kernel cannot be kept in %s (%s) and is compiled for this process alone; "
            "name a folder in EHA_BENCH_CACHE",
            kernel_folder(),
            error.strerror or error,
        )
        folder = tempfile.mkdtemp(prefix="eha-bench-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        return _write_in(Path(folder), name, text)


def _write_in(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if not path.exists():
        write_text(path, text)
    return path


def _module_of(function: Callable[..., object]) -> str:
    return str(function.__module__)


def _modules(functions: Iterable[Callable[..., object]]) -> set[str]:
    """Names of the modules whose source decides what the functions compile to."""
    seen: set[Callable[..., object]] = set()
    waiting = list(functions)
    while waiting:
        function = waiting.pop()
        if function not in seen:
            seen.add(function)
            namespace = function.__globals__
            helpers = [
                getattr(namespace.get(n), "py_func", None) for n in function.__code__.co_names
            ]
            waiting += [helper for helper in helpers if helper is not None]
    return {_module_of(function) for function in seen}


def _functions(layout: Layout) -> list[Callable[..., object]]:
    found: list[Callable[..., object]] = []
    for effect in layout.effects:
        action = effect.action(layout.plant)
        found += action.hooks.values()
        found += [*(action.advance or effect.advance).values()]
        found += [*(action.start or effect.start).values()]
    return found


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


def _compose(layout: Layout, modules: tuple[ModuleType, ...], hooks: ModuleType) -> str:
    """Return the kernel's source: the hooks filled with the effects, then its own modules."""
    signatures = {
        name: list(inspect.signature(getattr(hooks, name).py_func).parameters)
        for name in layout.hooks
    }
    lines = ['"""Generated: the kernel with all registered effects in its hooks."""', "", _HEAD]
    lines += [*_record("parameter_record", [p.size for _, p in layout.items()])]
    lines += [*_record("memory_record", [1] * layout.memory)]
    bodies: dict[str, list[str]] = {name: [] for name in signatures}
    guards: dict[str, list[str]] = {name: [] for name in signatures}
    for number, effect in enumerate(sorted(layout.effects, key=lambda e: (e.order, e.id))):
        strength = layout.ordinals[f"{effect.id}.{effect.strength.name}"]
        guard = f"P[{strength}] != {effect.neutral!r}"
        for serial, (hook, changed, function) in enumerate(_uses(layout, effect, signatures)):
            alias = f"_e{number}_{serial}"
            lines.append(f"from {_module_of(function)} import {function.__name__} as {alias}_py")
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


def _record(name: str, sizes: list[int]) -> list[str]:
    """Return the lines of a function that lays a record over a vector."""
    fields = [
        f'("f{number}", "f8")' if size == 1 else f'("f{number}", "f8", ({size},))'
        for number, size in enumerate(sizes)
    ]
    kind = f"_{name.upper()}"
    return [
        f"{kind} = np.dtype([{', '.join(fields)}])",
        *("", "", "@njit", f"def {name}(vector):", f"    return vector.view({kind})[0]", "", ""),
    ]


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


def _arguments(
    layout: Layout, effect: Effect, function: Callable[..., object], have: list[str]
) -> str:
    """Return the arguments that bind a function's names to what they stand for."""
    parts = []
    own = {parameter.name for parameter in effect.parameters}
    for name in inspect.signature(function).parameters:
        key = f"{effect.id}.{name}"
        if key in layout.states:
            parts.append(f"S[{layout.states[key]}]")
        elif name in own:
            parts.append(f"P[{layout.ordinals[key]}]")
        elif name in have and name not in _VECTORS:
            parts.append(name)
        elif name in layout.signals:
            parts.append(f"S[{layout.signals.index(name)}]")
        elif name in layout.index:
            parts.append(f"P[{layout.ordinals[name]}]")
        else:
            raise PluginError(
                f"effect '{effect.id}' asks for '{name}' in {function.__name__}",
                hint=f"there: {', '.join(n for n in have if n not in _VECTORS)}, "
                f"{', '.join(layout.signals)}, the plant's parameters, its own, its states",
            )
    return ", ".join(parts)
