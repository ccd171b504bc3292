"""A measure that is known from one side only, as what was there was not read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from eha_bench.core.score import Measure

CLIPPED = "the sensor's end cut it off"


def open_ended(measure: Measure, side: float, why: str) -> Measure:
    """Return a measure whose interval is open to a side: upwards where that is positive."""
    found = replace(measure, high=math.inf) if side > 0.0 else replace(measure, low=-math.inf)
    words = "at least" if side > 0.0 else "at most"
    return replace(found, reason=f"{words} this, {why}; {measure.reason}")


def longest_loss(stretches: Sequence[tuple[float, float]]) -> str:
    """Say where the longest of stretches without samples is, in s."""
    start, stop = max(stretches, key=lambda one: one[1] - one[0])
    return f"samples are lost from {start:.4g} to {stop:.4g} s"
