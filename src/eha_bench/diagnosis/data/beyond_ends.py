"""Positions that are read beyond the ends that the model declares.

A unit that is wrong by a thousand, or a zero elsewhere, leaves a recording that can be read and
fitted; every parameter is bent then, and none says why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from eha_bench.diagnosis.data.measured import Measured

BEYOND: Final = 0.03
"""Share of the way between both ends by which readings may be beyond them: ends give way."""
OFTEN: Final = 0.01
"""Share of the readings that are beyond before anything is noted: single ones are outliers."""


def beyond_ends(
    runs: Sequence[Measured], ends: Mapping[str, tuple[float, float]], units: Mapping[str, str]
) -> Iterator[str]:
    """Yield a sentence on each position that is read beyond its ends.

    Args:
        runs: that passed the gate. ends: position channel -> lowest and highest, SI.
        units: of the channels.
    """
    for channel, (low, high) in ends.items():
        if not np.isfinite(high - low):
            continue
        room = BEYOND * (high - low)
        found = []
        for run in runs:
            if channel not in run.outputs:
                continue
            place = run.outputs.index(channel)
            values = run.values[run.valid[:, place], place]
            beyond = (values < low - room) | (values > high + room)
            if values.size and np.mean(beyond) > OFTEN:
                found.append((run.run.name, float(values.min()), float(values.max())))
        if found:
            names, lows, highs = zip(*found, strict=True)
            yield (
                f"CAUTION: {', '.join(names)}: '{channel}' goes from {min(lows):.4g} to "
                f"{max(highs):.4g} {units.get(channel, '')}, beyond the ends that the model has, "
                f"{low:.4g} to {high:.4g}: check its unit, its zero, and the model's stroke"
            )
