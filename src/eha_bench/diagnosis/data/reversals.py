"""Whether anything turns back in the runs that are fitted.

A play shows where a motion turns back: until the gap is crossed one side stands. Where every run
starts from rest and goes one way, it shows as a dead time at the start alone, by as much of the gap
as happens to lie ahead, and a delayed command looks the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured

_NOISE: Final = 6.0
"""Standard deviations of its noise that a motion has to exceed each way."""
_SHARE: Final = 0.1
"""Share of its range in the run that it has to exceed each way: a boom sags as its valve opens."""


def turns_back(runs: Sequence[Measured], noise: Mapping[str, float]) -> bool:
    """Return whether some position or speed goes one way and the other within a run.

    True as well where neither is read, which tells nothing.

    Args:
        runs: that are fitted. noise: of their channels, SI.
    """
    moved = [way for item in runs for way in _ways(item, noise)]
    return not moved or any(min(way.up, way.down) > way.least for way in moved)


def goes_one_way(runs: Sequence[Measured], noise: Mapping[str, float]) -> tuple[str, ...]:
    """Return the positions and speeds that go one way only in all runs together.

    Args:
        runs, noise: as of `turns_back`.
    """
    moved = [way for item in runs for way in _ways(item, noise)]
    up = {way.channel for way in moved if way.up > way.least}
    down = {way.channel for way in moved if way.down > way.least}
    one_way = up ^ down
    return tuple(dict.fromkeys(way.channel for way in moved if way.channel in one_way))


class _Way(NamedTuple):
    """How far something goes either way in a run, SI, and what is no motion of it."""

    channel: str
    up: float
    down: float
    least: float


def _ways(item: Measured, noise: Mapping[str, float]) -> Iterator[_Way]:
    """Yield how far each position and speed of a run goes."""
    for name in item.outputs:
        read = item.column(name)
        if read is None or not (name in item.roles.rates or name in item.roles.rate_of):
            continue
        column = read[np.isfinite(read)]
        if not column.size:
            continue
        least = max(_NOISE * noise.get(name, 0.0), _SHARE * float(np.ptp(column)))
        if name in item.roles.rates:
            yield _Way(name, float(column.max()), float(-column.min()), least)
        else:
            yield _Way(name, _farthest(column), _farthest(-column), least)


def _farthest(position: FloatArray) -> float:
    """Return by how much a position rises at most from an earlier one."""
    return float(np.max(position - np.minimum.accumulate(position)))
