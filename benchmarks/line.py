"""One line of the table that `benchmarks.comparison` prints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Line:
    """One line of the table; `kept` is None where there is no target, only a figure."""

    what: str
    tried: int
    share: float
    wanted: str = ""
    kept: bool | None = None
    also: str = ""


def rate(
    what: str, hits: Sequence[bool], *, most: float | None = None, least: float | None = None
) -> Line:
    """Return how often something happened, held against the most or the least that is wanted."""
    share = float(np.mean(hits))
    if most is not None:
        return Line(what, len(hits), share, f"<= {most:.0%}", share <= most)
    if least is not None:
        return Line(what, len(hits), share, f">= {least:.0%}", share >= least)
    return Line(what, len(hits), share)
