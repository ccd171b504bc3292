"""The turns of a series that something with play still remembers."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.arrays import FloatArray
from eha_bench.core.turns import remembered_turns

VALUES = st.lists(st.floats(-10.0, 10.0), max_size=60).map(np.array)


def played(values: FloatArray, half: float, start: float) -> float:
    held = start
    for value in values:
        held = min(max(held, value - half), value + half)
    return held


@given(VALUES, st.floats(0.0, 8.0), st.floats(-10.0, 10.0))
def test_a_play_of_any_width_comes_to_the_same(values, half, start) -> None:
    kept = values[remembered_turns(values)]
    assert played(kept, half, start) == played(values, half, start)


def test_smaller_turns_are_wiped_out_by_larger_ones() -> None:
    values = np.array([0.0, 1.0, -1.0, 5.0, 2.0, 3.0, -4.0, 2.0, -1.0, 1.0, 0.0])
    assert remembered_turns(values).tolist() == [0, 3, 6, 7, 8, 9, 10]
    assert remembered_turns(np.zeros(0)).tolist() == []
    assert remembered_turns(np.full(5, 2.0)).tolist() == [0, 4]
    assert remembered_turns(np.arange(100.0)).tolist() == [0, 99]
