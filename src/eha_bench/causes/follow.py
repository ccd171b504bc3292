"""From the nights of a history to the causes behind it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from eha_bench.causes.correction import Metered
from eha_bench.causes.estimates import Estimates, estimates
from eha_bench.causes.evidence import (
    NightEvidence,
    Reference,
    differences_of,
    evidence_of,
)
from eha_bench.causes.forecast import ahead_of, pace_of
from eha_bench.causes.keeping import Kept
from eha_bench.causes.limits import CauseLimits
from eha_bench.causes.nights import NightRuns, dataset_of, runs_of
from eha_bench.causes.settings import CauseSettings
from eha_bench.causes.wearing import (
    ROUNDS,
    Attribution,
    CauseCourse,
    attribution_of,
    course_of,
    healthy_nights,
)
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.moment import seconds_of
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.fit.baseline import COARSE, calibrated_baseline
from eha_bench.diagnosis.fit.side_by_side import one_thread_of_algebra
from eha_bench.sweeps.evaluation import score_key
from eha_bench.trends.changes import FEWEST
from eha_bench.trends.history import History
from eha_bench.trends.index import Night
from eha_bench.trends.trend import Trend, TrendState
from eha_bench.trends.wear import MATTERS, Causes, CauseTrend, Number, Wear

Progress = Callable[[str, float], None]

CALIBRATED_ON: Final = 3
"""First nights that the healthy machine is calibrated on."""
EXPLAINS: Final = 0.5
"""Part of what changed that a cause has to explain to be named."""
_DAY: Final = 86_400.0
_NORMAL: Final = 1.959963984540054


def silent(_stage: str, _share: float) -> None:
    """Say nothing."""


def causes_behind(
    history: History, folder: Path, site: Path, settings: CauseSettings, progress: Progress = silent
) -> Causes:
    """Return the causes behind the nights of the newest run's suite and target.

    Args:
        history: of the metrics. folder: that its nights' paths are relative to.
        site: folder of the history, next to which estimates are kept.
        settings: what is followed. progress: called with the stage and the share of it done.
    """
    newest = history.nights[-1]
    group = (newest.suite, newest.target)
    nights = [item for item in history.nights if (item.suite, item.target) == group]
    runs = [runs_of(night, folder, settings) for night in nights]
    known = [item for item in runs if item.runs]
    untold = [(item.night, item.missing) for item in runs if not item.runs]
    kept = Kept(site, settings.digest)
    with one_thread_of_algebra():
        try:
            reference = _reference(known, settings, kept, progress)
        except EhaBenchError as error:
            note = f"the healthy machine could not be calibrated: {error}"
            return Causes(*group, untold=tuple(untold), notes=(note,))
        weighed: list[tuple[Night, NightEvidence]] = []
        before: Mapping[str, float] = {}
        for number, item in enumerate(known):
            progress("nights", number / len(known))
            found = _evidence(item, reference, settings, kept, before)
            if found.failed:
                untold.append((item.night, found.failed))
            else:
                weighed.append((item.night, found))
                before = found.point
        return _Followed(history, settings, reference, kept, weighed).causes(group, tuple(untold))


def _reference(
    nights: Sequence[NightRuns], settings: CauseSettings, kept: Kept, progress: Progress
) -> Reference:
    """Return the machine as the first nights show it."""
    made_of = "\0".join(item.digest for item in nights[:CALIBRATED_ON])
    known = kept.reference(made_of)
    if known is not None:
        return known
    progress("calibrate", 0.0)
    runs = [
        Run(f"{run.name}-{number}", run.log, run.channels, False, False, run.use, run.reader)
        for number, item in enumerate(nights[:CALIBRATED_ON])
        for run in item.runs
    ]
    if not runs:
        raise EhaBenchError("no night has a recording")
    base = calibrated_baseline(dataset_of(tuple(runs), settings))
    size = settings.model.plant.layout.size
    level = base.fit.cost / max(1, base.problem.size)
    noise = {name: float(value) for name, value in base.problem.noise.items()}
    found = Reference(base.fit.vector[:size], noise, float(base.problem.soft), float(level))
    problem = base.problem.at_step(COARSE)
    found = replace(found, differences=differences_of(problem, found, settings.causes))
    kept.keep_reference(made_of, found)
    return found


def _evidence(
    item: NightRuns,
    reference: Reference,
    settings: CauseSettings,
    kept: Kept,
    before: Mapping[str, float],
) -> NightEvidence:
    made_of = f"{item.digest}\0{reference.vector.tolist()}"
    known = kept.evidence(made_of)
    if known is not None:
        return known
    try:
        found = evidence_of(dataset_of(item.runs, settings), reference, settings.causes, before)
    except EhaBenchError as error:
        found = NightEvidence.none([cause.name for cause in settings.causes], error.what)
    kept.keep_evidence(made_of, found)
    return found


class _Followed:
    """Nights with estimates of the causes, and what follows from them."""

    def __init__(
        self,
        history: History,
        settings: CauseSettings,
        reference: Reference,
        kept: Kept,
        weighed: Sequence[tuple[Night, NightEvidence]],
    ) -> None:
        self._history, self._settings, self._reference = history, settings, reference
        self._kept = kept
        self._nights = tuple(night for night, _ in weighed)
        self._evidence = [evidence for _, evidence in weighed]
        self._causes = settings.causes
        self._healthy_values = np.array([
            float(reference.vector[cause.place]) for cause in settings.causes
        ])  # fmt: skip
        self._steps = np.array([cause.step for cause in settings.causes])
        self._times = _night_numbers(self._nights)
        self._missed: tuple[str, ...] = ()
        self._unnamed = ""

    def causes(self, group: tuple[str, str], untold: tuple[tuple[Night, str], ...]) -> Causes:
        """Return trends, and what wears."""
        count = len(self._nights)
        if count < FEWEST:
            note = f"{count} nights could be used; {FEWEST} are needed"
            return Causes(*group, untold=untold, notes=(note,))
        healthy = min(count, self._settings.healthy)
        found, courses = self._courses(healthy)
        for _ in range(ROUNDS):
            better = healthy_nights(courses, count, min(count, self._settings.healthy))
            if better == healthy:
                break
            healthy = better
            found, courses = self._courses(healthy)
        chosen = attribution_of(found, courses, self._causes, self._healthy_values)
        if chosen is not None and not chosen.share >= EXPLAINS:
            self._unnamed = f"{self._causes[chosen.cause].name} {100.0 * chosen.share:.2g} %"
            chosen = None  # a wrong name is worse than none
        trends = [self._trend(k, found, courses[k]) for k in range(len(self._causes))]
        wear = () if chosen is None else (self._wear(chosen, courses, trends, healthy),)
        order = sorted(
            (k for k in range(len(trends)) if trends[k].values.size),
            key=lambda k: (not courses[k].moves, -_moved_in(found, k)),
        )
        if chosen is not None:
            order = [chosen.cause, *(k for k in order if k != chosen.cause)]
        return Causes(
            *group, tuple(trends[k] for k in order), wear, untold, self._notes(found, trends)
        )

    def _courses(self, healthy: int) -> tuple[Estimates, list[CauseCourse]]:
        sizes = np.abs(self._healthy_values) / self._steps
        found = estimates(self._evidence, self._causes, sizes, healthy)
        family = max(1, int(np.isfinite(found.changes).any(axis=0).sum()))
        courses = [
            course_of(found, k, family, self._settings.healthy) for k in range(len(self._causes))
        ]
        return found, courses

    def _trend(self, k: int, found: Estimates, course: CauseCourse) -> CauseTrend:
        cause, start = self._causes[k], self._healthy_values[k]
        state = course.judged.state
        word = "moves" if course.moves else "steady"
        word = state.value if state is TrendState.TOO_FEW else word
        return CauseTrend(
            cause.name,
            cause.unit,
            float(start),
            tuple(self._nights[place] for place in course.at),
            start + cause.step * course.values,
            cause.step * found.deviations[course.at, k],
            start + cause.step * course.judged.course.line,
            word,
        )

    def _wear(
        self,
        chosen: Attribution,
        courses: Sequence[CauseCourse],
        trends: Sequence[CauseTrend],
        healthy: int,
    ) -> Wear:
        k = chosen.cause
        cause, trend, course = self._causes[k], trends[k], courses[k]
        if not course.moves:  # it explains most, though an imitator was found to move first
            moving = [item for item in courses if item.moves]
            course = min(moving, key=lambda item: item.since)
        since = course.since
        own = courses[k]
        inside = own.at >= max(since, course.latest)
        values, deviations = trend.values[inside], trend.deviations[inside]
        first = own.at < healthy
        level = float(np.median(trend.values[first]))
        pace = pace_of(self._times[own.at[inside]], values, deviations)
        now = pace.level if pace is not None else float(np.median(values[-3:]))
        error = (
            math.sqrt(float(pace.covariance[0, 0])) if pace is not None
            else float(np.median(deviations)) / math.sqrt(max(1, min(3, values.size)))
        )  # fmt: skip
        moved = Number(now - level, now - level - _NORMAL * error, now - level + _NORMAL * error)
        limits = self._limits(healthy)
        if limits is not None:
            self._missed = limits.missed
        crossing = None
        if limits is not None and limits.some:
            everywhere = np.full(len(self._nights), np.nan)
            everywhere[own.at] = trend.values
            crossing = limits.first(cause, everywhere, moved.value)
        ahead = None
        if crossing is not None and pace is not None and pace.goes_on:
            ahead = ahead_of(pace, crossing) if pace.slope * moved.value > 0.0 else None
        if crossing is not None:
            alarm = abs(moved.value) >= MATTERS * abs(crossing.value - self._healthy_values[k])
        else:
            alarm = limits is None or not limits.some
        return Wear(
            trend,
            tuple(self._causes[rival].name for rival in chosen.rivals),
            chosen.share,
            self._nights[since],
            self._nights[course.earliest],
            self._nights[course.latest],
            moved,
            pace.rate if pace is not None and pace.goes_on else None,
            crossing,
            ahead.left if ahead is not None else None,
            bool(alarm),
            ahead.chances if ahead is not None else (),
        )

    def _limits(self, healthy: int) -> CauseLimits | None:
        case = self._settings.case
        if case is None:
            return None
        places = {night.id: place for place, night in enumerate(self._nights)}
        metered = {}
        for trend in self._history.trends:
            key = self._key(trend)
            values = np.full(len(self._nights), np.nan)
            for night, value in zip(trend.nights, trend.values, strict=True):
                if night.id in places:
                    values[places[night.id]] = value
            if key and np.isfinite(values[:healthy]).any():
                metered[key] = Metered(values, healthy)
        return CauseLimits(case, self._settings.model, self._reference.vector, metered, self._kept)

    def _key(self, trend: Trend) -> str:
        case = self._settings.case
        trials = case.suite.trials if case is not None else ()
        newest = self._nights[-1]
        if (trend.suite, trend.target) != (newest.suite, newest.target):
            return ""
        for trial in trials:
            if trial.id == trend.trial:
                return score_key(trial, trend.metric, trend.channel)
        return ""

    def _notes(self, found: Estimates, trends: Sequence[CauseTrend]) -> tuple[str, ...]:
        notes = []
        if found.oil:
            notes.append(
                "oil temperature was logged: its influence on the calibrated parameters is removed"
            )
        else:
            notes.append(
                "oil temperature was not logged: what moves viscous friction and leakage "
                "together, as the oil's viscosity does, is taken out"
                if found.thinning
                else "oil temperature was not logged, and nothing that is calibrated follows its "
                "viscosity: what it moves counts as varying from night to night"
            )
        blind = [trend.name for trend in trends if not trend.values.size]
        if blind:
            notes.append(f"these runs do not determine {', '.join(blind)}")
        if self._settings.case is None:
            notes.append("no suite is named under 'diagnose': no limit is forecast")
        if self._unnamed:
            notes.append(
                "the machine changed, and none of the followed causes explains it alone (at best "
                f"{self._unnamed}): two causes at once, or one that is not followed"
            )
        if self._missed:
            limits = "; ".join(self._missed)
            notes.append(f"missed or not scored on the healthy machine, so not forecast: {limits}")
        return tuple(notes)


def _moved_in(found: Estimates, k: int) -> float:
    gains = found.gains[-3:, k]
    return float(np.median(gains))


def _night_numbers(nights: Sequence[Night]) -> FloatArray:
    """Return when each night was, counted in nights of the usual distance; their places if unsaid.

    Rigs that run every day miss some: what wears goes on in between.
    """
    places = np.arange(len(nights), dtype=np.float64)
    moments = np.array([seconds_of(night.started) for night in nights])
    if moments.size < 2 or not np.isfinite(moments).all():
        return places
    usual = float(np.median(np.diff(moments)))
    if usual < 0.5 * _DAY:
        return places
    usual = _DAY if usual < 1.5 * _DAY else usual
    return np.asarray((moments - moments[0]) / usual)
