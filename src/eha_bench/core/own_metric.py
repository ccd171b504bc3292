"""A metric that a suite defines itself: a formula over metrics and statistics of channels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eha_bench.core.metric import MetricSpec

# who reads a suite without formulas needs no arrays
if TYPE_CHECKING:
    from eha_bench.core.formula import Formula


@dataclass(frozen=True)
class OwnMetric:
    """A metric of a suite.

    Attributes:
        id: its name in `accept`, `scores` and `matters`.
        formula: what it comes to, in SI.
        unit: SI unit of its value, as the suite says.
        description: what it is, for people.
        start, stop: s of the signal between which statistics of channels are taken; the scored
            time where not finite.
    """

    id: str
    formula: Formula
    unit: str = ""
    description: str = ""
    start: float = -math.inf
    stop: float = math.inf

    @property
    def spec(self) -> MetricSpec:
        """Its specification; it is scored on the recording as a whole."""
        return MetricSpec(self.id, self.description or self.formula.text, self.unit, "")
