"""Round values for an axis, and how many digits their labels need."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from matplotlib.ticker import MaxNLocator

from eha_bench.report.engineering import LARGE, number, power_of_ten

_STEPS: Final = [1.0, 2.0, 2.5, 5.0, 10.0]
_MOST_DECIMALS: Final = 12


@dataclass(frozen=True)
class Ticks:
    """Values in ascending order, `decimals` digits after the point tell every one exactly."""

    values: tuple[float, ...]
    decimals: int

    @property
    def labels(self) -> tuple[str, ...]:
        """The values as text, with a true minus, all written in one way."""
        largest = max(map(abs, self.values))
        if largest < LARGE or len(self.values) < 2:
            return tuple(number(value, self.decimals) for value in self.values)
        # as many digits as tell neighbours apart, one more for steps of 2.5
        step = self.values[1] - self.values[0]
        decimals = max(2, math.ceil(math.log10(largest / step)) + 1)
        return tuple(power_of_ten(value, decimals) if value else "0" for value in self.values)


def decimals_of(step: float) -> int:
    """Return how many digits after the point a multiple of `step` needs: 2.5 -> 1, 0.02 -> 2."""
    for decimals in range(_MOST_DECIMALS):
        scaled = abs(step) * 10.0**decimals
        if abs(scaled - round(scaled)) <= 1e-6 * scaled:
            return decimals
    return _MOST_DECIMALS


def ticks_between(low: float, high: float, most: int) -> Ticks:
    """Return the ticks of an axis from `low` to `high`, at steps of 1, 2, 2.5 or 5 times 10^n.

    Args:
        low, high: the ends of the axis, finite, low < high.
        most: intervals between ticks, at most.
    """
    locator = MaxNLocator(most, steps=_STEPS, min_n_ticks=2)
    slack = 1e-9 * (high - low)
    values = [
        v for v in map(float, locator.tick_values(low, high)) if low - slack <= v <= high + slack
    ]
    return Ticks(tuple(values), decimals_of(values[1] - values[0]) if len(values) > 1 else 3)
