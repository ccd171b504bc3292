"""Refits of candidates: over long windows from where the search is, and over short ones afresh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.fit.baseline import COARSE, SCREENING
from eha_bench.diagnosis.fit.beliefs import is_beyond
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.convergence import has_gone_far
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED, SOFT_MEAN, Excess
from eha_bench.diagnosis.fit.finish import lowest_fit
from eha_bench.diagnosis.fit.friction_at_rest import (
    TELLING,
    at_rest,
    friction_at_rest,
    is_friction_at_rest,
    sticks,
)
from eha_bench.diagnosis.fit.least_squares import Fit, Free, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, cost_of
from eha_bench.diagnosis.fit.settled import settled_fit_of_one
from eha_bench.diagnosis.fit.short_windows import medium_problem
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.fit.start_angles import angles_of, is_periodic
from eha_bench.diagnosis.search.equivalent import is_far_above_noise, tie
from eha_bench.diagnosis.search.periodic import Wave, best_counts, in_parts, scan
from eha_bench.diagnosis.search.screen import Asked, Screen, Screened, starting_point, unlike
from eha_bench.diagnosis.search.state import Refit, Search, rival_share

_COARSELY = 0.002
"""Share of the cost that a coarse step may change where it tells how friction rests."""
_POOR = 1.02
"""A fit this much above the noise may be caught in another minimum."""
_NOISE = 1.003
_KEEP = 3
_HOPEFUL = 0.3
BENT = 0.3
"""Excess, as a share of the noise's cost, from which calibrated parameters imitate it."""
_BEGAN_WRONGLY = 1.5
_STRETCH = 0.5
"""Length of the windows over which effects of the shaft's angle are fitted before whole runs, s."""
_WORTH = 0.1
"""Least share of the short windows' excess that is worth a fit over long ones."""
_PROMISED = 0.3
"""Least share of that excess, predicted, for which a fit that fell short goes on."""
_MAY_WIN = 0.8
"""Least share of the best gain that is predicted of what may win; a fit gains more."""
_AS_MUCH = 0.97
"""Share of the best gain from which nothing was left on the way."""
_FURTHER = 10
"""Steps over long windows of what the short ones promised and is not there yet."""
_REACHED = 0.7
"""Least share of a predicted gain that has not fallen short: a fit gains more than is predicted."""


def is_bent(left: Excess) -> bool:
    """Whether so much is missing that calibrated parameters are bent to imitate it."""
    return left.relative > BENT


def free_of(search: Search, vector: FloatArray, extra: Sequence[Start]) -> tuple[Free, ...]:
    """Return what a fit with some more candidates may move."""
    places = search.problem.places
    keys = [key for key in search.keys if not sticks(key, vector[places.index[key]])]
    for start in [*(item.start for item in search.accepted), *extra]:
        keys += [key for key in start.keys if key not in keys]
    return free_parameters(places, keys, vector)


def refit(search: Search, coarse: Problem, item: Screened) -> Refit:
    """Fit a screened candidate roughly, from where the search is."""
    vector = starting_point(coarse, item, search.fit)
    free = free_of(search, vector, [item.start])
    # where a start has moved what is calibrated, the search's Jacobian is not the one there
    own = {item.start.strength_at, *(at for at, _ in item.start.settings)}
    moved = any(f.at in own for f in search.fit.free)
    known = {} if moved else search.fit.columns
    fit = levenberg_marquardt(
        coarse, vector, free, iterations=6 if moved else 4, known=known, refresh=int(moved)
    )
    return Refit(item.start, fit, NOT_COMPARED)


def polish(search: Search, rough: Fit, extra: Sequence[Start]) -> Fit:
    """Fit to the end, from where the rough fit is."""
    free = free_of(search, rough.vector, extra)
    fit = levenberg_marquardt(search.problem, rough.vector, free, known=rough.columns, refresh=1)
    return settled_fit_of_one(search.problem, fit)


def at_the_bottom(search: Search, fit: Fit) -> Fit:
    """Return a fit after which nothing is gained; far above the noise last steps tell little."""
    return fit if is_far_above_noise(fit) else lowest_fit(search.problem, fit)


def polish_afresh(search: Search, rough: Fit, extra: Sequence[Start]) -> Fit:
    """Fit to the end, from where the rough fit is or, if that is poor, from declared values."""
    if rough.cost > _POOR * SOFT_MEAN * search.problem.size:
        other = restarted_fit(search, rough.vector, extra)
        if other.cost < rough.cost:
            rough = other
    return polish(search, rough, extra)


def polish_at_rest(search: Search, rough: Fit, extra: Sequence[Start]) -> Fit:
    """Fit to the end, with friction at rest as the data ask for.

    What an effect left in the residual had bent that as well.
    """
    coarse = search.problem.at_step(COARSE)
    cost = cost_of(search.problem, rough.vector)
    # what rests creeps from step to step, by more in coarse ones than friction at rest may cost
    little = max(TELLING, _COARSELY * cost)
    asked = coarse if abs(cost_of(coarse, rough.vector) - cost) < little else search.problem
    return polish(search, at_rest(asked, rough), extra)


def polish_to_the_bottom(search: Search, rough: Fit, extra: Sequence[Start]) -> Fit:
    """Fit as `polish_at_rest` does, until nothing is gained."""
    return at_the_bottom(search, polish_at_rest(search, rough, extra))


def restarted_fit(search: Search, vector: FloatArray, extra: Sequence[Start]) -> Fit:
    """Fit from declared values, over short windows first and then over long ones.

    Without an effect the parameters had been bent to imitate it, and over long windows they may
    stay caught there; short windows have hardly any other minimum.
    """
    again = search.as_declared(vector)
    coarse = search.problem.at_step(COARSE)
    short = medium_problem(coarse)
    short.prepare(again)
    short.scale_to(short.residual(again))
    free = [item for item in free_of(search, again, extra) if not is_friction_at_rest(item.key)]
    near = levenberg_marquardt(short, again, free, iterations=8, refresh=1)
    other = levenberg_marquardt(coarse, near.vector, free, iterations=4, refresh=0)
    return friction_at_rest(coarse, other)


@dataclass(frozen=True)
class Nearby:
    """Candidates after a refit of all of them together over short windows.

    Attributes:
        starts: where each began, the one added last at the end. fit: the end.
    """

    starts: tuple[Start, ...]
    fit: Fit


def _most_promising(screened: Mapping[str, Sequence[Screened]], most: int) -> Iterator[Screened]:
    """Yield starts of as many candidates: several that are unlike of the first three.

    Args:
        screened: of each candidate, the best first. most: candidates.
    """
    hopeful = [own for own in screened.values() if own[0].gain > 0.0]
    for number, own in enumerate(hopeful[:most]):
        able = [item for item in own if item.gain > 0.0]
        yield from unlike(able)[: _KEEP if number < 3 else 1]


class Near:
    """The search over windows of 0.1 s, restarted from the declared parameters where it is bent.

    Where much is missing, a calibration over long windows bends the parameters until they imitate
    it, and candidates tried from there stay caught. Over short windows an error has no time to
    grow: parameters stay near where they belong, and what a candidate does is nearly linear. Where
    little is missing the parameters stay; there, short windows only hold the phase of
    effects of the shaft's angle.

    Args:
        search: with what has been added. coarse: its problem at a coarse step.
    """

    def __init__(self, search: Search, coarse: Problem) -> None:
        self.search = search
        self.coarse = coarse
        self.problem = medium_problem(search.problem.at_step(COARSE))
        self._from = (search.problem, search.fit, *search.accepted)
        bent = is_bent(search.excess_left)
        self.fit = self._from_declared() if bent else self._from_found()
        beyond = is_beyond(self.problem.beliefs, search.fit.vector)
        self._bases = [self.fit, *(self._as_declared() if bent or beyond else ())]
        self._asked: list[Start] = []
        # what was asked of a start is not asked again among others
        self._known: list[dict[Asked, Screened]] = [{} for _ in self._bases]
        self._refitted: dict[tuple[int, int], tuple[Screened, Nearby]] = {}
        self._screened: list[dict[str, list[Screened]]] = []
        self._fits: dict[int, list[Nearby]] = {}
        self._waves: dict[str, tuple[list[Start], list[Wave]]] = {}
        self._turned: dict[str, tuple[list[Start], list[Nearby]]] = {}

    @classmethod
    def of(cls, search: Search, coarse: Problem) -> Near:
        """Return the one that began from where the search is, and what it has found; or begin."""
        kept = search.near
        at = (search.problem, search.fit, *search.accepted)
        if not isinstance(kept, Near) or list(map(id, kept._from)) != list(map(id, at)):
            kept = search.near = cls(search, coarse)
        kept.coarse = coarse
        return kept

    def _from_declared(self) -> Fit:
        vector = self.search.as_declared(self.search.fit.vector)
        self._weigh(vector)
        free = self._free(vector, ())
        fit = levenberg_marquardt(self.problem, vector, free, iterations=6, refresh=1)
        self._weigh(fit.vector)
        fit = levenberg_marquardt(
            self.problem, fit.vector, free, iterations=3, known=fit.columns, refresh=0
        )
        return friction_at_rest(self.problem, fit)

    def _as_declared(self) -> Iterator[Fit]:
        """Yield the declared parameters, where those of the short windows have gone far from them.

        What a candidate does may be gone there: bristles bend by the dry friction, and a friction
        that rose before it slid was fitted best without any. A lag leads nowhere beside a spool
        that has become slow instead. Where no parameter moves far, or beyond what is believed of
        it, this would be the same again.
        """
        vector, now = self.search.as_declared(self.fit.vector), self.fit.vector
        far = any(has_gone_far(float(vector[at]), float(now[at])) for at in range(vector.size))
        if far or is_beyond(self.problem.beliefs, now):
            free = self._free(vector, ())
            yield levenberg_marquardt(self.problem, vector, free, iterations=0)

    def _from_found(self) -> Fit:
        """Stay with parameters that are hardly bent; what fits worse than they do began wrongly."""
        vector = self.search.fit.vector
        self._weigh(vector)
        residual = self.problem.residual(vector)
        squares = np.array([np.mean(residual[piece.rows] ** 2) for piece in self.problem.pieces])
        keep = np.flatnonzero(squares < _BEGAN_WRONGLY * np.median(squares))
        self.problem = self.problem.subset([int(k) for k in keep])
        self.problem.scale_to(self.problem.residual(vector))
        return levenberg_marquardt(self.problem, vector, self._free(vector, ()), iterations=3)

    def promising(self, starts: Sequence[Start], most: int) -> list[Start]:
        """Screen candidates over the short windows, and return the best starts of each.

        Args:
            starts: of the candidates. most: how many of each are returned.
        """
        if self._asked != list(starts):
            self._asked, self._screened, self._fits = list(starts), [], {}
            for base, known in zip(self._bases, self._known, strict=True):
                found: dict[str, list[Screened]] = {}
                for item in Screen(self.problem.at_step(SCREENING), base).all(starts, known):
                    found.setdefault(item.start.candidate, []).append(item)
                self._screened.append(found)
        return [item.start for own in self._screened[0].values() for item in own[:most]]

    def _weigh(self, vector: FloatArray) -> None:
        self.problem.prepare(vector)
        self.problem.scale_to(self.problem.residual(vector))

    def _free(self, vector: FloatArray, extra: Sequence[Start]) -> tuple[Free, ...]:
        free = free_of(self.search, vector, extra)
        return tuple(item for item in free if not is_friction_at_rest(item.key))

    @property
    def floor(self) -> float:
        """Cost of the short windows that noise alone makes."""
        return SOFT_MEAN * self.problem.size

    @property
    def excess(self) -> float:
        """What the short windows hold beyond noise, without what is looked for."""
        return self.fit.cost - self.floor

    def gain(self, item: Nearby) -> float:
        """Return the fall of the cost by what was fitted over the short windows."""
        return self.fit.cost - item.fit.cost

    def fits(self, most: int) -> list[Nearby]:
        """Return the best of the screened refitted over the short windows, the best first.

        Args:
            most: how many candidates will be asked for.
        """
        if most not in self._fits:
            self._fits[most] = self._best_of_forms(most)
        return self._fits[most]

    def _best_of_forms(self, most: int) -> list[Nearby]:
        chosen = [
            (item, base)
            for base, screened in zip(self._bases, self._screened, strict=True)
            for item in _most_promising(screened, most + 2)
        ]
        new = [pair for pair in chosen if (id(pair[0]), id(pair[1])) not in self._refitted]
        fits = side_by_side(lambda pair: self._refitted_from(*pair), new)
        for pair, fitted in zip(new, fits, strict=True):
            # the start is kept with it, so that no other one gets its id
            self._refitted[id(pair[0]), id(pair[1])] = pair[0], fitted
        roughly = [self._refitted[id(screened), id(base)][1] for screened, base in chosen]
        top = max(map(self.gain, roughly), default=0.0)
        found = side_by_side(
            lambda pair: self._further(*pair[0], pair[1], top),
            [*zip(chosen, roughly, strict=True)],
        )
        forms: dict[str, list[Nearby]] = {}
        for item in found:
            forms.setdefault(item.starts[-1].candidate, []).append(item)
        best = [self._simplest(own) for own in forms.values()]
        return sorted(best, key=lambda item: item.fit.cost)

    def _simplest(self, forms: Sequence[Nearby]) -> Nearby:
        """Return the form with the fewest numbers of those that gain about as much as the best.

        One that hardly needs its further numbers is caught by them over long windows.
        """
        most = max(self.gain(item) for item in forms)
        least = most - tie(abs(most), self.problem.size)
        as_much = [item for item in forms if self.gain(item) >= least]
        return min(as_much, key=lambda item: (len(item.starts[-1].keys), item.fit.cost))

    def trials(self, most: int) -> list[Refit]:
        """Return the best of the screened refitted, first over short windows, then long ones.

        Args:
            most: how many are taken to the long windows.
        """
        fits = self.fits(most)
        if not fits:
            return []
        best = self.fit.cost - fits[0].fit.cost
        least = rival_share(_HOPEFUL, best, self.excess) * best
        hopeful = [item for item in fits if self.fit.cost - item.fit.cost > least][:most]
        return side_by_side(self._trial, hopeful)

    def at_angles(self, starts: Mapping[str, StartAngle]) -> Near:
        """Return the same where runs begin at other angles, by name; what does not turn fits on."""
        other = copy(self)
        other.problem, other.coarse = self.problem.at_angles(starts), self.coarse.at_angles(starts)
        other._turned = {}
        other._known = [dict(known) for known in self._known]
        other._refitted = dict(self._refitted)
        return other

    def adopt_angles(self, starts: Mapping[str, StartAngle]) -> Near:
        """Return it where runs begin at other angles, by name, as its search does from now on."""
        search, other, before = self.search, self.at_angles(starts), angles_of(self.problem)
        after = angles_of(other.problem)
        turns = {name: after[name] - angle for name, angle in before.items()}
        other._waves = {
            name: (own, [wave.with_lead_angles(turns) for wave in waves])
            for name, (own, waves) in self._waves.items()
        }
        search.problem = search.problem.at_angles(starts)
        search.near = other
        other._from = (search.problem, search.fit, *search.accepted)
        return other

    def waves(self, starts: Sequence[Start]) -> list[Wave]:
        """Return what every count of what is periodic in the shaft's angle would gain.

        Args:
            starts: of one effect or several.
        """
        layout = self.search.problem.plant.layout
        found = []
        for name in dict.fromkeys(start.candidate for start in starts):
            own = [start for start in starts if start.candidate == name]
            if name not in self._waves or self._waves[name][0] != own:
                self._waves[name] = own, scan(self.problem, self.fit, layout, own)
            found += self._waves[name][1]
        return found

    def refit_periodic(self, starts: Sequence[Start]) -> list[Nearby]:
        """Return what is periodic in the shaft's angle refitted over the short windows.

        Args:
            starts: of one effect or several.
        """
        names = dict.fromkeys(start.candidate for start in starts)
        own = {name: [s for s in starts if s.candidate == name] for name in names}
        new = [n for n in names if n not in self._turned or self._turned[n][0] != own[n]]
        scanned = [start for name in new for start in best_counts(self.waves(own[name]))]
        fits = side_by_side(lambda start: self.fit_together((start,), start.apply(self.fit.vector)),
                            scanned)  # fmt: skip
        for name in new:
            fitted = [item for item in fits if item.starts[0].candidate == name]
            self._turned[name] = own[name], fitted
        found = [item for name in names for item in self._turned[name][1]]
        return sorted(found, key=lambda item: item.fit.cost)

    def turning(self, starts: Sequence[Start], most: int) -> list[Refit]:
        """Return the best of what is periodic in the shaft's angle, refitted as `trials` does.

        Args:
            starts: of one effect or several. most: how many are taken to the long windows.
        """
        fits = self.refit_periodic(starts)
        best = self.fit.cost - fits[0].fit.cost if fits else 0.0
        least = max(_WORTH * self.excess, _HOPEFUL * best)
        hopeful = [item for item in fits if self.fit.cost - item.fit.cost > least][:most]
        return side_by_side(self._trial, hopeful)

    def beside(self, first: Nearby, starts: Sequence[Start], most: int) -> list[Nearby]:
        """Return two candidates together over the short windows, the best first.

        Args:
            first: one of them, fitted. starts: of what may be the other.
            most: how many others are fitted.
        """
        screened = Screen(self.problem.at_step(SCREENING), first.fit).all(starts)
        best: dict[str, Screened] = {}
        for item in screened:
            if item.gain > 0.0:
                best.setdefault(item.start.candidate, item)

        def fitted(item: Screened) -> Nearby:
            vector = starting_point(self.problem, item, first.fit)
            return self.fit_together((*first.starts, item.start), vector, first.fit.columns)

        return side_by_side(fitted, list(best.values())[:most])

    def fit_together(
        self,
        starts: tuple[Start, ...],
        vector: FloatArray,
        known: Mapping[str, FloatArray] | None = None,
    ) -> Nearby:
        """Fit candidates together over the short windows, from a vector with all of them on."""
        columns = self.fit.columns if known is None else known
        free = self._free(vector, starts)
        fit = levenberg_marquardt(
            self.problem, vector, free, iterations=6, known=columns, refresh=1
        )
        return Nearby(starts, fit)

    def _refitted_from(self, item: Screened, base: Fit) -> Nearby:
        vector = starting_point(self.problem, item, base)
        return self.fit_together((item.start,), vector, base.columns)

    def _further(self, item: Screened, base: Fit, fitted: Nearby, top: float) -> Nearby:
        """Fit on with slopes of its own what fell short: those before the candidate led nowhere.

        What promised as much as the best, and fell behind it, may only have stopped earlier.

        Args:
            item: what was predicted. base: the fit that it was predicted from.
            fitted: as far as it was fitted. top: best gain of all.
        """
        ahead = self.fit.cost - base.cost
        fell_short = (
            item.gain > _PROMISED * self.excess
            and base.cost - fitted.fit.cost < _REACHED * item.gain
        )
        was_passed = ahead + item.gain > _MAY_WIN * top and self.gain(fitted) < _AS_MUCH * top
        if not (fell_short or was_passed):
            return fitted
        fit = levenberg_marquardt(
            self.problem, fitted.fit.vector, fitted.fit.free, iterations=10, refresh=4
        )
        return replace(fitted, fit=fit)

    def _trial(self, item: Nearby) -> Refit:
        return Refit(item.starts[-1], self.long(item), NOT_COMPARED)

    def long(self, item: Nearby) -> Fit:
        """Fit over long windows from where short ones have led."""
        layout = self.search.problem.plant.layout
        starts, near = item.starts, item.fit
        added = [*starts, *(item.start for item in self.search.accepted)]
        turns = any(not s.is_parameter and is_periodic(layout.effect(s.candidate)) for s in added)
        problem = self.coarse
        if turns:
            # over whole runs the phase is lost before the parameters are right
            problem = in_parts(self.search.problem, _STRETCH)
            problem.prepare(near.vector)
            problem.scale_to(problem.residual(near.vector))
        free = self._free(near.vector, starts)
        rounds = 8 if turns else 5
        fit = levenberg_marquardt(problem, near.vector, free, iterations=rounds, refresh=1)
        if fit.cost > _NOISE * SOFT_MEAN * problem.size:
            fit = friction_at_rest(problem, fit)
        if fit.cost >= self.search.fit.cost and not turns:
            # a valley between what is calibrated and the candidate is long
            fit = levenberg_marquardt(problem, fit.vector, fit.free, iterations=_FURTHER, refresh=3)
        if turns:
            # with the parameters right, the model keeps the phase by itself; a fast turn needs the
            # finer step
            own = self.search.problem
            free = free_of(self.search, fit.vector, starts)
            fit = levenberg_marquardt(own, fit.vector, free, iterations=6, refresh=1)
        return fit
