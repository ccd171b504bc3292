"""What a comparison says of a metric."""

from __future__ import annotations

from enum import StrEnum


class ComparisonVerdict(StrEnum):
    """What the candidate is to the baseline, in one metric of one trial.

    `changed` is a difference of a metric without a better direction;
    `not_compared` one that must not be compared (another trial, another unit, nothing scored).
    """

    WORSE = "worse"
    BETTER = "better"
    CHANGED = "changed"
    SAME = "same"
    UNDECIDED = "undecided"
    NOT_COMPARED = "not_compared"

    @property
    def decided(self) -> bool:
        """Whether more repeats would not be needed."""
        return self not in (ComparisonVerdict.UNDECIDED, ComparisonVerdict.NOT_COMPARED)
