"""Evidence that may be looked at while repeats come in, and acted on at once.

At look k a metric is decided where its p-value is at most w_k * alpha, the shares w_k adding up
to 1. By the union bound the probability of ever deciding wrongly is at most alpha, whatever the
rule is by which one stops: min over k of p_k / w_k is a valid p-value, so Holm's correction over
metrics holds as well. (Group-sequential alpha spending, Lan and DeMets 1983,
doi:10.1093/biomet/70.3.659, in its simplest form: it does not use the correlation of the looks.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eha_bench.comparison.evidence import Evidence, evidence
from eha_bench.comparison.sample import Sample

FIRST_LOOK = 3
"""Pairs before the first look: fewer tell next to nothing of the scatter."""

_GROWTH = 1.25


def shares(repeats: int) -> tuple[float, ...]:
    """Return the share of the error rate at each look, one a pair, the later the larger.

    Element i belongs to the look at i + 1 pairs; 0 where there is no look.
    """
    first = min(FIRST_LOOK, repeats)
    weights = [0.0] * (first - 1) + [_GROWTH**i for i in range(repeats - first + 1)]
    total = sum(weights)
    return tuple(weight / total for weight in weights)


def sequential(
    baseline: Sample,
    candidate: Sample,
    margin: float,
    *,
    family: int,
    counted: bool,
    looks: Sequence[float],
) -> Evidence:
    """Return the evidence of all pairs, its p-values valid at any time one may have stopped.

    Args:
        baseline, candidate: equally many values, in pairs, in the order of their runs.
        margin: the difference from which on it matters, SI.
        family: how many metrics are looked at.
        counted: whether the values are counts.
        looks: shares of the error rate by number of pairs, from `shares`.
    """
    pairs = min(len(baseline), len(candidate))
    p_difference = p_beyond = p_same = 1.0
    found = None
    for count in range(1, pairs + 1):
        share = looks[min(count, len(looks)) - 1]
        if share <= 0.0 and count < pairs:
            continue
        found = evidence(
            _first(baseline, count),
            _first(candidate, count),
            margin,
            family=round(family / share) if share > 0.0 else family,
            paired=True,
            counted=counted,
        )
        if share > 0.0:
            p_difference = min(p_difference, found.p_difference / share)
            p_beyond = min(p_beyond, found.p_beyond / share)
            p_same = min(p_same, found.p_same / share)
    assert found is not None
    return replace(
        found,
        p_difference=p_difference,
        p_beyond=p_beyond,
        p_same=p_same,
        method=f"{found.method}, with repeated looks",
    )


def any_time_p_value(p_values: Sequence[float], looks: Sequence[float]) -> float:
    """Return a p-value that holds at any time one may have stopped.

    Args:
        p_values: after 1, 2, ... pairs.
        looks: shares of the error rate by number of pairs, from `shares`.
    """
    allowed = [looks[min(place, len(looks) - 1)] for place in range(len(p_values))]
    return min(
        (p / share for p, share in zip(p_values, allowed, strict=True) if share > 0.0), default=1.0
    )


def _first(sample: Sample, count: int) -> Sample:
    return Sample(sample.values[:count], sample.low[:count], sample.high[:count])
