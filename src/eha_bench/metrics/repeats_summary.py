"""Mean, median and worst of every metric over the repeats of a trial."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.metric import Better
from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.score import Measure, Score
from eha_bench.core.trial import Trial
from eha_bench.metrics.repeats import median


def summaries(trial: Trial, repeats: Sequence[tuple[Score, ...]]) -> tuple[RepeatsSummary, ...]:
    """Return a summary of every metric and channel that two repeats or more were scored for.

    Args:
        trial: what was repeated, with those of the suite's own metrics that it asks for.
        repeats: the scores of each.
    """
    grouped: dict[tuple[str, str], list[Score]] = {}
    for scores in repeats:
        # a metric may have several limits: it is still one value a repeat
        for key, score in {(item.metric, item.channel): item for item in scores}.items():
            grouped.setdefault(key, []).append(score)
    found = []
    for (name, channel), own in grouped.items():
        measures = [score.measure for score in own if math.isfinite(score.value)]
        if len(measures) >= 2:
            found.append(
                RepeatsSummary(
                    trial=trial.id,
                    metric=name,
                    channel=channel,
                    unit=own[0].unit,
                    repeats=len(measures),
                    not_scored=len(repeats) - len(measures),
                    mean=mean(measures),
                    median=median(measures),
                    worst=worst(measures, _better(trial, name)),
                )
            )
    return tuple(found)


def _better(trial: Trial, name: str) -> Better:
    """Return which of two values is the better one; unknown of a metric that is gone."""
    try:
        return trial.spec_of(name).better
    except EhaBenchError:  # scores of an earlier run, which is resumed without a plug-in
        return Better.UNKNOWN


def mean(measures: Sequence[Measure]) -> Measure:
    """Return the mean of at least two values with Student's 95 % interval.

    That is what a studentised parametric bootstrap of the mean comes to (see `repeats.py` for why
    the plain one is not used). Values that are all the same keep their own interval.
    """
    values = np.array([measure.value for measure in measures])
    middle = float(values.mean())
    if float(np.ptp(values)) == 0.0:
        own = measures[0]
        return Measure(own.value, own.low, own.high).censored_like(measures)
    reach = float(stdtrit(values.size - 1, 0.975) * np.std(values, ddof=1) / math.sqrt(values.size))
    return Measure(middle, middle - reach, middle + reach).censored_like(measures)


def worst(measures: Sequence[Measure], better: Better) -> Measure:
    """Return the worst repeat: the farthest from the median where no direction is the worse."""
    middle = float(np.median([measure.value for measure in measures]))

    def badness(measure: Measure) -> float:
        low, high = measure.span
        match better:
            case Better.LOWER:
                return high
            case Better.HIGHER:
                return -low
            case Better.NEARER_ZERO:
                return max(abs(low), abs(high))
            case Better.NEARER_ONE:
                return max(abs(low - 1.0), abs(high - 1.0))
            case Better.UNKNOWN:
                return max(abs(low - middle), abs(high - middle))

    return max(measures, key=badness)
