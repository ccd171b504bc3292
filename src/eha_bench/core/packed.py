"""A function with all that it holds, pickled once, however many items it is called with.

What many items share (the data of a problem, a model) travels to a worker once and is kept there
for the items that follow, instead of with every one of them.
"""

from __future__ import annotations

import pickle
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_KEPT: dict[str, Callable[[Any], Any]] = {}
_MOST = 2
"""Functions that a worker keeps: those of the round that ends and of the one that begins."""


@dataclass(frozen=True, eq=False)
class Packed:
    """A pickled function.

    Attributes:
        key: its name, the same wherever it is.
        pickled: (n,) bytes, as an array: joblib maps large ones into memory.
    """

    key: str
    pickled: NDArray[np.uint8]

    def unpacked(self) -> Callable[[Any], Any]:
        """Return the function, unpickled when a process first asks for it."""
        function = _KEPT.get(self.key)
        if function is None:
            function = _KEPT[self.key] = pickle.loads(self.pickled.data)
            for key in list(_KEPT)[:-_MOST]:
                _KEPT.pop(key, None)  # another thread may have been faster
        return function


def pack(function: Callable[[Any], Any]) -> Packed:
    """Return a function packed, with all that it holds; lambdas and methods may be."""
    import cloudpickle

    return Packed(uuid.uuid4().hex, np.frombuffer(cloudpickle.dumps(function), dtype=np.uint8))
