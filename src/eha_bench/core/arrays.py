"""Names of the arrays that signatures speak of; their shapes stand in the docstrings."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

# who reads a suite needs no arrays: modules import numpy where they compute
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Bytes: TypeAlias = "NDArray[np.uint8]"
BoolArray: TypeAlias = "NDArray[np.bool_]"
ComplexArray: TypeAlias = "NDArray[np.complex128]"
FloatArray: TypeAlias = "NDArray[np.float64]"
IndexArray: TypeAlias = "NDArray[np.intp]"
