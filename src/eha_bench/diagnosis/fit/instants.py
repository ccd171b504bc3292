"""The instants at which samples were taken, between the ticks of a simulation.

A command acts at a tick, so between two ticks a simulation bends little, and is taken for straight
(`readings`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.plants.plant import Drive


@dataclass(frozen=True)
class Instants:
    """When samples of a window were taken that were not taken at a tick.

    Attributes:
        rows: (k,) which of the window's samples they are. columns: (k,) outputs that they are of.
        stamps: (k,) s, by their stamps. clocks: (k,) numbers of their clocks in `names`.
        names: of clocks whose stamps may be late. ticks: (n,) s, those of the simulation.
        first: tick at which the window begins.
    """

    rows: IndexArray
    columns: IndexArray
    stamps: FloatArray
    clocks: IndexArray
    names: tuple[str, ...]
    ticks: FloatArray
    first: int


def instants_of(
    measured: Measured,
    channels: Sequence[str],
    columns: IndexArray,
    window: int,
    drive: Drive,
    picked: tuple[IndexArray, IndexArray],
) -> Instants | None:
    """Return when samples of a window were taken, None where all were taken at ticks.

    Args:
        measured: the run. channels: those compared. columns: (m,) outputs that they are.
        window: first tick of the window. drive: what it is simulated with.
        picked: (N,) tick in the window and (N,) number of the channel of each sample.
    """
    if not any(name in measured.taken for name in channels):
        return None
    ticks, numbers = picked
    names = tuple(dict.fromkeys(measured.late.values()))
    rows, stamps, clocks = [], [], []
    for number, name in enumerate(channels):
        if name not in measured.taken:
            continue
        own = np.flatnonzero(numbers == number)
        at = window + ticks[own]
        rows.append(own)
        stamps.append(measured.time[at] + measured.taken[name][at])
        clocks.append(np.full(own.size, names.index(measured.late[name]), dtype=np.intp))
    row = np.concatenate(rows)
    return Instants(
        row,
        columns[numbers[row]],
        np.concatenate(stamps),
        np.concatenate(clocks),
        names,
        drive.time,
        drive.first,
    )
