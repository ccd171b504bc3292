"""Tunes gains: a search at the model as fitted, one over draws of its posterior, and the proof.

The first search finds where all limits are kept at all, or what contradicts what; the second makes
P(pass) as large as possible on a few draws, the same for all candidates; the last step takes its
best and the gains as they are to all draws. Only these figures are reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.errors import InputError, Place
from eha_bench.core.interruption import Interruption
from eha_bench.core.progress import Progress, silent
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.core.yaml_file import line_of, parse
from eha_bench.posterior.posterior import Draw, Posterior
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.conditions import ANY, Conditions
from eha_bench.sweeps.evaluation import Evaluated, LimitName, limits_of
from eha_bench.sweeps.extrapolation import beyond_recordings
from eha_bench.sweeps.factor import Gain
from eha_bench.sweeps.probability import Probability, judged_only
from eha_bench.sweeps.space import Point, Space, space_of
from eha_bench.sweeps.span import Range
from eha_bench.tuning.aim import Aim, LeastMarginOf, PassProbability, Worst
from eha_bench.tuning.contradiction import Contradiction, contradiction
from eha_bench.tuning.search import (
    GainSearch,
    TriedGains,
    first_population,
    narrow_population,
)
from eha_bench.tuning.trying import GainTrials, Machine
from eha_bench.tuning.vary_file import VaryFile

_AS_FITTED = -1
"""Number of the machine that is the model itself; draws count from 0."""
_SHARE_AT_FITTED = 0.7
"""Of all candidates, those that are tried at the model as fitted only, on one machine each."""
_SHARE_SPREAD = 0.4
"""Of these, those that fill the ranges before any is chosen by what was found."""
_SPREAD = 0.08
"""Standard deviation of the second search's first population, in shares of the ranges."""
_FINALISTS = 2
_NEAR_MISS = -0.1
"""Least margin of the best, in shares of a limit, from which it may be that others keep all."""
_LONGER = 2
"""How many times as many candidates are then tried before it is called infeasible."""
_MOST_DOUBTS = 8
"""Limits, or sets of them, of which a separate search finds out whether they can be kept."""
_GENERATIONS_OF_DOUBT = 4


@dataclass(frozen=True)
class SearchEffort:
    """How much is tried.

    Attributes:
        candidates: gains that are tried; more where none passes.
        few: draws that the second search uses.
        draws: that the best is proven on. seed: of search and draws.
    """

    candidates: int = 240
    few: int = 10
    draws: int = 200
    seed: int = 0


@dataclass(frozen=True)
class Tuned:
    """What tuning found.

    Attributes:
        space: the gains. point: the best of them. before: as they were, None where a gain lies
            outside of its range. margins: of the best at the model as fitted.
        after: over the draws; None without a posterior, or where it was interrupted before.
        declared: the same of the gains as they were.
        tried: candidates. contradiction: why nothing passes; None where something does.
        notes: one sentence each. complete: False where it was interrupted.
    """

    space: Space
    point: Point
    before: Point
    margins: tuple[float, ...]
    limits: tuple[LimitName, ...]
    tried: int
    after: Probability | None = None
    declared: Probability | None = None
    contradiction: Contradiction | None = None
    notes: tuple[str, ...] = ()
    complete: bool = True

    @property
    def feasible(self) -> bool:
        """Whether the best gains pass anywhere."""
        return self.contradiction is None


def gains_space(case: Case, file: VaryFile) -> Space:
    """Return the space of a vary file's gains.

    Raises:
        InputError: a gain that no controller has, or an empty range.
    """
    return space_of(case, {Gain.kind: file.entries})


def tune(
    case: Case,
    file: VaryFile,
    posterior: Posterior | None,
    *,
    effort: SearchEffort | None = None,
    aim: Aim | None = None,
    conditions: Conditions = ANY,
    workers: Workers = IN_PROCESS,
    progress: Progress = silent,
) -> Tuned:
    """Return the gains that pass with the highest probability, and among these with most margin.

    Ctrl-C ends it and keeps the best so far.

    Args:
        case: suite, model and controllers. file: what may be changed. posterior: of the model;
            None tunes for the model as it stands. effort: how much is tried. aim: another one
            than P(pass). conditions: that machines are run in. workers: where candidates are run.
            progress: called after each generation.

    Raises:
        InputError: a gain that no controller has, an empty range, gains that no limit follows, or
            a limit that nothing scores.
    """
    effort, aim = effort or SearchEffort(), aim or PassProbability()
    space = gains_space(judged_only(case), file)
    trying = GainTrials(space, workers)
    if not trying.moves:
        raise InputError(
            "no trial with a limit is run under a controller of these gains",
            where=file.entries.place(),
            hint=f"its modes are: {', '.join(_modes(space.case))}",
        )
    for trial in space.case.suite.trials:
        space.case.simulator.check(trial)
    with Interruption() as interrupted:
        return _Tuning(trying, posterior, effort, aim, conditions, interrupted, progress).run()


def _modes(case: Case) -> tuple[str, ...]:
    return tuple(dict.fromkeys(trial.mode.name for trial in case.suite.trials))


@dataclass
class _Tuning:
    trying: GainTrials
    posterior: Posterior | None
    effort: SearchEffort
    aim: Aim
    conditions: Conditions
    interrupted: Callable[[], bool]
    progress: Progress

    def run(self) -> Tuned:
        space, effort = self.trying.space, self.effort
        size = max(8, 4 * len(space.factors))
        before = tuple(_declared_gains(space))
        first = self._search([Machine(_AS_FITTED, space.case.simulator.model)], Worst())
        whole = self.posterior is None
        candidates = max(size, round(effort.candidates * (1.0 if whole else _SHARE_AT_FITTED)))
        known = [np.array(_shares(space, before))]
        spread = max(size, round(_SHARE_SPREAD * candidates))
        start = first_population(known, len(space.factors), spread, effort.seed)
        with suppress(KeyboardInterrupt):  # asked for twice: the best so far stands
            first.explore(start, candidates, size, effort.seed)
            if first.tried and _NEAR_MISS < first.best.worth < 0.0:
                # where limits leave little room, few candidates find none of it: from places anew,
                # as more around the best ones would stay in their basin
                again = first_population([], len(space.factors), 2 * spread, effort.seed + 1)
                first.explore(again, _LONGER * candidates, size, effort.seed + 1, until=0.0)
        if not first.tried:
            raise KeyboardInterrupt
        self._check_scored(first, before)
        if self.posterior is None:
            return self._tuned_result(first, first.best, before, None, None)
        return self._over_draws(first, before, self.posterior)

    def _over_draws(self, first: GainSearch, before: Point, posterior: Posterior) -> Tuned:
        space, effort = self.trying.space, self.effort
        draws = self.conditions.met_by(posterior.draws(effort.draws, effort.seed), effort.seed)
        machines = [Machine(draw.number, draw.model, posterior.remainder) for draw in draws]
        second = self._search(machines[: effort.few], self.aim)
        ranked = sorted(first.tried, key=lambda item: -item.worth)
        size = max(5, 2 * len(space.factors))
        chosen = ranked[0]
        after: Probability | None = None
        declared: Probability | None = None
        with suppress(KeyboardInterrupt):
            start = narrow_population(ranked[:3], size, _SPREAD, effort.seed)
            second.run(start, self._generations(size, 1.0 - _SHARE_AT_FITTED), effort.seed)
            chosen = second.best if second.tried else chosen
            if second.tried and not self.interrupted():
                as_declared = _tried_at(first, before)
                chosen, after, declared = self._proven(
                    second, before, as_declared, draws, posterior
                )
        return self._tuned_result(first, chosen, before, after, declared, second)

    def _proven(
        self,
        second: GainSearch,
        before: Point,
        as_declared: TriedGains | None,
        draws: Sequence[Draw],
        posterior: Posterior,
    ) -> tuple[TriedGains, Probability, Probability]:
        """Return the best over all draws, what it does there, and what the declared gains do.

        The best is one of the finalists, chosen on few draws, or the declared gains where these are
        within their ranges.

        Args:
            second: the search over few draws. before: the declared gains.
            as_declared: the same as they were tried, None where they are outside their ranges.
            draws: on which they are checked. posterior: that they are of.
        """
        machines = [Machine(draw.number, draw.model, posterior.remainder) for draw in draws]
        finalists: list[TriedGains] = []
        for item in sorted(second.whole, key=lambda item: -item.worth):
            if item.point not in [other.point for other in finalists]:
                finalists.append(item)
            if len(finalists) == _FINALISTS:
                break
        points = [*(item.point for item in finalists), before]
        limits = limits_of(self.trying.space.case.suite)
        found = []
        for number, point in enumerate(points):
            if self.interrupted():
                raise KeyboardInterrupt  # the best of the search stands
            self.progress(number, len(points), "checking the best on all draws")
            rows = self.trying.results([point], machines, self.interrupted)
            if not rows:
                raise KeyboardInterrupt  # the best of the search stands
            found.append(Probability(limits, tuple(draws), tuple(rows[0]), notes=posterior.notes))
        candidates = finalists if as_declared is None else [*finalists, as_declared]
        worths = [self.aim.of(item.margins) for item in found[: len(candidates)]]
        best = int(np.argmax(worths))
        after, declared = (
            self._with_beyond(found[place], points[place], posterior) for place in (best, -1)
        )
        return candidates[best], after, declared

    def _with_beyond(self, found: Probability, point: Point, posterior: Posterior) -> Probability:
        """Return it with what lies beyond the recordings: as fitted, which the draws are about."""
        run = Evaluated.of(self.trying.space.at(point))
        beyond = beyond_recordings(self.trying.space.case.suite.trials, [run], posterior)
        notes = (*found.notes, *(item.note for item in beyond))
        return replace(found, beyond=beyond, notes=notes)

    def _search(self, machines: Sequence[Machine], aim: Aim) -> GainSearch:
        def tell(search: GainSearch) -> None:
            if isinstance(aim, LeastMarginOf):
                self.progress(0, self.effort.candidates, "searching for limits that cannot be kept")
                return
            what = "at the model as fitted" if len(machines) == 1 else f"over {len(machines)} draws"
            self.progress(
                len(search.tried), self.effort.candidates, f"{what}: best {search.best.worth:+.3f}"
            )

        return GainSearch(self.trying, machines, aim, self.interrupted, tell)

    def _generations(self, size: int, share: float) -> int:
        return max(1, round(share * self.effort.candidates / size) - 1)

    def _check_scored(self, first: GainSearch, before: Point) -> None:
        """Raise an InputError where a limit is scored for no candidate."""
        space = self.trying.space
        margins = np.concatenate([item.margins for item in first.tried])
        unscored = np.flatnonzero(~np.isfinite(margins).any(axis=0))
        if not unscored.size or self.interrupted():
            return
        suite = space.case.suite
        limit = limits_of(suite)[int(unscored[0])]
        alone = replace(suite, trials=tuple(t for t in suite.trials if t.id == limit.trial))
        case = replace(space.case, suite=alone)
        trying = GainTrials(replace(space, case=case), IN_PROCESS)
        machine = Machine(_AS_FITTED, case.simulator.model)
        found = trying.results([first.best.point], [machine])[0][0]
        raise InputError(
            f"nothing scores the limit on {limit.metric} ({found.reason or 'no reason is known'})",
            where=_place_of(suite.text, str(suite.path), limit),
            hint="; ".join(
                ("remove the limit, or widen the ranges", *_outside_ranges(space, before))
            ),
        )

    def _contradiction(self, first: GainSearch) -> Contradiction:
        """Return why nothing passes; a limit not kept so far is searched for alone first."""
        tried = [*first.tried]
        asked: set[tuple[int, ...]] = set()
        size = max(8, 4 * len(self.trying.space.factors))
        found = contradiction(np.concatenate([item.margins for item in tried]))
        while len(asked) < _MOST_DOUBTS and not self.interrupted():
            doubts = [*((place,) for place in found.never), *found.together]
            doubt = next((item for item in doubts if item not in asked), None)
            if doubt is None:
                break
            asked.add(doubt)
            search = self._search(first.machines, LeastMarginOf(doubt))
            nearest = sorted(tried, key=lambda item: -search.aim.of(item.margins))[:3]
            start = narrow_population(nearest, size, 3.0 * _SPREAD, self.effort.seed)
            with suppress(KeyboardInterrupt):  # those tried by then stand
                search.run(start, _GENERATIONS_OF_DOUBT, self.effort.seed)
            tried += search.tried
            found = contradiction(np.concatenate([item.margins for item in tried]))
        return found

    def _tuned_result(
        self,
        first: GainSearch,
        chosen: TriedGains,
        before: Point,
        after: Probability | None,
        declared: Probability | None,
        second: GainSearch | None = None,
    ) -> Tuned:
        space = self.trying.space
        machine = Machine(_AS_FITTED, space.case.simulator.model)
        margins = self.trying.margins([chosen.point], [machine])[0][0]
        passes = bool(np.all(margins >= 0.0)) if after is None else after.suite.kept > 0
        notes = list(self.posterior.notes) if self.posterior else []
        notes += [] if after is None else [item.note for item in after.beyond]
        notes += _outside_ranges(space, before)
        notes += _at_ends(space, chosen.point)
        if self.interrupted():
            notes.append("interrupted: these are the best gains so far")
        elif self.posterior is None:
            notes.append(
                "without a posterior the gains are tuned for the model as declared: its "
                "uncertainty is not considered"
            )
        tried = len(first.tried) + (len(second.tried) if second else 0)
        return Tuned(
            space,
            chosen.point,
            before,
            tuple(float(value) for value in margins),
            limits_of(space.case.suite),
            tried,
            after,
            declared,
            None if passes else self._contradiction(first),
            tuple(notes),
            not self.interrupted(),
        )


def _tried_at(search: GainSearch, point: Point) -> TriedGains | None:
    """Return what was tried at a point, None for nothing."""
    tried = np.array([item.point for item in search.tried], dtype=np.float64)
    same = np.isclose(tried, np.array(point, dtype=np.float64), rtol=1e-9, atol=0.0).all(axis=1)
    return search.tried[int(np.argmax(same))] if same.any() else None


def _outside_ranges(space: Space, before: Point) -> list[str]:
    """Say which declared gains are outside their ranges, one sentence each."""
    return [
        f"the declared {factor.key}, {factor.formatted(value)}, is outside its range"
        for factor, value in zip(space.factors, before, strict=True)
        if isinstance(factor.span, Range)
        and not factor.span.low <= float(value) <= factor.span.high
    ]


def _declared_gains(space: Space) -> list[float]:
    found = []
    for factor in space.factors:
        value = factor.declared_value(space.case)
        assert value is not None
        found.append(float(value))
    return found


def _shares(space: Space, point: Sequence[float | str]) -> list[float]:
    """Return where gains lie in their ranges; of a list the nearest level."""
    found = []
    for factor, value in zip(space.factors, point, strict=True):
        span = factor.span
        if isinstance(span, Range):
            found.append(span.share(float(value)))
            continue
        levels = [float(level) for level in span.levels]
        nearest = int(np.argmin([abs(level - float(value)) for level in levels]))
        found.append((nearest + 0.5) / len(levels))
    return found


def _at_ends(space: Space, point: Point) -> list[str]:
    """Return notes on gains that lie at an end of their range, beyond which may be better ones."""
    notes = []
    for factor, value in zip(space.factors, point, strict=True):
        if isinstance(factor.span, Range):
            share = factor.span.share(float(value))
            if not 0.01 < share < 0.99:
                notes.append(
                    f"{factor.key} ends at a bound of its range, {factor.formatted(value)}: values "
                    "beyond it may be better"
                )
    return notes


def _place_of(text: str, name: str, limit: LimitName) -> Place:
    """Return where a suite writes a limit."""
    content = parse(text, name)
    for number, trial in enumerate(content.get("trials", [])):
        stem = str(trial.get("id", "")).partition("${")[0]
        accept = trial.get("accept") or {}
        if limit.trial.startswith(stem) and limit.metric in accept:
            keys = ("trials", number, "accept", limit.metric)
            key = f"trials.{limit.trial}.accept.{limit.metric}"
            return Place(file=name, line=line_of(content, keys), key=key)
    return Place(file=name, key=f"trials.{limit.trial}.accept.{limit.metric}")


def finite_least(margins: Sequence[float]) -> float:
    """Return the least margin; NaN where one is not scored."""
    return float(np.min(margins)) if margins else math.nan
