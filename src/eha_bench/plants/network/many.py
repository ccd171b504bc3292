"""Many simulations with one kernel in one call, without the interpreter between them.

A fit simulates hundreds of windows of a second each, again and again. One call a window spends as
long in the interpreter as in the equations, and threads wait for each other there. The loop over
the windows is compiled once for all plants: it calls a kernel by its address, as every kernel takes
the same arguments. The numbers are those of single calls to the last bit.
"""

from __future__ import annotations

import math
from functools import cache
from types import ModuleType
from typing import Any

from numba import njit, types
from numba.extending import intrinsic

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray

_VECTOR = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_MARKS = types.Array(types.bool_, 1, "C")
_MANY_MARKS = types.Array(types.bool_, 2, "C")
_PLACES = types.Array(types.int64, 1, "C")

_SETTLE = (_MARKS, _VECTOR, _VECTOR, _VECTOR, _VECTOR)
_SIMULATE = (
    types.int64, types.int64, _VECTOR, _TABLE, _MARKS, _TABLE, _MARKS, types.bool_, types.bool_,
    types.float64, types.bool_, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _TABLE,
)  # fmt: skip
"""What a kernel's `settle` and `simulate` take (`source`)."""


@cache
def addresses(kernel: ModuleType) -> tuple[int, int]:
    """Return where a kernel's `settle` and `simulate` are in memory, compiled."""
    return _address(kernel.settle, _SETTLE), _address(kernel.simulate, _SIMULATE)


def _address(function: Any, arguments: tuple[types.Type, ...]) -> int:
    function.compile(arguments)
    found = function.overloads[arguments]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


def _calling(typing_context: Any, address: Any, arguments: Any) -> Any:
    """Call the compiled function at an address, which returns nothing, with a tuple's items."""

    def call(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds = signature.args[1].types
        items = [builder.extract_value(values[1], place) for place in range(len(kinds))]
        convention = context.call_conv
        pointer = convention.get_function_type(types.none, kinds).as_pointer()
        function = builder.inttoptr(values[0], pointer)
        status, _ = convention.call_function(builder, function, types.none, kinds, items)
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(types.intp, arguments), call


_called: Any = intrinsic(_calling)


# Their arguments are fixed: a kernel that is called by its address cannot look at what it is given.
@njit(types.none(types.int64, _MANY_MARKS, _VECTOR, _TABLE, _TABLE, _TABLE), cache=True, nogil=True)
def settle_each(
    address: int,
    reads: BoolArray,
    parameters: FloatArray,
    memories: FloatArray,
    shown: FloatArray,
    states: FloatArray,
) -> None:
    """Find the states behind first readings, all (simulations, ...); `states` are changed."""
    for n in range(reads.shape[0]):
        _called(address, (reads[n], parameters, memories[n], shown[n], states[n]))


@njit(
    types.none(
        types.int64, _PLACES, _PLACES, _PLACES, _VECTOR, _TABLE, types.bool_, _MANY_MARKS, _TABLE,
        _MANY_MARKS, _MARKS, _MARKS, types.float64, _VECTOR, _TABLE, _TABLE, _TABLE, _PLACES,
        _TABLE,
    ),
    cache=True,
    nogil=True,
)  # fmt: skip
def simulate_each(
    address: int,
    which: IndexArray,
    edges: IndexArray,
    firsts: IndexArray,
    times: FloatArray,
    inputs: FloatArray,
    written: bool,
    given: BoolArray,
    imposed: FloatArray,
    imposes: BoolArray,
    locked: BoolArray,
    bypass_open: BoolArray,
    step: float,
    parameters: FloatArray,
    memories: FloatArray,
    shown: FloatArray,
    states: FloatArray,
    ends: IndexArray,
    out: FloatArray,
) -> None:
    """Simulate windows whose ticks stand one behind the other.

    Args:
        address: of the kernel's `simulate`. which: (n,) window of each simulation.
        edges: (windows + 1,) where each window's ticks begin. firsts: (windows,) tick within it
            that it starts at. times, inputs, imposed: of all ticks. written: whether a simulation
            writes its inputs, as a controller inside the plant does. given, imposes, locked,
            bypass_open: of each window. memories, shown, states: of each simulation.
        ends: (n + 1,) where the rows of each simulation begin. out: all rows, written; NaN before a
            window's first tick.
    """
    for n in range(which.size):
        w = which[n]
        here, there = edges[w], edges[w + 1]
        out[ends[n] : ends[n] + firsts[w]] = math.nan
        own = inputs[here:there]
        if written:
            own = own.copy()
        _called(
            address,
            (
                firsts[w], there - here - 1, times[here:there], own, given[w],
                imposed[here:there], imposes[w], locked[w], bypass_open[w], step, True,
                parameters, memories[n], shown[n], states[n], out[ends[n] : ends[n + 1]],
            ),
        )  # fmt: skip
