"""Compiles a kernel's source once per machine, and keeps it on disk."""

from __future__ import annotations

import atexit
import hashlib
import importlib
import importlib.util
import inspect
import logging
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType

import numpy as np

from eha_bench.core.atomic_file import write_text
from eha_bench.core.error_text import without_colours
from eha_bench.core.errors import PluginError
from eha_bench.plants.compiled import load_numba

_LOG = logging.getLogger("eha_bench")

_OURS = __name__.partition(".")[0]
_IMPORTED = re.compile(r"^from (eha_bench\.[\w.]+) import", re.MULTILINE)


def compiled_kernel(
    plant: str, text: str, functions: Iterable[Callable[..., object]], entry: str = "simulate"
) -> ModuleType:
    """Return the module that a kernel's source is, compiled where it is called first.

    Args:
        plant: its id, for the file's name and the log. text: the source.
        functions: what it imports: their sources decide as well what it compiles to.
        entry: the compiled function that is called; the log says when it has to be compiled.

    Raises:
        PluginError: a function calls one that is not compiled.
    """
    numba = load_numba()  # here, because a layout alone needs no compiler

    functions = list(functions)
    refuse_uncompiled(functions)
    digest = hashlib.sha256(text.encode())
    digest.update(f"{numba.__version__} {np.__version__}".encode())
    for module in sorted({*_modules_of(functions), *_IMPORTED.findall(text)}):
        digest.update(inspect.getsource(importlib.import_module(module)).encode())
    name = f"eha_bench_kernel_{plant}_{digest.hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    path = _write(name, text)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"the kernel of {plant} cannot be loaded from {path}")
    kernel = importlib.util.module_from_spec(spec)
    sys.modules[name] = kernel
    try:
        spec.loader.exec_module(kernel)
    except BaseException:
        # half a kernel would be taken for a whole one the next time
        del sys.modules[name]
        raise
    cache = Path(getattr(kernel, entry).stats.cache_path)
    if not any(cache.glob(f"{name}.{entry}-*.nbi")):
        _say_that_it_compiles(plant)
    return kernel


@cache
def _say_that_it_compiles(plant: str) -> None:
    """Say it once, though one with an effect that is tried may be another kernel."""
    _LOG.info("compiling kernels of %s (once per machine)", plant)


def refuse_uncompiled(functions: Iterable[Callable[..., object]]) -> None:
    """Refuse functions that cannot be compiled: in a kernel, an error would not say which.

    Raises:
        PluginError: one calls a plain function of Python or what compiled code does not know, or
            returns no number.
    """
    for function in functions:
        for name in function.__code__.co_names:
            if isinstance(function.__globals__.get(name), FunctionType):
                code = function.__code__
                raise PluginError(
                    f"{function.__name__} ({code.co_filename}:{code.co_firstlineno}) is compiled "
                    f"and calls '{name}', which is not",
                    hint=f"put @njit() of eha_bench.plants.compiled above {name}",
                )
        if function.__module__.partition(".")[0] != _OURS:
            _refuse_untypable(function)


@cache
def _refuse_untypable(function: Callable[..., object]) -> None:
    """Compile a plug-in's function of numbers on its own, and refuse one that fails."""
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    if any(function.__annotations__.get(name) not in (float, "float") for name in names):
        return  # a group of numbers, or a list
    numba = load_numba()
    code = function.__code__
    where = f"{function.__name__} ({code.co_filename}:{code.co_firstlineno})"
    try:
        alone = numba.njit(function)
        alone.compile((numba.float64,) * len(names))
    except Exception as error:
        lines = [line.strip() for line in without_colours(str(error)).splitlines()]
        why = next((line for line in lines if line and not line.startswith("Failed in")), "")
        raise PluginError(
            f"{where} cannot be compiled: {why.removesuffix(':') or type(error).__name__}",
            hint="it may use math, arithmetic and functions with @njit() of "
            "eha_bench.plants.compiled",
        ) from None
    found = alone.nopython_signatures[0].return_type
    if not isinstance(found, numba.types.Number | numba.types.Boolean):
        raise PluginError(f"{where} returns {found}, and a number is expected")


def kernel_folder() -> Path:
    """Folder of the generated kernels: `$EHA_BENCH_CACHE`, or the user's cache folder."""
    base = os.environ.get("EHA_BENCH_CACHE")
    if base:
        return Path(base)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "eha-bench"


def _modules_of(functions: Iterable[Callable[..., object]]) -> set[str]:
    """Return the names of the modules whose source decides what functions compile to."""
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
    return {function.__module__ for function in seen}


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
    if not _holds(path, text):
        write_text(path, text)
    return path


def _holds(path: Path, text: str) -> bool:
    """Whether a file holds a text; one that a power cut has torn does not."""
    try:
        return path.read_bytes() == text.encode()
    except OSError:
        return False
