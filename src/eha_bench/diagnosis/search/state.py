"""The state of a search: candidates tried, effects added, and when one is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.candidates import Start, all_starts
from eha_bench.diagnosis.fit.evidence import (
    REST_SIGNIFICANCE,
    SOFT_MEAN,
    Excess,
    Groups,
    Improvement,
    excess,
    groups_of,
)
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem


@dataclass(frozen=True)
class Refit:
    """A candidate after its refit.

    Attributes:
        start: where its search began. fit: the end. comparison: with the fit without it.
    """

    start: Start
    fit: Fit
    comparison: Improvement

    @property
    def candidate(self) -> str:
        """Effect's id, or `parameter:name`."""
        return self.start.candidate


@dataclass(frozen=True)
class Accepted:
    """What was added: an effect, or a parameter that was only assumed.

    Attributes:
        start: the candidate. comparison: what it gained when it was added.
        equivalent: other candidates that fit as well, the best first.
    """

    start: Start
    comparison: Improvement
    equivalent: tuple[str, ...]


@dataclass(frozen=True)
class RankedCandidate:
    """One line of the ranking: the best that a candidate could do as the first to be added."""

    candidate: str
    score: float
    p_value: float
    cost: float
    predicted: float
    refitted: bool


@dataclass
class Search:
    """The state of a search.

    Attributes:
        problem: residuals over all training windows.
        keys: parameters that are always fitted.
        fit: current best. base: without any added effect.
        accepted: in the order added. ranking: of the first look.
        looks: all that were taken, each the best first. looked_from: where the last one was.
        exchanged_from: where an exchange last changed nothing.
        near: the last search over short windows (`refit.Near`), where it began.
        excess_base, excess_left: beyond noise before and after.
    """

    problem: Problem
    keys: tuple[str, ...]
    declared: tuple[str, ...]
    base: Fit
    fit: Fit
    groups: Groups
    declared_vector: FloatArray
    excess_base: Excess
    excess_left: Excess
    accepted: list[Accepted] = field(default_factory=list)
    ranking: list[RankedCandidate] = field(default_factory=list)
    looks: list[list[Refit]] = field(default_factory=list)
    looked_from: Fit | None = None
    exchanged_from: Fit | None = None
    near: object | None = None

    def __getstate__(self) -> dict[str, object]:
        """Leave at home what was tried before: a fit elsewhere begins from where the search is."""
        return {**self.__dict__, "looks": [], "ranking": [], "near": None}

    def snapshot(self) -> Search:
        """Return a copy that later additions leave as it is."""
        return replace(self, accepted=list(self.accepted))

    def restore(self, kept: Search) -> None:
        """Go back to a snapshot; what was tried since stays in the looks."""
        self.problem, self.base, self.fit = kept.problem, kept.base, kept.fit
        self.excess_base, self.excess_left = kept.excess_base, kept.excess_left
        self.accepted = list(kept.accepted)

    @property
    def effects(self) -> list[Accepted]:
        """What was added and is an effect."""
        return [item for item in self.accepted if not item.start.is_parameter]


def starts_of(search: Search, taken: Sequence[str] = ()) -> list[Start]:
    """Return the starting points of everything that may be missing and that data permit.

    Args:
        search: its state. taken: ids of effects that are there besides the declared ones.
    """
    places, vector = search.problem.places, search.fit.vector
    declared = [*search.declared, *taken]
    starts = all_starts(places.layout, vector, declared, search.keys)
    return [start for start in starts if places.permits(start.apply(vector), start.keys)]


def begin(baseline: Baseline) -> Search:
    """Return a search that starts from a calibrated model."""
    model = baseline.dataset.model
    found = excess(baseline.problem, baseline.fit)
    return Search(
        baseline.problem,
        baseline.keys,
        tuple(effect.id for effect in model.effects),
        baseline.fit,
        baseline.fit,
        groups_of(baseline.problem),
        baseline.problem.places.lengthened(model.vector()),
        found,
        found,
    )


_NEARLY_ALL = 0.95
_MAY_TIE = 0.8


def rival_share(usual: float, best: float, excess: float) -> float:
    """Return the share of the best gain from which a rival's fit is worth going on with.

    Where the best one has come down to the noise, a rival can only tie: one that leaves a fifth of
    what there was is too far for that, and what fits would gain on it decides nothing.

    Args:
        usual: the share where it can still win. best: gain of the best. excess: what there was.
    """
    return max(usual, _MAY_TIE) if best > _NEARLY_ALL * excess else usual


@dataclass(frozen=True)
class Thresholds:
    """When a candidate is believed.

    Attributes:
        gain: least fall of the cost, fitted and left out (a cost of 1 is one sigma).
        share: least part of the present excess that it takes on runs left out.
        first: the same of a first one where much is missing: of a measured machine much remains,
            in which one cause shows as a smaller part. much: excess, in the noise's cost, that is.
        p_value: largest probability that it gains nothing on runs left out.
        p_few: the same where it leaves next to nothing: what acts in a few instants (impacts) shows
            in a few blocks, however sure it is; by at least `plain`, so much in each of them.
        runs_better: least part of the runs that it changes for which it gains.
        p_clear: the same that is clear without any share: of an excess without structure in time
            nobody knows how much is only a wrong level of the noise.
        worth: gain, in the noise's cost, that is worth a cause there.
        together: least part of the excess that two must explain that are looked for at once.
    """

    gain: float = 30.0
    share: float = 0.25
    first: float = 0.2
    much: float = 5.0
    p_value: float = 1e-3
    p_few: float = 0.05
    plain: float = 150.0
    runs_better: float = 0.5
    p_clear: float = 3.2e-5
    worth: float = 0.02
    together: float = 0.8

    def least_share(self, before: Excess, others: int) -> float:
        """Return the least share that an effect takes of an excess, among others."""
        return self.first if not others and self.is_much(before) else self.share

    def is_enough(self, found: Improvement, before: Excess, others: int) -> bool:
        """Whether a gain is enough of an excess, or clear where that may be the noise's level.

        Beside another effect it has to be enough: what that leaves is more likely its form.
        """
        if min(found.share, found.share_out) > self.least_share(before, others):
            return True
        level = before.significance <= REST_SIGNIFICANCE and not others
        return level and self.is_clear(found, before.size)

    def is_much(self, missing: Excess) -> bool:
        """Whether so much is missing that a remainder is to be expected."""
        return missing.relative > self.much

    def is_clear(self, found: Improvement, rows: int) -> bool:
        """Whether a gain speaks for itself: four standard deviations, and worth a cause.

        Where outputs move by less than in proportion to a size (a presliding distance), its
        standard deviation is no measure of how far it is from nothing, but the gain is (Hauck,
        Donner, J. Am. Stat. Assoc. 72 (1977) 851, doi:10.1080/01621459.1977.10479969).

        Args:
            found: what a candidate gains. rows: of the residual.
        """
        least = self.worth * SOFT_MEAN * rows
        return found.p_value < self.p_clear and min(found.gain, found.gain_out) > least

    def allow(self, found: Improvement) -> bool:
        """Whether something gains on runs left out as well, and no accident does as much."""
        return (
            found.gain > self.gain
            and found.gain_out > self.gain / 2
            and self.is_sure(found)
            and found.runs_better >= self.runs_better
        )

    def is_sure(self, found: Improvement) -> bool:
        """Whether a gain is no accident, on runs left out."""
        all_of_it = min(found.share, found.share_out) > _NEARLY_ALL
        plain = min(found.gain, found.gain_out) > self.plain
        return found.p_value < (self.p_few if all_of_it and plain else self.p_value)
