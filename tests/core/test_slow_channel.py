"""A channel of a lower rate has empty cells that are no gaps."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.core.slow_channel import Readings, readings_of
from eha_bench.recordings.series import nan_note

NAN = float("nan")


def every(step: int, size: int = 60, first: int = 0) -> np.ndarray:
    values = np.full(size, NAN)
    values[first::step] = 1.0
    return values


def without(values: np.ndarray, *rows: int) -> np.ndarray:
    return np.delete(values, rows)


def emptied(values: np.ndarray, *rows: int) -> np.ndarray:
    out = values.copy()
    out[list(rows)] = NAN
    return out


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (np.ones(60), Readings(1, 0)),
        (every(2), Readings(2, 0)),
        (every(5, first=3), Readings(5, 0)),
        # a row of the table that was lost
        (without(every(2), 7), Readings(2, 0)),
        (without(every(2), 8), Readings(2, 0)),
        (emptied(every(2), 8), Readings(2, 1)),
        # late, or dead before the end
        (every(5, first=12), Readings(5, 2)),
        (np.concatenate([every(2, 40), np.full(20, NAN)]), Readings(2, 10)),
        # too few for a rule
        (every(20), Readings(1, 57)),
        (emptied(np.ones(60), 8, 30), Readings(1, 2)),
        (np.full(60, NAN), Readings(1, 60)),
        (np.array([1.0, NAN, NAN, 1.0]), Readings(1, 2)),
        (np.array([1.0, np.inf, 1.0, 1.0]), Readings(1, 1)),
    ],
)
def test_what_is_missing(values: np.ndarray, found: Readings) -> None:
    assert readings_of(values) == found


def test_it_is_said_so() -> None:
    time = np.arange(60.0)
    assert nan_note("x", every(2), time) == ["channel 'x' has one reading in 2 samples"]
    assert nan_note("x", emptied(every(2), 8), time) == [
        "channel 'x' has one reading in 2 samples, 1 of its readings are missing"
    ]
    assert nan_note("x", np.ones(60), time) == []
