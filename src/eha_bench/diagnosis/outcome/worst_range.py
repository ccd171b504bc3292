"""Where a model errs most: the channel whose value tells best, and between which values.

A cause that no curve of one variable describes (friction with a bump, an end cushion) may still act
in one part of a machine's range only. Of the tables of errors by value (`error_by_value`) the one
counts in which all channels err much more in one bin than in the middle one of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.diagnosis.replay.error_by_value import ErrorBin, ErrorByValue

_WORSE = 2.0
"""How many times as much all channels have to err there, as a geometric mean."""
_SEEN = 3.0
"""Noise floors from which an error counts."""


@dataclass(frozen=True)
class WorstRange:
    """Values of one channel at which others err most.

    Attributes:
        by, by_unit: the channel and its SI unit. low, high: its values, SI.
        channel, unit: that errs most there, against elsewhere. error: there; elsewhere: usually.
    """

    by: str
    by_unit: str
    low: float
    high: float
    channel: str
    unit: str
    error: float
    elsewhere: float

    def words(self) -> str:
        """Say it as a clause."""
        where = f"{self.low:.3g} to {self.high:.3g} {self.by_unit}".rstrip()
        errors = (
            f"{self.error:.2g} {self.unit}".rstrip(),
            f"{self.elsewhere:.2g} {self.unit}".rstrip(),
        )
        return (
            f"the model errs most where {self.by} is {where}: {self.channel} by {errors[0]}, "
            f"{errors[1]} elsewhere"
        )


def worst_range(tables: Sequence[ErrorByValue], floors: Mapping[str, float]) -> WorstRange | None:
    """Return where a model errs most, None where it errs about alike everywhere.

    Args:
        tables: its errors by value. floors: channel -> noise floor, SI.
    """
    best: tuple[float, WorstRange] | None = None
    for by in dict.fromkeys(table.by for table in tables):
        own = [table for table in tables if table.by == by and table.channel != by]
        ratios = [_ratios(table, floors) for table in own]
        if not own or not any(np.isfinite(row).any() for row in ratios):
            continue
        # a channel that says nothing of a bin errs there as elsewhere
        logs = np.log(np.array(ratios))
        means = np.where(np.isfinite(logs), logs, 0.0).mean(axis=0)
        worst = int(means.argmax())
        if means[worst] < math.log(_WORSE) or (best is not None and means[worst] <= best[0]):
            continue
        most = max(range(len(own)), key=lambda k: float(np.nan_to_num(ratios[k][worst])))
        best = float(means[worst]), _range(own[most], worst, float(ratios[most][worst]))
    return None if best is None else best[1]


def _ratios(table: ErrorByValue, floors: Mapping[str, float]) -> np.ndarray:
    """Return the error of each bin in the middle one of the others, (bins,), NaN where none is."""
    errors = np.array([_above(item, floors.get(table.channel, 0.0)) for item in table.bins])
    found = np.full(errors.size, np.nan)
    for k, error in enumerate(errors):
        others = np.delete(errors, k)
        others = others[np.isfinite(others)]
        if np.isfinite(error) and others.size and float(np.median(others)) > 0.0:
            found[k] = error / float(np.median(others))
    return found


def _above(item: ErrorBin, floor: float) -> float:
    """Return an error, at least what noise alone could be taken for."""
    return max(item.error, _SEEN * floor) if math.isfinite(item.error) else math.nan


def _range(table: ErrorByValue, at: int, ratio: float) -> WorstRange:
    item = table.bins[at]
    return WorstRange(
        table.by, table.by_unit, item.low, item.high, table.channel, table.unit, item.error,
        item.error / ratio,
    )  # fmt: skip
