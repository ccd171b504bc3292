"""Marks a function as one that Numba compiles, without importing Numba.

Numba takes a third of a second to import, and who reads a model file or lists parameters needs none
of it. A marked function is compiled when it is first called, or when compiled code calls it: Numba
asks a global for its type (`_numba_type_`), and gets that of the compiled function.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, Generic, ParamSpec, TypeVar

Args = ParamSpec("Args")
Value_co = TypeVar("Value_co", covariant=True)


class Compiled(Generic[Args, Value_co]):
    """A function that is compiled on first use; `py_func` is the function as written."""

    def __init__(self, function: Callable[Args, Value_co], options: dict[str, Any]) -> None:
        self.py_func = function
        self._options = options
        update_wrapper(self, function)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's own object for the function."""
        import numba

        return numba.njit(**self._options)(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        return self.dispatcher._numba_type_

    def __call__(self, *args: Args.args, **kwargs: Args.kwargs) -> Value_co:
        """Call the compiled function."""
        value: Value_co = self.dispatcher(*args, **kwargs)
        return value


def njit(
    **options: Any,
) -> Callable[[Callable[Args, Value_co]], Compiled[Args, Value_co]]:
    """Return a decorator as `numba.njit(**options)`, which compiles on first use only."""
    return lambda function: Compiled(function, options)
