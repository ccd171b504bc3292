"""Compares two sides metric by metric, and corrects for how many metrics there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from eha_bench.comparison.caveats import caveats, check_targets, trial_problem
from eha_bench.comparison.comparison import Compared, Comparison, Values
from eha_bench.comparison.correction import holm
from eha_bench.comparison.direction import Direction, direction_of
from eha_bench.comparison.evidence import ALPHA, Evidence, evidence
from eha_bench.comparison.planning import more_repeats
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.sequential import sequential
from eha_bench.comparison.side import Run, Side
from eha_bench.comparison.verdict import Verdict
from eha_bench.core.errors import UnitError
from eha_bench.core.margin import parse_margin
from eha_bench.core.metric import Better
from eha_bench.core.score import Score

DEFAULT_SHARE = 0.02
"""Of the baseline: the smallest difference that matters where the suite does not say."""

Key = tuple[str, str, str]


@dataclass(frozen=True)
class _Pair:
    """One metric of one trial, both sides scored: what the test needs."""

    item: Compared
    direction: Direction
    baseline: Sample
    candidate: Sample
    counted: bool
    p_missing: float = math.nan


def compare_sides(
    baseline: Side,
    candidate: Side,
    *,
    across_targets: bool = False,
    looks: Sequence[float] = (),
) -> Comparison:
    """Compare every metric of every trial.

    Args:
        baseline, candidate: the two sides.
        across_targets: whether results of different rigs are compared on purpose.
        looks: for repeats run in pairs and looked at while they came in: the share of the error
            rate that each look may use, by the number of pairs; see `sequential`.

    Raises:
        InputError: the two ran on different targets, and nobody said that this is meant.
    """
    if not across_targets:
        check_targets(baseline, candidate)
    items: list[Compared] = []
    pairs: dict[int, _Pair] = {}
    for trial in dict.fromkeys((*baseline.runs, *candidate.runs)):
        found = _trial(baseline, candidate, trial, paired=bool(looks))
        for entry in found:
            if isinstance(entry, _Pair):
                pairs[len(items)] = entry
                items.append(entry.item)
            else:
                items.append(entry)
    judged = _judged(list(pairs.values()), looks)
    for place, item in zip(pairs, judged, strict=True):
        items[place] = item
    return Comparison(
        baseline, candidate, tuple(items), caveats(baseline, candidate), ALPHA, bool(looks)
    )


def _trial(baseline: Side, candidate: Side, trial: str, *, paired: bool) -> list[Compared | _Pair]:
    sides = [side.runs.get(trial, ()) for side in (baseline, candidate)]
    usable = [[run for run in runs if run.usable] for runs in sides]
    keys: dict[Key, None] = {}
    for runs in sides:
        for run in runs:
            keys |= {(s.metric, s.channel, s.unit): None for s in run.trial.scores}
    problem = ""
    for name, runs, ended in zip(("baseline", "candidate"), sides, usable, strict=True):
        if not runs:
            problem = problem or f"the trial is missing in the {name}"
        elif not ended:
            problem = problem or f"no run of the {name} came to its end ({runs[0].trial.reason})"
    problem = problem or trial_problem(baseline, candidate, trial)
    if not keys:  # nothing was scored, but that must be told
        return [Compared(trial, "", "", "", reason=problem or "nothing was scored")]
    entries: list[Compared | _Pair] = []
    units: dict[tuple[str, str], set[str]] = {}
    for metric, channel, unit in keys:
        units.setdefault((metric, channel), set()).add(unit)
    for (metric, channel), found in units.items():
        item = Compared(trial, metric, channel, min(found))
        if problem:
            entries.append(replace(item, reason=problem))
        elif len(found) > 1:
            listed = " and ".join(f"'{unit}'" for unit in sorted(found))
            entries.append(replace(item, reason=f"mixed units: {listed}"))
        else:
            entries.append(_metric(item, usable, paired=paired))
    return entries


def _metric(item: Compared, usable: list[list[Run]], *, paired: bool) -> Compared | _Pair:
    scores = [[_score(run, item) for run in runs] for runs in usable]
    if paired:
        scores = _in_pairs(usable, scores)
    known = [score for side in scores for score in side if score is not None]
    limit = next((score.limit for score in known if score.limit), "")
    direction = direction_of(item.metric, item.unit, limit)
    item = replace(
        item,
        better=direction.words,
        baseline=_values(scores[0]),
        candidate=_values(scores[1]),
    )
    missing = _p_missing(item.baseline, item.candidate)
    counts = [len(side.values) for side in (item.baseline, item.candidate)]
    if not any(counts):
        why = (*item.baseline.reasons, *item.candidate.reasons, "no such score")[0]
        return replace(item, reason=f"not scored on either side: {why}")
    samples = [_sample(side) for side in scores]
    if math.isfinite(direction.aim):
        samples = [sample.distance_from(direction.aim) for sample in samples]
    values = np.concatenate([sample.values for sample in samples])
    counted = item.unit == "" and bool(np.all(values == np.round(values)) and values.max() > 0)
    margin, text = _margin(item, known, samples, counted=counted)
    item = replace(item, margin=margin, margin_text=text)
    return _Pair(item, direction, samples[0], samples[1], counted, missing)


def _score(run: Run, item: Compared) -> Score | None:
    for score in run.trial.scores:
        if (score.metric, score.channel) == (item.metric, item.channel):
            return score
    return None


def _in_pairs(
    usable: list[list[Run]], scores: list[list[Score | None]]
) -> list[list[Score | None]]:
    """Return the scores of those repeats that both sides have, in the same order."""
    by_repeat = [
        {run.trial.repeat: score for run, score in zip(runs, side, strict=True)}
        for runs, side in zip(usable, scores, strict=True)
    ]
    common = sorted(by_repeat[0].keys() & by_repeat[1].keys())
    whole = [
        repeat
        for repeat in common
        if all(
            score is not None and math.isfinite(score.value)
            for score in (side[repeat] for side in by_repeat)
        )
    ]
    # what is missing on one side costs the pair, but stays visible where nothing is left
    kept = whole or common
    return [[side[repeat] for repeat in kept] for side in by_repeat]


def _values(scores: Sequence[Score | None]) -> Values:
    found = [score for score in scores if score is not None]
    reasons = dict.fromkeys(
        score.measure.reason for score in found if not math.isfinite(score.value)
    )
    if len(found) < len(scores):
        reasons["no such score"] = None
    values = tuple(score.value for score in found if math.isfinite(score.value))
    return Values(values, len(scores), tuple(reasons))


def _sample(scores: Sequence[Score | None]) -> Sample:
    measures = [s.measure for s in scores if s is not None and math.isfinite(s.value)]
    columns = np.array([(m.value, m.low, m.high) for m in measures]).reshape(-1, 3)
    return Sample(columns[:, 0], columns[:, 1], columns[:, 2])


def _p_missing(baseline: Values, candidate: Values) -> float:
    """Return Fisher's exact p-value of 'both sides fail to be scored equally often'."""
    if not baseline.missing and not candidate.missing:
        return math.nan
    table = np.array(
        [[len(baseline.values), baseline.missing], [len(candidate.values), candidate.missing]]
    )
    return float(stats.fisher_exact(table).pvalue)


def _margin(
    item: Compared, known: Sequence[Score], samples: Sequence[Sample], *, counted: bool
) -> tuple[float, str]:
    """Return the smallest difference that matters: the suite's, or one by default, and its words.

    By default a difference matters from 2 % of the baseline on, but not below the scatter from
    run to run: any single run varies by that much.
    """
    reference = item.baseline.mean if item.baseline.values else item.candidate.mean
    for text in dict.fromkeys(score.matters for score in reversed(known) if score.matters):
        try:
            return parse_margin(text, item.unit).about(reference), text
        except UnitError:
            continue  # written for the metric on another channel
    spreads = [sample.variance for sample in samples if len(sample) > 1]
    if spreads:
        scatter = math.sqrt(sum(spreads) / len(spreads))
    else:
        halves = [(sample.high - sample.low) / 2.0 for sample in samples if len(sample)]
        widths = np.concatenate(halves)
        scatter = float(np.nanmax(widths)) if np.isfinite(widths).any() else 0.0
    share = DEFAULT_SHARE * abs(reference)
    if counted:
        return max(1.0, share, scatter), "by default: 1, 2 %, or the scatter of the runs"
    return max(share, scatter), "by default: 2 %, or the scatter of the runs"


def _judged(pairs: Sequence[_Pair], looks: Sequence[float]) -> list[Compared]:
    found = [_evidence(pair, len(pairs), looks) for pair in pairs]
    both = list(zip(pairs, found, strict=True))
    p_difference = holm([_combined(one, pair.p_missing) for pair, one in both])
    p_same = holm([one.p_same if one is not None else math.nan for one in found])
    return [
        _verdict(pair, one, p_difference[i], p_same[i], len(pairs), paired=bool(looks))
        for i, (pair, one) in enumerate(both)
    ]


def _evidence(pair: _Pair, family: int, looks: Sequence[float]) -> Evidence | None:
    if not len(pair.baseline) or not len(pair.candidate):
        return None
    samples, margin = (pair.baseline, pair.candidate), pair.item.margin
    if looks:
        return sequential(*samples, margin, family=family, counted=pair.counted, looks=looks)
    return evidence(*samples, margin, family=family, counted=pair.counted)


def _combined(found: Evidence | None, p_missing: float) -> float:
    """Return the p-value of 'neither the values nor how often there are any differ'."""
    values = found.p_difference if found is not None else math.nan
    tested = [p for p in (values, p_missing) if not math.isnan(p)]
    return min(1.0, len(tested) * min(tested)) if tested else math.nan


def _verdict(
    pair: _Pair,
    found: Evidence | None,
    p_difference: float,
    p_same: float,
    family: int,
    *,
    paired: bool,
) -> Compared:
    item = replace(pair.item, p_difference=p_difference, p_same=p_same, reason=_missing(pair.item))
    lost = item.candidate.missing / item.candidate.runs - item.baseline.missing / item.baseline.runs
    by_missing = not math.isnan(pair.p_missing) and (
        found is None or not pair.p_missing > found.p_difference
    )
    if found is not None:
        item = replace(
            item,
            difference=found.difference,
            low=found.low,
            high=found.high,
            method=found.method,
        )
    significant = p_difference <= ALPHA
    if significant and by_missing and lost != 0.0:
        verdict = Verdict.WORSE if lost > 0.0 else Verdict.BETTER
        return replace(item, verdict=verdict, method="Fisher's exact test of how often scored")
    if found is None:
        return replace(item, verdict=Verdict.UNDECIDED)
    if significant and abs(found.difference) >= item.margin:
        return replace(item, verdict=_worse_or_better(found.difference, pair.direction))
    if p_same <= ALPHA:
        return replace(item, verdict=Verdict.SAME)
    more = more_repeats(
        found.difference, item.margin, found.scatter,
        min(len(pair.baseline), len(pair.candidate)),
        alpha=ALPHA / family, paired=paired,
    )  # fmt: skip
    return replace(item, verdict=Verdict.UNDECIDED, more_repeats=more)


def _worse_or_better(difference: float, direction: Direction) -> Verdict:
    if math.isfinite(direction.aim) or direction.better is Better.LOWER:
        return Verdict.WORSE if difference > 0.0 else Verdict.BETTER
    if direction.better is Better.HIGHER:
        return Verdict.BETTER if difference > 0.0 else Verdict.WORSE
    return Verdict.CHANGED


def _missing(item: Compared) -> str:
    """Return how often each side was not scored, and why where nothing is left of it."""
    sides = (("baseline", item.baseline), ("candidate", item.candidate))
    parts = [f"{side.missing} of {side.runs} in the {name}" for name, side in sides if side.missing]
    reasons = dict.fromkeys(
        reason for _, side in sides if not side.values for reason in side.reasons
    )
    why = f" ({'; '.join(reasons)})" if reasons else ""
    return f"not scored: {', '.join(parts)}{why}" if parts else ""
