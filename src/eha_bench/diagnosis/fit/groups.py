"""Windows that are simulated in one call: neighbours whose runs have the same parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from eha_bench.diagnosis.fit.prepared import Prepared
from eha_bench.diagnosis.fit.readings import WindowReadings
from eha_bench.plants.plant import Drives


@dataclass(frozen=True)
class WindowGroup:
    """Windows that are simulated in one call.

    Attributes:
        members: numbers of the windows, one after the other. drives: what drives them.
        readings: what they are compared with.
    """

    members: tuple[int, ...]
    drives: Drives
    readings: WindowReadings


def groups_of(parts: Sequence[Prepared], count: int, width: int) -> tuple[WindowGroup, ...]:
    """Return windows in about `count` groups of the same length, in their order.

    Args:
        parts: the windows. count: of groups. width: how many outputs the plant has.
    """
    ticks = np.cumsum([part.drive.time.size for part in parts])
    shares = [int((count * (end - 1)) // ticks[-1]) for end in ticks]

    def key(number: int) -> tuple[int, str]:
        run = parts[number].window.measured.run
        return shares[number], run.name if run.parameters or run.own else ""

    stretches = [tuple(numbers) for _, numbers in groupby(range(len(parts)), key)]
    return tuple(
        WindowGroup(
            members,
            Drives(tuple(parts[k].drive for k in members)),
            WindowReadings([parts[k] for k in members], width),
        )
        for members in stretches
    )
