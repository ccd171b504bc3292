"""Which windows of long training data are simulated: a share of them, chosen evenly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import Window, split

_BUDGET = 40.0
"""Most that is simulated for one residual, s; longer training data are sampled evenly."""

_BUDGET_TICKS = 12_000
"""And in ticks: of a slow log, forty seconds are few readings. Half as many gave an arm's elbow
causes that predict unseen motions half as well, and of its rotation, fitted to slow motions, none
that held-out ones bear out."""

_CHUNK = 4.0
"""Length of the parts of long windows that are chosen from, s."""

_CHUNK_TICKS = 250
"""And in ticks, at least."""


def thinned_windows(windows: list[Window]) -> list[Window]:
    """Return evenly chosen windows where all of them are longer than a budget in s and in ticks."""
    total = sum(map(length, windows))
    budget = budget_of(windows)
    if total <= budget:
        return windows
    pieces = chunks(windows)
    count = max(1, round(len(pieces) * budget / total))
    chosen = np.unique(np.linspace(0, len(pieces) - 1, count).round().astype(int))
    return [pieces[k] for k in chosen]


def chunks(windows: Sequence[Window]) -> list[Window]:
    """Return the parts that are chosen from, in order."""
    chunk = max(_CHUNK, _CHUNK_TICKS * _tick(windows))
    return [part for window in windows for part in split(window, chunk)]


def budget_of(windows: Sequence[Window]) -> float:
    """Return how much of some windows is simulated at most, s."""
    return _budget(_tick(windows))


def length(window: Window) -> float:
    """Return how long a window is, s."""
    time = window.measured.time
    return float(time[window.last - 1] - time[window.first])


def thinning_notes(measured: Sequence[Measured]) -> list[str]:
    """Say how much of the training data is simulated, where it is not all."""
    if not is_thinned(measured):
        return []
    total, budget = _total_and_budget(measured)
    return [f"of {total:.0f} s of training data {budget:.0f} s are simulated, evenly"]


def is_thinned(measured: Sequence[Measured]) -> bool:
    """Whether training data are longer than what is simulated of them."""
    total, budget = _total_and_budget(measured)
    return total > budget


def _total_and_budget(measured: Sequence[Measured]) -> tuple[float, float]:
    """Return how long runs are, and how much of them is simulated at most, s."""
    total = sum(float(item.time[-1]) for item in measured)
    ticks = sum(item.time.size - 1 for item in measured)
    return total, _budget(total / max(ticks, 1))


def _budget(tick: float) -> float:
    return max(_BUDGET, _BUDGET_TICKS * tick)


def _tick(windows: Sequence[Window]) -> float:
    """Return the mean step of the clock, s."""
    ticks = sum(window.last - 1 - window.first for window in windows)
    return sum(map(length, windows)) / max(ticks, 1)
