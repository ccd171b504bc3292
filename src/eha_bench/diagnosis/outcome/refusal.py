"""An effect that was found and does not stand, and what it still tells of the place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.outcome.diagnosis import Unknown
from eha_bench.diagnosis.search.state import Accepted


@dataclass(frozen=True)
class Refusal:
    """An effect that does not stand.

    Attributes:
        item: it, with what it explained. reason: why not, as a clause.
        imitates: whether it stood for something at another place, and so tells none.
    """

    item: Accepted
    reason: str
    imitates: bool = False

    @property
    def note(self) -> str:
        """Say why an effect does not stand."""
        return f"{self.item.start.candidate} is not accepted: {self.reason}"


def placed_by_refusals(unknown: Unknown, refused: Sequence[Refusal], limits: Thresholds) -> Unknown:
    """Return what is unknown in the balance of a refused effect that explained nearly all of it.

    What nearly explains runs left out acts where the right cause does, whatever its numbers are:
    an air drag is fitted by a friction whose size nobody believes. A free input, or a curve that
    explains less than half, is weaker evidence of the place.

    Args:
        unknown: as it was located. refused: effects that do not stand. limits: of the verdict.
    """
    telling = [
        item
        for item in refused
        if not item.imitates
        and item.item.start.equation
        and item.item.comparison.explained_out > limits.nearly_all
    ]
    if not telling or unknown.share > limits.explained:
        return unknown
    start = max(telling, key=lambda item: item.item.comparison.gain).item
    equation = start.start.equation
    if equation == unknown.equation:
        return unknown
    text = (
        f"something acts in the {equation} balance, much as {start.start.candidate} would, which "
        f"explains {per_cent(start.comparison.explained_out)} of the excess on runs left out but "
        "is not accepted; what it depends on remains open"
    )
    return Unknown(equation, (), text)
