"""Vectors as bare pointers inside compiled code.

Numba counts the references of every array that it passes on, which took longer than a kernel's
equations; a pointer is one number. What it points at must outlive it: the caller of a kernel holds
the arrays while it runs.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic


@intrinsic
def pointer(typing_context: Any, vector: Any) -> Any:
    """The address of a contiguous vector's first element; its elements are read by `p[k]`.

    Raises:
        TypingError: the vector has gaps between its elements, or is not a vector.
    """
    if not isinstance(vector, types.Array) or vector.ndim != 1 or vector.layout != "C":
        raise TypingError(f"a pointer stands for a contiguous vector, not for {vector}")

    def address(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(vector.dtype)(vector), address


@intrinsic
def behind(typing_context: Any, start: Any, count: Any) -> Any:
    """The address of the element `count` places behind another."""

    def address(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.gep(arguments[0], [arguments[1]])

    return start(start, types.intp), address
