"""The state of a search: candidates tried, effects added, and when one is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.reversals import turns_back
from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.candidates import (
    SameNumber,
    SheetNumber,
    Start,
    all_starts,
    declared_sizes,
    start_values,
)
from eha_bench.diagnosis.fit.evidence import (
    Excess,
    Groups,
    Improvement,
    excess,
    groups_of,
)
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.thresholds import DEFAULT, Thresholds

ALL_BUT_A_FORM = 0.02
"""Share of what was missing up to which what effects leave of it is taken for their form."""


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
    """What was added: an effect, or a parameter whose value may be wrong.

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
        exchanged_from: where an exchange would change nothing. pairs_tried: whether two at once
            were looked for, which begins from nothing: what was found since changes nothing of it.
        too_small: candidates that would have been added, were they not smaller than their logs
            can tell, with a clause that says so.
        near: the last search over short windows (`refit.Near`), where it began.
        excess_base, excess_left: beyond noise before and after.
        thresholds: when something is missing, believed, and kept.
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
    pairs_tried: bool = False
    too_small: dict[str, str] = field(default_factory=dict)
    near: object | None = None
    thresholds: Thresholds = DEFAULT

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

    def as_declared(self, vector: FloatArray) -> FloatArray:
        """Return a vector with what is calibrated as it was declared.

        A run's own load and how late stamps are were declared by nobody: they stay as fitted.
        """
        places, out = self.problem.places, vector.copy()
        undeclared = {item.key for item in places.behind}
        for key in self.keys:
            if key not in undeclared:
                out[places.index[key]] = self.declared_vector[places.index[key]]
        return out

    def look_of(self, item: Accepted) -> list[Refit]:
        """Return the look in which something was added, the best first; [] where none is kept."""
        name = item.start.candidate
        return next((look for look in self.looks if any(t.candidate == name for t in look)), [])

    @property
    def share_left(self) -> float:
        """What was added leaves of what was missing, as a share; above 1 where it does harm."""
        return max(self.excess_left.total, 0.0) / max(self.excess_base.total, 1.0)

    @property
    def is_unexplained(self) -> bool:
        """Whether what is left holds more than noise and what a nearly right model leaves."""
        return self.thresholds.is_unexplained(self.excess_left)

    @property
    def is_all_but_a_form(self) -> bool:
        """Whether effects leave so little of what was missing that it is more likely their form.

        No other two are looked for then, nor what hides in a window's start: either takes as long
        as all before.
        """
        return len(self.effects) > 0 and self.share_left < ALL_BUT_A_FORM

    @property
    def effects(self) -> list[Accepted]:
        """What was added and is an effect."""
        return [item for item in self.accepted if not item.start.is_parameter]


def accept_nothing(search: Search) -> None:
    """Go back to the calibrated model: nothing is added to it."""
    search.accepted, search.fit = [], search.base
    search.excess_left = search.excess_base


def starts_of(search: Search, taken: Sequence[str] = ()) -> list[Start]:
    """Return the starting points of everything that may be missing and that data permit.

    Args:
        search: its state. taken: ids of effects that are there besides the declared ones.
    """
    places, vector = search.problem.places, search.fit.vector
    declared = [*search.declared, *taken]
    numbers = [item.start for item in search.accepted if item.start.is_parameter]
    fitted = [*search.keys, *(key for start in numbers for key in start.keys)]
    starts = all_starts(places.layout, vector, declared, fitted)
    starts += declared_sizes(places.layout, vector, search.declared, search.keys)
    starts = [start for start in starts if places.may_begin(start.apply(vector), start.keys)]
    hidden = shown_by_no_run(search.problem)
    return [
        start
        for start in starts
        if start.candidate not in hidden
        and not _is_of_unread_sensor(search.problem, start)
        and not _is_of_open_loop(search.problem, start)
        and not _is_of_unread_side(search.problem, start)
    ]


def shown_by_no_run(problem: Problem) -> tuple[str, ...]:
    """Return ids of effects that show only where a motion turns back, where none does."""
    reversing = tuple(effect.id for effect in problem.plant.layout.effects if effect.reversing)
    if not reversing:
        return ()
    runs = {item.measured.run.name: item.measured for item in problem.windows}
    return () if turns_back([*runs.values()], problem.noise) else reversing


def _is_of_unread_side(problem: Problem, start: Start) -> bool:
    """Whether it is one number of both sides of a cylinder, of which not both pressures are read.

    The gain of one sensor is as good then.
    """
    if not isinstance(start, SameNumber) or isinstance(start, SheetNumber):
        return False
    pair = problem.plant.roles.pair
    return not pair or not {*pair} <= problem.noise.keys()


def _is_of_unread_sensor(problem: Problem, start: Start) -> bool:
    """Whether it is an effect of sensors of which no recording has a reading, or of the only one.

    The only one that is late cannot be told from a command that is.
    """
    if start.is_parameter:
        return False
    layout = problem.plant.layout
    effect = layout.effect(start.candidate)
    places = effect.spots_at(start_values(layout, effect, start))
    sensors = [spot.sensors for spot in places]
    read = problem.noise.keys()
    if effect.effect.relative and read <= {name for own in sensors for name in own}:
        return True
    return all(own and read.isdisjoint(own) for own in sensors)


def _is_of_open_loop(problem: Problem, start: Start) -> bool:
    """Whether it is an effect of a controller inside the plant whose reference drives no run."""
    if start.is_parameter:
        return False
    layout = problem.plant.layout
    effect = layout.effect(start.candidate)
    places = effect.spots_at(start_values(layout, effect, start))
    references = {spot.reference for spot in places}
    if "" in references or not references:
        return False
    return not any(
        name in window.measured.inputs for window in problem.windows for name in references
    )


def begin(baseline: Baseline, thresholds: Thresholds = DEFAULT) -> Search:
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
        thresholds=thresholds,
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
