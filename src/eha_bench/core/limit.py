"""Limits: what a metric must keep to be accepted, and what a channel must keep to be safe."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum

from eha_bench.core.channels import unit_of
from eha_bench.core.common_units import COMMON

_WORD = re.compile(r"[^\W\d_][^\s,;()<>=]*|[°%]\w*")
_SIDE = re.compile(r"(<=|>=) (\S+?)(?=,|\s|$)")


@dataclass(frozen=True)
class Bounds:
    """A closed interval in SI; an open side is infinite."""

    low: float = -math.inf
    high: float = math.inf

    @staticmethod
    def read(text: str) -> Bounds | None:
        """Return the bounds that `AcceptanceLimit.in_si` wrote; None for any other text."""
        sides = dict(_SIDE.findall(text))
        try:
            low, high = (float(sides[sign]) if sign in sides else None for sign in (">=", "<="))
        except ValueError:
            return None
        if low is None and high is None:
            return None
        return Bounds(-math.inf if low is None else low, math.inf if high is None else high)

    def holds(self, value: float) -> bool:
        """Whether the value lies inside; NaN never does."""
        return self.low <= value <= self.high

    def excess(self, value: float) -> float:
        """How far the value lies outside (0 inside), in its unit."""
        return max(self.low - value, value - self.high, 0.0)

    def margin(self, value: float) -> float:
        """How much of the limit is left, without unit: 0 at a bound, negative outside.

        Between two bounds it is the distance to the nearer one over half their distance (1 in the
        middle), at a single one the distance over the bound itself, at a bound of 0 the distance.
        NaN for NaN.
        """
        if math.isfinite(self.low) and math.isfinite(self.high):
            scale = 0.5 * (self.high - self.low) or abs(self.high) or 1.0
            return min(value - self.low, self.high - value) / scale
        if math.isfinite(self.high):
            return (self.high - value) / (abs(self.high) or 1.0)
        return (value - self.low) / (abs(self.low) or 1.0)


class Repeats(StrEnum):
    """Which of a trial's repeats a limit is applied to."""

    ALL = "all"
    WORST = "worst"
    MEDIAN = "median"


@dataclass(frozen=True)
class AcceptanceLimit:
    """An acceptance limit on a metric of a channel.

    Attributes:
        metric: metric id, e.g. `response_time`.
        channel: the channel it is scored on.
        bounds: what is accepted, SI.
        text: as the suite wrote it, e.g. `<= 41 ms`; shown to people.
        unit: SI unit of the value.
        warn: tighter bounds outside of which an accepted value is 'warned'; None for no warning.
        confident: whether the whole 95 % interval has to keep the bounds, and not the value alone;
            an interval that reaches beyond them is 'undecided'.
        repeats: every repeat for itself, or all of them by the worst or the median.
    """

    metric: str
    channel: str
    bounds: Bounds
    text: str
    unit: str
    warn: Bounds | None = None
    confident: bool = False
    repeats: Repeats = Repeats.ALL

    @property
    def in_si(self) -> str:
        """What is accepted in SI, whatever units the suite wrote: `<= 0.041 s`."""
        sides = ((">=", self.bounds.low), ("<=", self.bounds.high))
        given = [f"{sign} {end:.12g} {self.unit}".rstrip() for sign, end in sides
                 if math.isfinite(end)]  # fmt: skip
        text = ", ".join(given)
        text += " with 95 % confidence" if self.confident else ""
        return text + (f", {self.repeats.value} of the repeats" * (self.repeats is not Repeats.ALL))


@dataclass(frozen=True)
class SafetyLimit:
    """Bounds (SI) that a channel must keep during a run; outside of them the run stops.

    `unit` is that of a channel that eha_bench does not know, by the suite's quantities.
    """

    channel: str
    bounds: Bounds
    text: str
    unit: str = ""

    @property
    def si_unit(self) -> str:
        """SI unit of the channel; "" where it is not known."""
        return self.unit or unit_of(self.channel)

    def broken_by(self, value: float) -> str:
        """Return what a value outside of it broke, as a sentence in the limit's own unit.

        It is called before the target is made safe, so nothing is looked up that takes time.
        """
        if math.isnan(value):
            return f"safety limit {self.channel} {self.text}: no value"
        unit = self.si_unit
        found = f"{value:.6g} {unit}".rstrip()
        for word in reversed(_WORD.findall(self.text)):
            si, factor, offset = COMMON.get(word, ("", 1.0, 0.0))
            if si and si == unit:
                found = f"{(value - offset) / factor:.4g} {word}"
                break
        return f"safety limit {self.channel} {self.text}: {found}"
