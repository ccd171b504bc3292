"""Marks a function as one that Numba compiles, without importing Numba.

Numba takes a third of a second to import, and who reads a model file or lists parameters needs none
of it. SciPy's linear algebra, which Numba imports only to see that it is there, takes another sixth
and is left to those who need it. A marked function is compiled when it is first called, or when
compiled code calls it: Numba asks a global for its type (`_numba_type_`), and gets that of an inner
function, which is compiled with its caller.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from types import ModuleType
from typing import Any, Generic, ParamSpec, TypeVar

Args = ParamSpec("Args")
Value_co = TypeVar("Value_co", covariant=True)


@cache
def load_numba() -> ModuleType:
    """Import Numba without `scipy.linalg`, which its array functions import to look for BLAS.

    SciPy is a dependency of this package, so what they look for is there; the functions that call
    BLAS import it themselves when one of them is compiled.
    """
    import numba
    from numba.np import linalg

    look = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        import numba.np.arraymath
    finally:
        linalg.ensure_blas = look
    return numba


class Compiled(Generic[Args, Value_co]):
    """A function that is compiled on first use; `py_func` is the function as written."""

    def __init__(self, function: Callable[Args, Value_co], options: dict[str, Any]) -> None:
        self.py_func = function
        self._options = options
        update_wrapper(self, function)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's own object for the function, to call from Python."""
        return load_numba().njit(**self._options)(self.py_func)

    @cached_property
    def _inner(self) -> Any:
        load_numba()  # before what imports Numba by itself
        from eha_bench.plants.inner_function import inner

        return inner(self.py_func, **self._options)

    @property
    def _numba_type_(self) -> Any:
        return self._inner._numba_type_

    def __call__(self, *args: Args.args, **kwargs: Args.kwargs) -> Value_co:
        """Call the compiled function."""
        value: Value_co = self.dispatcher(*args, **kwargs)
        return value


def njit(
    **options: Any,
) -> Callable[[Callable[Args, Value_co]], Compiled[Args, Value_co]]:
    """Return a decorator as `numba.njit(**options)`, which compiles on first use only."""
    return lambda function: Compiled(function, options)
