"""What remains beside the effects that were found: how much, in which balance, what it follows.

A measured machine keeps a remainder that no law of a few numbers explains. Where it acts is told as
for something unknown (`unknown.locator`), with the effects in the model. Where an effect that was
found acts at the same place, its law may be another one: a sensor whose gain is off reads as an
offset that is right at one pressure only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from eha_bench.core.finite import finite_or_none
from eha_bench.core.per_cent import per_cent
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.slopes import in_words
from eha_bench.diagnosis.outcome.whereabouts import acts_in, element_of
from eha_bench.diagnosis.search.state import ALL_BUT_A_FORM, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.locator import locate
from eha_bench.diagnosis.unknown.places import places_of
from eha_bench.plants.plant import Plant

_ONE_IN_200 = 0.005
_MOST = 0.5
"""Part of a small remainder that a curve explains where its place means something."""


@dataclass(frozen=True)
class Remainder:
    """What the effects that were found leave of what was missing.

    Attributes:
        share: of what was missing, in squared error, that remains.
        equation: balance it acts in. at: node, element or sensor where a curve of it does best.
        variable: what that curve follows, "" where none explains any of it.
        explained: part of what remains that the curve explains over windows of 0.1 s left out.
        near: other balances that these data hardly tell it from.
        found_there: effects at the same place: their law may be another one, and then their
            sizes have no intervals.
        curve: what `explained` is of, None where none explains any of it.
    """

    share: float
    equation: str
    at: str = ""
    variable: str = ""
    explained: float = 0.0
    near: tuple[str, ...] = ()
    found_there: tuple[str, ...] = ()
    curve: LocatedCurve | None = None

    @property
    def position(self) -> str:
        """Channel whose derivative the variable is, "" where the variable is a channel."""
        return self.curve.position if self.curve is not None else ""

    @property
    def follows(self) -> str:
        """The variable, and of which channel it is the derivative."""
        return in_words(self.variable, self.position)

    @property
    def note(self) -> str:
        """Say it in a sentence or two."""
        share = "less than 1 %" if self.share < _ONE_IN_200 else per_cent(self.share)
        text = f"what remains ({share} of what was missing) "
        if self.share < ALL_BUT_A_FORM and self.explained < _MOST and not self.found_there:
            return text + "is too little to tell where it acts"
        text += acts_in(self.equation, self.at)
        if self.variable == "time" and self.found_there:
            text += "; it follows no channel alone"  # a law in another form changes all the time
        elif self.variable:
            text += f"; a curve of {self.follows} explains {per_cent(self.explained)} of it"
        else:
            text += "; no curve of one variable explains any of it"
        if self.near:
            text += f"; it could be in the {' or '.join(self.near)} balance nearly as well"
        if len(self.found_there) == 1:
            text += f". {self.found_there[0]} acts there, too: its law may be another one, so its "
            text += "size has no interval"
        elif self.found_there:
            text += f". {' and '.join(self.found_there)} act there, too: their laws may be other "
            text += "ones, so their sizes have no intervals"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in diagnosis.json."""
        return {
            "share": finite_or_none(self.share),
            "equation": self.equation,
            "at": self.at or None,
            "variables": [self.variable] if self.variable else [],
            "derived": {self.variable: self.position} if self.position else {},
            "explained": self.explained,
        }


def remainder(
    search: Search, places: Sequence[tuple[str, str, str]], step: float, progress: ProgressHook
) -> Remainder | None:
    """Return what remains beside the effects that were found; None where nothing can act.

    Args:
        search: finished, with effects, and more than noise left.
        places: of each effect its id, its balance, and where it acts.
        step: integration step of the localisation, s. progress: called often.
    """
    locator, equation, located = locate(search.problem, search.fit, step, progress)
    if not equation:
        return None
    share = min(search.share_left, 1.0)
    near = tuple(name for name in locator.near if name != equation)
    best = located[0] if located else None
    if best is None or best.share <= search.thresholds.follows:
        return Remainder(share, equation, near=near)
    at = best.template.place
    here = acting_at(search.problem.plant, at)
    there = tuple(name for name, balance, where in places if balance == equation and where in here)
    variable = best.template.variable
    explained = min(best.share, 1.0)
    return Remainder(share, equation, at, variable, explained, near, there, best)


def acting_at(plant: Plant, place: str) -> frozenset[str]:
    """Return where effects act that act at a place: its element, or each sensor that it changes."""
    sensors = (name for item in places_of(plant) if item.at == place for name in item.sensors)
    return frozenset({element_of(place), *sensors})
