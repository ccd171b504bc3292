"""The budget of uncertainty behind a measured value: what moves it, and by how much.

JCGM 100:2008 (GUM): contributions of type A are evaluated from the scatter of the data (noise, its
correlation, repeats), those of type B by other means (a sensor's resolution and calibration, time
stamps, interpolation, a response that has not quite settled).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property


class Evaluation(StrEnum):
    """How a contribution was evaluated (JCGM 100, 2.3.2 and 2.3.3)."""

    A = "A"
    B = "B"


@dataclass(frozen=True)
class Contribution:
    """One source of uncertainty.

    Attributes:
        source: what it comes from, one or two words.
        evaluation: type A or type B.
        standard: standard uncertainty of the value by this source, in the value's unit, >= 0.
        freedom: degrees of freedom of a type A contribution (0: not known).
        rectangular: whether every value between two bounds is equally likely, else normal.
    """

    source: str
    evaluation: Evaluation
    standard: float
    freedom: float = math.inf
    rectangular: bool = False


@dataclass(frozen=True)
class Budget:
    """Independent contributions to the uncertainty of one value."""

    parts: tuple[Contribution, ...] = ()

    def __add__(self, other: Budget) -> Budget:
        """Return both budgets together."""
        return Budget(self.parts + other.parts)

    def scaled(self, factor: float) -> Budget:
        """Return the budget of the value times a factor."""
        size = abs(factor)
        return Budget(
            tuple(
                Contribution(p.source, p.evaluation, size * p.standard, p.freedom, p.rectangular)
                for p in self.parts
            )
        )

    @property
    def variance(self) -> float:
        """Square of the combined standard uncertainty (JCGM 100, 5.1.2)."""
        return self.standard * self.standard

    @cached_property
    def standard(self) -> float:
        """Combined standard uncertainty."""
        return math.hypot(*(part.standard for part in self.parts))

    @property
    def known(self) -> bool:
        """Whether there are contributions, and there was enough data to evaluate every one."""
        return bool(self.parts) and all(
            part.freedom > 0.0 and part.standard >= 0.0 for part in self.parts
        )

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom (Welch-Satterthwaite; JCGM 100, G.4.1)."""
        total = self.standard
        if not 0.0 < total < math.inf:
            return math.inf
        shares = (
            (part.standard / total) ** 4 / part.freedom
            for part in self.merged().parts
            if part.freedom > 0.0
        )
        inverse = math.fsum(shares)
        return 1.0 / inverse if inverse > 0.0 else math.inf

    @property
    def excess(self) -> float:
        """Excess kurtosis that the rectangular contributions give: -1.2 for one alone, else less.

        Cumulants of independent contributions add up; a rectangular one has -1.2 times the square
        of its variance.
        """
        total = self.standard
        if not 0.0 < total < math.inf:
            return 0.0
        return -1.2 * math.fsum((p.standard / total) ** 4 for p in self.parts if p.rectangular)

    def merged(self) -> Budget:
        """Return one contribution a source, the largest first; those of no size are left out."""
        return self._merged

    @cached_property
    def _merged(self) -> Budget:
        found: dict[tuple[str, Evaluation], list[Contribution]] = {}
        for part in self.parts:
            found.setdefault((part.source, part.evaluation), []).append(part)
        merged = [_together(parts) for parts in found.values()]
        merged.sort(key=lambda part: -part.standard)
        return Budget(tuple(part for part in merged if part.standard > 0.0))


def _together(parts: Iterable[Contribution]) -> Contribution:
    """Return contributions of one source as one; they share the estimate that they come from."""
    own = list(parts)
    if len(own) == 1:
        return own[0]
    return replace(
        own[0],
        standard=math.hypot(*(part.standard for part in own)),
        freedom=min(part.freedom for part in own),
        rectangular=False,
    )


UNSAID = Budget()
"""The budget of a value without known contributions."""
