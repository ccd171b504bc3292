"""Compiles functions that only compiled code calls: without their own machine code.

For every function Numba runs all of LLVM's optimisation and emits machine code with a way in from
Python, and then links the function into its callers, where both are done again. A kernel is some
two hundred small functions below two or three that Python calls, so most of what compiling took was
machine code that is never run. Functions compiled here are handed on to their callers as they are,
each with the list of what it calls, so that what Python calls links every one of them once.

Numba lets a function bring its own compiler (`pipeline_class`), and this is one; how libraries are
linked is Numba's own affair, so a version that has changed it compiles in the ordinary way, slower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba._dynfunc import make_function
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.typed_passes import NativeLowering

_FITS = all(
    hasattr(JITCodeLibrary, name)
    for name in ("add_linking_library", "_finalize_dynamic_globals", "_get_module_for_linking")
)
"""Whether libraries of this Numba are finished in the steps that are left out here."""


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """Return `numba.njit(**options)(function)` without its way in from Python.

    Python must not call it: there is nothing to call.
    """
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    if _FITS:
        options["pipeline_class"] = _InnerCompiler
    return numba.njit(**options)(function)


class _InnerLibrary(JITCodeLibrary):
    """LLVM's text of a function, for callers to link, to optimise and to emit.

    Attributes:
        behind: the libraries of all that it calls, and of what those call.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.behind: dict[Any, None] = {}

    def add_linking_library(self, library: Any) -> None:
        """Remember a library: who calls this function links it, too."""
        library._ensure_finalized()
        self.behind[library] = None

    def finalize(self) -> None:
        """End the text, without linking anything into it."""
        for library in self.behind:
            self._reload_init.update(library._reload_init)
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=False)
class _Announce(LoweringPass):
    """Makes a function known to the ones that call it, as `NativeLowering` does after emitting."""

    _name = "announce_inner_function"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Register the function under a Python function that has no machine code behind it."""
        lowered = state["cr"]
        what = lowered.fndesc
        handle = make_function(
            what.lookup_module(),
            what.qualname.split(".")[-1],
            "only compiled code can call this",
            0,
            lowered.env,
            (state.library,),
        )
        libraries = [state.library, *state.library.behind]
        state.targetctx.insert_user_function(handle, what, libraries)
        state["cr"] = lowered._replace(cfunc=handle)
        return True


class _InnerCompiler(Compiler):
    """Numba's compiler up to LLVM's text, and no further."""

    def define_pipelines(self) -> list[PassManager]:
        """Return Numba's own passes, with a library that is linked but never emitted."""
        state = self.state
        state.library = _InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_Announce, NativeLowering)
        passes.finalize()
        return [passes]
