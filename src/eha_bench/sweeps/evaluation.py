"""What happens at a point: the suite is run and judged, and nothing but its figures is kept."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from eha_bench.bench.judging import Scorer, judge, judge_together
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError, InputError
from eha_bench.core.finite import finite_or_none
from eha_bench.core.limit import AcceptanceLimit, Repeats
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Score
from eha_bench.core.trial import Trial
from eha_bench.metrics import score
from eha_bench.suites import Suite
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.space import Point, Space
from eha_bench.targets.crash import crashes_as_faults
from eha_bench.targets.target import Ending


@dataclass(frozen=True)
class LimitName:
    """A limit of a suite.

    Attributes:
        trial, metric, channel: what is limited. text: the limit as the suite wrote it.
        key: its name as a column: `knee_step.response_time`.
    """

    trial: str
    metric: str
    channel: str
    text: str
    key: str


def limits_of(suite: Suite) -> tuple[LimitName, ...]:
    """Return all limits of a suite, in its order; keys are unique."""
    found: list[LimitName] = []
    limits: Counter[str] = Counter()
    for trial in suite.trials:
        for limit in trial.limits:
            key = score_key(trial, limit.metric, limit.channel)
            limits[key] += 1
            named = f"{key}#{limits[key]}" if limits[key] > 1 else key
            found.append(LimitName(trial.id, limit.metric, limit.channel, limit.text, named))
    return tuple(found)


def score_key(trial: Trial, metric: str, channel: str) -> str:
    """Return the column of a score: `trial.metric`, its channel where it is not the trial's own."""
    own = not channel or channel == trial.channel or metric == "holding_current"
    return f"{trial.id}.{metric}" if own else f"{trial.id}.{metric}.{channel}"


@dataclass(frozen=True)
class PointResult:
    """A suite's figures at a point.

    Attributes:
        status: of the suite. margins: of every limit, in the order of `limits_of`; NaN where it is
            not scored. values: of every score by its key, SI; the mean of repeats.
        units: of the values. reason: what stopped it, if anything did.
    """

    status: Status
    margins: tuple[float, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether all limits were kept."""
        return self.status is Status.PASSED

    @property
    def margin(self) -> float:
        """The least margin; NaN where a limit is not scored, or there is none."""
        return float(np.min(self.margins)) if self.margins else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "status": self.status.value,
            "margins": [finite_or_none(value) for value in self.margins],
            "values": {key: finite_or_none(value) for key, value in self.values.items()},
            "units": dict(self.units),
            "reason": self.reason,
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> PointResult:
        """Return what `to_dict` gave."""
        return PointResult(
            Status(data["status"]),
            tuple(_number(value) for value in data["margins"]),
            {key: _number(value) for key, value in data["values"].items()},
            dict(data["units"]),
            str(data["reason"]),
        )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


@dataclass(frozen=True)
class PointEvaluation:
    """Runs and judges the case at a point of a space; picklable, the same wherever it runs."""

    space: Space

    def __call__(self, point: Point) -> PointResult:
        """Return the figures; what cannot be run there is a fault of that point."""
        try:
            case = self.space.at(point)
        except InputError as error:
            return PointResult(
                Status.FAULT,
                (math.nan,) * len(limits_of(self.space.case.suite)),
                reason=error.what,
            )
        return figures_of_case(case)


MOST_SAMPLES: Final = 400
"""Samples of a curve that is kept."""


@dataclass(frozen=True)
class TrialResponse:
    """What a trial's controlled channel did, thinned.

    Attributes:
        unit: SI unit. time: (n,) s. reference, values: (n,).
    """

    unit: str
    time: FloatArray
    reference: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class ChannelRange:
    """How far a channel went: its lowest and highest value, SI, and its unit."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Evaluated:
    """A case's figures, and of each trial's first repeat what its channels did.

    Attributes:
        result: the figures. ranges: trial -> channel -> how far it went.
        curves: trial -> what its controlled channel did, where that was asked for.
    """

    result: PointResult
    ranges: Mapping[str, Mapping[str, ChannelRange]] = field(default_factory=dict)
    curves: Mapping[str, TrialResponse] = field(default_factory=dict)

    @staticmethod
    def of(case: Case, draw: int = 0, *, curves: bool = False) -> Evaluated:
        """Run and judge a case; `draw` chooses the noise of the sensors."""
        ranges: dict[str, Mapping[str, ChannelRange]] = {}
        kept: dict[str, TrialResponse] = {}

        def look(trial: Trial, recording: Recording) -> None:
            if trial.id in ranges:
                return
            ranges[trial.id] = _ranges(recording)
            if curves and trial.channel in recording:
                kept[trial.id] = _curve(recording, trial)

        return Evaluated(figures_of_case(case, draw, look), ranges, kept)


def figures_of_case(
    case: Case,
    draw: int = 0,
    look: Callable[[Trial, Recording], None] | None = None,
    scorer: Scorer = score,
) -> PointResult:
    """Return the figures of a case.

    Args:
        case: what is run. draw: chooses the noise of the sensors: that of a run for 0.
        look: gets every recording that is complete. scorer: gives the scores.
    """
    margins: list[float] = []
    results: list[TrialResult] = []
    values: dict[str, float] = {}
    units: dict[str, str] = {}
    reasons: list[str] = []
    for trial in case.suite.trials:
        first = draw * trial.repeats
        runs = [_run(case, trial, first + number, look, scorer) for number in range(trial.repeats)]
        runs = judge_together(runs, trial.limits)
        results += runs
        margins += trial_margins(trial, runs)
        reasons += [f"{run.id}: {run.reason}" for run in runs if run.reason]
        reasons += [
            f"{run.id}: {score.metric} is not scored: {score.measure.reason}"
            for run in runs
            for score in run.scores
            if score.limit and not math.isfinite(score.value)
        ]
        for key, scores in _by_key(trial, runs).items():
            values[key] = float(np.mean([score.value for score in scores]))
            units[key] = scores[0].unit
    return PointResult(
        Result.overall(tuple(results), complete=True),
        tuple(margins),
        values,
        units,
        reasons[0] if reasons else "",
    )


def _run(
    case: Case,
    trial: Trial,
    repeat: int,
    look: Callable[[Trial, Recording], None] | None,
    scorer: Scorer,
) -> TrialResult:
    try:
        with crashes_as_faults():
            case.simulator.check(trial)
            outcome = case.simulator.run(trial, repeat)
    except EhaBenchError as error:
        return TrialResult(trial.id, repeat, Status.FAULT, "", "", reason=error.what)
    if outcome.ending is not Ending.COMPLETE:
        reason = f"{outcome.ending.value}: {outcome.reason}"
        return TrialResult(trial.id, repeat, Status.FAULT, "", "", reason=reason)
    if look is not None:
        look(trial, outcome.recording)
    return judge(outcome.recording, trial, repeat, scorer)


def _ranges(recording: Recording) -> dict[str, ChannelRange]:
    found = {}
    for name in recording:
        values = recording[name]
        values = values[np.isfinite(values)]
        if values.size:
            ends = float(values.min()), float(values.max())
            found[name] = ChannelRange(*ends, recording.unit(name))
    return found


def _curve(recording: Recording, trial: Trial) -> TrialResponse:
    start = float(recording.metadata.get("signal_start", "0"))
    thin = slice(None, None, max(1, -(-len(recording) // MOST_SAMPLES)))
    return TrialResponse(
        recording.unit(trial.channel),
        recording.time[thin] - start,
        recording["reference"][thin],
        recording[trial.channel][thin],
    )


def _by_key(trial: Trial, runs: Sequence[TrialResult]) -> dict[str, list[Score]]:
    found: dict[str, list[Score]] = {}
    for run in runs:
        for key, own in {
            score_key(trial, item.metric, item.channel): item for item in run.scores
        }.items():
            found.setdefault(key, []).append(own)
    return found


def trial_margins(trial: Trial, runs: Sequence[TrialResult]) -> list[float]:
    """Return the margin of each of a trial's limits over its repeats; NaN where it is not known."""
    found = []
    for place, limit in enumerate(trial.limits):
        # the scores of limits come first, in their order
        each = [
            _margin(run.scores[place], limit) if len(run.scores) > place else math.nan
            for run in runs
        ]
        over = np.median if limit.repeats is Repeats.MEDIAN else np.min
        found.append(float(over(each)))
    return found


def _margin(score: Score, limit: AcceptanceLimit) -> float:
    measure = score.measure
    ends = (measure.low, measure.high) if limit.confident else measure.span
    found = float(np.min([limit.bounds.margin(value) for value in ends]))
    return math.nan if found == -math.inf else found
