"""Puts a plant's kernel together from its equations and all registered effects, compiled once.

The kernel modules of a plant import its hooks (places where effects act) from a module in which
they do nothing. Here a module is written in which each hook is the chain of the effects that use
it, followed by the kernel's own source; Numba compiles it and caches the result on disk. Every
effect's parameters live in the one parameter vector `P`, so trying another candidate is another
vector, never another compilation. An effect is skipped by a branch where its strength is neutral.

Inside the kernel `P` and `S` are bare pointers to the vectors (`plants.pointer` says why).
"""

from __future__ import annotations

import atexit
import hashlib
import importlib.util
import inspect
import logging
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import PluginError
from eha_bench.plants.compiled import load_numba
from eha_bench.plants.composition import compose, modules_of
from eha_bench.plants.layout import Layout

# functions of a hooks module that are no hooks: others stand in for them
_GENERATED = ("pointer", "activate")
_LOG = logging.getLogger("eha_bench")


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
    numba = load_numba()  # here, because a layout alone needs no compiler

    text = compose(layout, modules, hooks)
    digest = hashlib.sha256(text.encode())
    digest.update(f"{numba.__version__} {np.__version__}".encode())
    for module in sorted(modules_of(layout)):
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
