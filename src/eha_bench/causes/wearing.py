"""Which cause moves: changes found in every cause's course, and the one that explains them.

Causes imitate each other: a leak that grows moves what would be the oil's stiffness if that alone
had changed. So what moves together is one event, and the cause is the one whose gains add up to
most over the nights since; others that chance may have put behind it are its rivals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.causes.cause import Cause
from eha_bench.causes.estimates import Estimates
from eha_bench.core.arrays import FloatArray
from eha_bench.trends.changes import FEWEST
from eha_bench.trends.trend import Judged, TrendState, judge

_SHARED: Final = 4
"""Causes are judged on every one of many nights: the error rate of one look is so many smaller."""
_BACK: Final = 0.25
"""Part of the way moved within which a level still counts as healthy."""
_RECENT: Final = 5
"""Newest nights that never say what is healthy."""
_ROUNDS: Final = 4
_SURE: Final = 10.0
"""Gain (chi square) by which a cause has to be ahead of another, in units of what none explains."""
_ALIKE: Final = 0.9
"""Part of the best cause's gain below which another is none of its rivals."""
_WRONG_WAY: Final = 3.0
"""Standard deviations beyond a bound at which a cause can be none."""


@dataclass(frozen=True)
class CauseCourse:
    """What a cause did, in its steps.

    Attributes:
        at: (n,) places of the nights with an estimate. values: (n,). judged: what was found.
        since, earliest, latest: places of the night from which on it left the healthy level.
        moved: newest level less the healthy one; 0 where it did not move.
    """

    at: NDArray[np.intp]
    values: FloatArray
    judged: Judged
    since: int = -1
    earliest: int = -1
    latest: int = -1
    moved: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the newest night is not what was."""
        return self.since >= 0


def course_of(found: Estimates, cause: int, family: int, healthy: int) -> CauseCourse:
    """Return what a cause did.

    Args:
        found: causes on every night. cause: its place.
        family: how many causes are judged. healthy: how many nights are taken as healthy.
    """
    values, scatters = found.changes[:, cause], found.scatters[:, cause]
    at = np.flatnonzero(np.isfinite(values) & np.isfinite(scatters))
    own = float(np.median(scatters[at])) if at.size else math.nan
    influence = found.influence(cause, at)
    judged = judge(values[at], family=_SHARED * family, margin=0.0, own=own, influence=influence)
    known = values[at] - judged.beside
    course = CauseCourse(at, known, judged)
    if at.size < FEWEST or judged.state not in (
        TrendState.STEPPED,
        TrendState.DRIFTING,
        TrendState.OUT_OF_LIMITS,
        TrendState.STEADY,
        TrendState.SUSPECTED,
        TrendState.ONE_NIGHT_OUT,
    ):
        return course
    level = float(np.median(known[: max(1, int(np.sum(at < healthy)))]))
    line = judged.course.line
    changes = judged.course.changes
    if judged.state is TrendState.STEPPED and not (changes and changes[-1].start == judged.since):
        # news of the last nights, before a search over all of them can place it
        since, end = judged.since, float(np.median(known[judged.since :]))
        first = max(0, since - 1)
        news = int(at[since]), int(at[first]), int(at[since])
        return CauseCourse(at, known, judged, *news, end - level)
    if not changes:
        return course
    moved = float(line[-1]) - level
    if abs(moved) < 3.0 * judged.course.sigma / math.sqrt(min(3, known.size)):
        return course
    left = [
        change
        for change in changes
        if change.start == 0 or abs(float(line[change.start - 1]) - level) <= _BACK * abs(moved)
    ]
    change = left[-1] if left else changes[0]
    return CauseCourse(
        at, known, judged, int(at[change.start]), int(at[change.earliest]),
        int(at[change.latest]), moved,
    )  # fmt: skip


@dataclass(frozen=True)
class Attribution:
    """The cause of what moved.

    Attributes:
        cause: its place. rivals: places of others that these nights cannot tell from it.
        share: of what changed that it explains.
    """

    cause: int
    rivals: tuple[int, ...]
    share: float


def attribution_of(
    found: Estimates, courses: Sequence[CauseCourse], causes: Sequence[Cause], healthy: FloatArray
) -> Attribution | None:
    """Return the cause of what moves now; None where nothing does.

    Args:
        found: causes on every night. courses: of every cause. causes: what is followed.
        healthy: (p,) values of the causes on the healthy machine, SI.
    """
    moving = [k for k, course in enumerate(courses) if course.moves]
    if not moving:
        return None
    strongest = max(moving, key=lambda k: float(found.gains[-1, k]))
    since = courses[strongest].since
    gains = found.gains[since:].sum(axis=0)
    possible = [k for k in range(len(causes)) if _possible(k, found, causes, healthy, since)]
    possible = possible or moving
    best = max(possible, key=lambda k: float(gains[k]))
    total = max(float(found.totals[since:].sum() - found.ranks[since:].sum()), float(gains[best]))
    degrees = max(1.0, float(found.ranks[since:].sum()) - (found.gains.shape[0] - since))
    left = max(1.0, float(found.totals[since:].sum() - gains[best]) / degrees)
    rivals = [
        k for k in possible
        if k != best and gains[best] - gains[k] < _SURE * left
        and gains[k] > _ALIKE * gains[best]
    ]  # fmt: skip
    rivals.sort(key=lambda k: -float(gains[k]))
    return Attribution(best, tuple(rivals), float(gains[best]) / total if total > 0.0 else math.nan)


def _possible(
    k: int, found: Estimates, causes: Sequence[Cause], healthy: FloatArray, since: int
) -> bool:
    """Return whether a cause can have the values that it would need."""
    cause = causes[k]
    values = found.changes[since:, k]
    values = values[np.isfinite(values)]
    if not values.size:
        return False
    deviation = float(np.nanmedian(found.deviations[since:, k])) * cause.step
    now = float(healthy[k]) + float(np.median(values[-3:])) * cause.step
    room = _WRONG_WAY * deviation
    return cause.low - room <= now <= cause.high + room


def healthy_nights(courses: Sequence[CauseCourse], count: int, first: int) -> int:
    """Return how many nights, from the first on, may be taken as healthy.

    Args:
        courses: of every cause. count: of nights. first: how many are healthy in any case.
    """
    starts = [course.earliest for course in courses if course.moves]
    if starts:
        return max(first, min(starts) - 1)
    return max(first, count - _RECENT)


ROUNDS: Final = _ROUNDS
"""How often healthy nights and changes are worked out from each other."""
