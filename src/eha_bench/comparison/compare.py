"""Compares two sides metric by metric, and corrects for how many metrics there are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from eha_bench.comparison.caveats import caveats, check_targets, trial_problem
from eha_bench.comparison.comparison import Compared, Comparison, Values
from eha_bench.comparison.correction import holm
from eha_bench.comparison.dependence import coefficient_priors
from eha_bench.comparison.direction import Direction, direction_of
from eha_bench.comparison.evidence import (
    ALPHA,
    Evidence,
    dependence_of,
    evidence,
    exact,
    ratios_of,
)
from eha_bench.comparison.exactly import IDENTICAL, exactness_reason
from eha_bench.comparison.planning import more_repeats
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.scatters import ratio_priors
from eha_bench.comparison.sequential import any_time_p_value, sequential
from eha_bench.comparison.side import Side, SideRun
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import UnitError
from eha_bench.core.margin import parse_margin
from eha_bench.core.metric import Better, matters_by_default
from eha_bench.core.score import Score

Key = tuple[str, str, str]


@dataclass(frozen=True)
class _Pair:
    """One metric of one trial, one side scored at least: what the test needs.

    Attributes:
        item: what is compared, not judged yet.
        direction: which way is better.
        baseline, candidate: the values; those of whole pairs where repeats were run in pairs.
        counted: whether the values are counts.
        p_missing: of 'both sides fail to be scored equally often'; NaN where none failed.
        exactly: how the difference is known without any test; "" where it is not.
    """

    item: Compared
    direction: Direction
    baseline: Sample
    candidate: Sample
    counted: bool
    p_missing: float = math.nan
    exactly: str = ""


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
        InputError: the two ran on different targets, and that was not declared as intended.
    """
    if not across_targets:
        check_targets(baseline, candidate)
    items: list[Compared] = []
    pairs: dict[int, _Pair] = {}
    for trial in dict.fromkeys((*baseline.runs, *candidate.runs)):
        found = _trial(baseline, candidate, trial, looks)
        for entry in found:
            if isinstance(entry, _Pair):
                pairs[len(items)] = entry
                items.append(entry.item)
            else:
                items.append(entry)
    judged = _comparisons(list(pairs.values()), looks)
    for place, item in zip(pairs, judged, strict=True):
        items[place] = item
    return Comparison(
        baseline, candidate, tuple(items), caveats(baseline, candidate), ALPHA, bool(looks)
    )


def _trial(
    baseline: Side, candidate: Side, trial: str, looks: Sequence[float]
) -> list[Compared | _Pair]:
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
            problem = problem or f"no run of the {name} finished ({runs[0].trial.reason})"
    problem = problem or trial_problem(baseline, candidate, trial)
    if not keys:  # nothing was scored, but that must be reported
        return [Compared(trial, "", "", "", reason=problem or "nothing was scored")]
    # of runs in pairs, that they are identical is believed from the first look on
    looked = not looks or any(looks[: min(map(len, usable))])
    exactly = exactness_reason(*usable) if looked else ""
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
            entries.append(_metric(item, usable, looks, exactly))
    return entries


def _metric(
    item: Compared, usable: list[list[SideRun]], looks: Sequence[float], exactly: str
) -> Compared | _Pair:
    runs = _in_pairs(usable) if looks else usable
    scores = [[_score(run, item) for run in side] for side in runs]
    known = [score for side in scores for score in side if score is not None]
    limit = next((score.limit for score in known if score.limit), "")
    direction = direction_of(item.metric, item.unit, limit)
    item = replace(
        item,
        better=direction.words,
        baseline=_values(scores[0]),
        candidate=_values(scores[1]),
    )
    missing = _p_missing(scores, looks)
    counts = [len(side.values) for side in (item.baseline, item.candidate)]
    if not any(counts):
        why = (*item.baseline.reasons, *item.candidate.reasons, "no such score")[0]
        # of two equal results, what neither could score is not a difference either
        verdict = ComparisonVerdict.SAME if exactly else ComparisonVerdict.NOT_COMPARED
        return replace(item, verdict=verdict, reason=f"not scored on either side: {why}")
    samples = [_sample(side) for side in (_whole(scores) if looks else scores)]
    if math.isfinite(direction.aim):
        samples = [sample.distance_from(direction.aim) for sample in samples]
    values = np.array([*item.baseline.values, *item.candidate.values])
    counted = item.unit == "" and bool(np.all(values == np.round(values)) and values.max() > 0)
    margin, text = _margin(item, known)
    item = replace(item, margin=margin, margin_text=text)
    return _Pair(item, direction, samples[0], samples[1], counted, missing, exactly)


def _score(run: SideRun, item: Compared) -> Score | None:
    for score in run.trial.scores:
        if (score.metric, score.channel) == (item.metric, item.channel):
            return score
    return None


def _in_pairs(usable: list[list[SideRun]]) -> list[list[SideRun]]:
    """Return the runs of those repeats that both sides have, in the same order."""
    by_repeat = [{run.trial.repeat: run for run in runs} for runs in usable]
    common = sorted(by_repeat[0].keys() & by_repeat[1].keys())
    return [[side[repeat] for repeat in common] for side in by_repeat]


def _whole(scores: list[list[Score | None]]) -> list[list[Score | None]]:
    """Return the scores of those pairs of which both have a value."""
    pairs = [
        pair
        for pair in zip(*scores, strict=True)
        if all(score is not None and math.isfinite(score.value) for score in pair)
    ]
    return [[pair[side] for pair in pairs] for side in (0, 1)]


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


def _p_missing(scores: list[list[Score | None]], looks: Sequence[float]) -> float:
    """Return the p-value of 'both sides fail to be scored equally often'; NaN if none failed."""
    scored = [[s is not None and math.isfinite(s.value) for s in side] for side in scores]
    if all(all(side) for side in scored):
        return math.nan
    if not looks:
        return _fisher(scored)
    pairs = len(scored[0])
    p_values = [_fisher([side[:count] for side in scored]) for count in range(1, pairs + 1)]
    return any_time_p_value(p_values, looks)


def _fisher(scored: list[list[bool]]) -> float:
    """Return Fisher's exact p-value that the shares of scored runs are the same."""
    table = [[sum(side), len(side) - sum(side)] for side in scored]
    return float(stats.fisher_exact(np.array(table)).pvalue)


def _margin(item: Compared, known: Sequence[Score]) -> tuple[float, str]:
    """Return the smallest difference that matters, SI: the suite's, else the metric's; its words.

    It never depends on the scatter: what is noisy does not matter less.
    """
    reference = item.baseline.mean if item.baseline.values else item.candidate.mean
    for text in dict.fromkeys(score.matters for score in reversed(known) if score.matters):
        try:
            return parse_margin(text, item.unit).about(reference), text
        except UnitError:
            continue  # written for the metric on another channel
    text = matters_by_default(item.metric, item.unit)
    return parse_margin(text, item.unit).about(reference), f"by default: {text}"


def _comparisons(pairs: Sequence[_Pair], looks: Sequence[float]) -> list[Compared]:
    priors = {} if looks else _dependence(pairs)
    scatters = {} if looks else _scatters(pairs, priors)
    found = [
        _evidence(pair, len(pairs), looks, priors.get(place), scatters.get(place))
        for place, pair in enumerate(pairs)
    ]
    both = list(zip(pairs, found, strict=True))
    nothing = math.nan
    p_difference = holm(
        [
            _combined_p_value(one.p_difference if one else nothing, pair.p_missing)
            for pair, one in both
        ]
    )
    p_beyond = holm(
        [_combined_p_value(one.p_beyond if one else nothing, pair.p_missing) for pair, one in both]
    )
    p_same = holm([one.p_same if one is not None else nothing for one in found])
    judged = []
    for place, (pair, one) in enumerate(both):
        item = replace(
            pair.item,
            p_difference=p_difference[place],
            p_beyond=p_beyond[place],
            p_same=p_same[place],
        )
        judged.append(_verdict(replace(pair, item=item), one, len(pairs), paired=bool(looks)))
    return judged


def _dependence(pairs: Sequence[_Pair]) -> dict[int, FloatArray]:
    """Return, by place, the prior of the correlation of neighbouring repeats where it is seen."""
    seen = {
        place: likelihood
        for place, pair in enumerate(pairs)
        if not pair.exactly
        and (likelihood := dependence_of(pair.baseline, pair.candidate)) is not None
    }
    if not seen:
        return {}
    residuals = [
        np.concatenate([side.values - side.mean for side in (pair.baseline, pair.candidate)])
        for pair in (pairs[place] for place in seen)
    ]
    priors = coefficient_priors(np.array(list(seen.values())), residuals)
    return dict(zip(seen, priors, strict=True))


def _scatters(
    pairs: Sequence[_Pair], dependence: Mapping[int, FloatArray]
) -> dict[int, FloatArray]:
    """Return, by place, the prior of how differently the sides scatter, where it is learned."""
    seen = {
        place: likelihood
        for place, pair in enumerate(pairs)
        if not pair.exactly
        and (likelihood := ratios_of(pair.baseline, pair.candidate, dependence.get(place)))
        is not None
    }
    if not seen:
        return {}
    sides = [(pairs[place].baseline.values, pairs[place].candidate.values) for place in seen]
    priors = ratio_priors(np.array(list(seen.values())), sides)
    return dict(zip(seen, priors, strict=True))


def _evidence(
    pair: _Pair,
    family: int,
    looks: Sequence[float],
    dependence: FloatArray | None,
    scatters: FloatArray | None,
) -> Evidence | None:
    if not len(pair.baseline) or not len(pair.candidate):
        return None
    samples, margin = (pair.baseline, pair.candidate), pair.item.margin
    if pair.exactly:
        return exact(*samples, margin, pair.exactly)
    if looks:
        return sequential(*samples, margin, family=family, counted=pair.counted, looks=looks)
    return evidence(
        *samples,
        margin,
        family=family,
        counted=pair.counted,
        dependence=dependence,
        scatters=scatters,
    )


def _combined_p_value(p_values: float, p_missing: float) -> float:
    """Return the p-value of 'neither the values nor how often there are any differ'."""
    tested = [p for p in (p_values, p_missing) if not math.isnan(p)]
    return min(1.0, len(tested) * min(tested)) if tested else math.nan


def _verdict(pair: _Pair, found: Evidence | None, family: int, *, paired: bool) -> Compared:
    item = pair.item
    gone = _missing(item)
    lost = item.candidate.missing / item.candidate.runs - item.baseline.missing / item.baseline.runs
    by_missing = not math.isnan(pair.p_missing) and (
        found is None or not pair.p_missing > found.p_beyond
    )
    cut_off = "" if pair.exactly == IDENTICAL else _cut_off(pair)
    if found is not None:
        low, high = _open_interval(pair, found) if cut_off else (found.low, found.high)
        item = replace(
            item,
            difference=found.difference,
            low=low,
            high=high,
            method=found.method,
            reason="; ".join(part for part in (cut_off, found.note, gone) if part),
        )
    significant = item.p_beyond <= ALPHA
    if significant and by_missing and lost != 0.0:
        verdict = ComparisonVerdict.WORSE if lost > 0.0 else ComparisonVerdict.BETTER
        word = "not scored any more" if lost > 0.0 else "scored now"
        return replace(
            item,
            verdict=verdict,
            method="Fisher's exact test of how often scored",
            reason=f"{word} ({gone})",
        )
    if found is None:
        return replace(item, verdict=ComparisonVerdict.UNDECIDED, reason=gone)
    if cut_off and not (significant and _certain(item)):
        # more repeats would be cut off as well
        return replace(item, verdict=ComparisonVerdict.UNDECIDED)
    if significant:
        return replace(item, verdict=_worse_or_better(found.difference, pair.direction))
    if item.p_same <= ALPHA:
        return replace(item, verdict=ComparisonVerdict.SAME)
    differs = "there is a difference, but it may be smaller than what matters"
    if item.p_difference <= ALPHA:
        item = replace(item, reason="; ".join(part for part in (differs, item.reason) if part))
    more = more_repeats(
        found.difference, item.margin, found.scatter,
        min(len(pair.baseline), len(pair.candidate)),
        alpha=ALPHA / family, paired=paired,
    )  # fmt: skip
    return replace(item, verdict=ComparisonVerdict.UNDECIDED, more_repeats=more)


def _cut_off(pair: _Pair) -> str:
    """Return which side holds values that are only known to be at least (at most) so much."""
    sides = (("baseline", pair.baseline), ("candidate", pair.candidate))
    names = [name for name, side in sides if side.open_below or side.open_above]
    return f"cut off by the sensor's end in the {' and the '.join(names)}" if names else ""


def _open_interval(pair: _Pair, found: Evidence) -> tuple[float, float]:
    """Return the interval of a difference, open to where values may be farther than they say."""
    low = pair.candidate.open_below or pair.baseline.open_above
    high = pair.candidate.open_above or pair.baseline.open_below
    return -math.inf if low else found.low, math.inf if high else found.high


def _certain(item: Compared) -> bool:
    """Whether a difference stays one of its sign, whatever lies beyond an end that is open."""
    return (item.low if item.difference > 0.0 else item.high) not in (-math.inf, math.inf)


def _worse_or_better(difference: float, direction: Direction) -> ComparisonVerdict:
    if math.isfinite(direction.aim) or direction.better is Better.LOWER:
        return ComparisonVerdict.WORSE if difference > 0.0 else ComparisonVerdict.BETTER
    if direction.better is Better.HIGHER:
        return ComparisonVerdict.BETTER if difference > 0.0 else ComparisonVerdict.WORSE
    return ComparisonVerdict.CHANGED


def _missing(item: Compared) -> str:
    """Return how often each side was not scored, and why where nothing is left of it."""
    sides = (("baseline", item.baseline), ("candidate", item.candidate))
    parts = [f"{side.missing} of {side.runs} in the {name}" for name, side in sides if side.missing]
    reasons = dict.fromkeys(
        reason for _, side in sides if not side.values for reason in side.reasons
    )
    why = f" ({'; '.join(reasons)})" if reasons else ""
    return f"not scored: {', '.join(parts)}{why}" if parts else ""
