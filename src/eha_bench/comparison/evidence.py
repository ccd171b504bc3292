"""How far two samples differ, with an interval and what speaks for and against a difference.

Repeats are compared by what is believed of the difference of their means, whatever the ratio of
their scatters (`two_samples`, `scatters`) and, from enough repeats on, however alike neighbours are
(`dependence`). Where the numbers of repeats and metrics let a permutation test reach the level that
many metrics ask for, it has to agree: the larger p-value counts. Which tests are made depends on
the numbers of repeats and metrics alone, never on the values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eha_bench.comparison import permutation
from eha_bench.comparison.dependence import COEFFICIENTS, FEWEST
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.skewness import SEEN, wider_of_pairs, wider_of_samples
from eha_bench.comparison.student_mixture import StudentMixture
from eha_bench.comparison.two_samples import two_samples, widest_ratio
from eha_bench.core.arrays import FloatArray

ALPHA = 0.05
"""Family-wise error rate, and the complement of the intervals' confidence."""

ONE_RUN = "one run a side"
"""Why nothing is decided where neither side was repeated."""

_LAST_DIGIT = 1e-9
_NORMAL = 1.959963984540054
_ALIKE = 0.3  # correlation of neighbours from which on it is noted
_SURE = 0.75  # and how probable it has to be
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Evidence:
    """What two samples say; candidate minus baseline, SI.

    Attributes:
        difference: of the means.
        low, high: 95 % interval of the difference; NaN where nothing is known of the scatter.
        p_difference: two-sided p-value of 'there is no difference'; NaN if not testable.
        p_beyond: p-value of 'it differs by no more than the margin'.
        p_same: p-value of 'it differs by the margin or more' (two one-sided tests).
        scatter: standard deviation that one repeat (one pair of them) adds; NaN if unknown.
        method: how, in words.
        note: what else there is to say; "" for nothing.
    """

    difference: float
    low: float
    high: float
    p_difference: float
    p_beyond: float
    p_same: float
    scatter: float
    method: str
    note: str = ""


def dependence_of(baseline: Sample, candidate: Sample) -> FloatArray | None:
    """Return the likelihood of each correlation of neighbours, (c,); None where it cannot be seen.

    Args:
        baseline, candidate: in the order of their runs.
    """
    if not _shows_dependence(baseline, candidate):
        return None
    return two_samples(baseline.values, candidate.values, COEFFICIENTS).of_coefficients


def ratios_of(
    baseline: Sample, candidate: Sample, dependence: FloatArray | None
) -> FloatArray | None:
    """Return the likelihood of each ratio of scatters, (r,); None where it is not to be learned.

    Args:
        baseline, candidate: in the order of their runs.
        dependence: as for `evidence`.
    """
    if len(baseline) != len(candidate) or _constant(baseline) or _constant(candidate):
        return None
    prior = dependence if dependence is not None else np.ones(1)
    found = two_samples(baseline.values, candidate.values, COEFFICIENTS[: prior.size])
    return found.of_ratios(prior)


def _shows_dependence(baseline: Sample, candidate: Sample) -> bool:
    enough = len(baseline) + len(candidate) - 2 >= FEWEST
    return enough and not (_constant(baseline) and _constant(candidate))


def _constant(sample: Sample) -> bool:
    return len(sample) < 2 or float(np.ptp(sample.values)) == 0.0


def evidence(
    baseline: Sample,
    candidate: Sample,
    margin: float,
    *,
    family: int = 1,
    paired: bool = False,
    counted: bool = False,
    dependence: FloatArray | None = None,
    scatters: FloatArray | None = None,
) -> Evidence:
    """Compare two samples of at least one value each.

    Args:
        baseline, candidate: the values, in the order of their runs; of equal length if paired.
        margin: the difference from which on it matters, SI.
        family: how many metrics are looked at.
        paired: whether repeat i of both sides was run next to each other.
        counted: whether the values are counts, which scatter even where they happen to be equal.
        dependence: (c,) prior of the correlation of neighbouring repeats; independent if None.
        scatters: (r,) prior of the ratio of scatters; flat if None.
    """
    n, m = len(baseline), len(candidate)
    difference = candidate.mean - baseline.mean
    if n == m == 1:
        nothing = math.nan
        method = "one run on each side: the scatter of runs is not known"
        return Evidence(
            difference, nothing, nothing, nothing, nothing, nothing, nothing, method, ONE_RUN
        )
    scale = float(np.abs(np.concatenate((baseline.values, candidate.values))).max())
    floor = _LAST_DIGIT * scale
    if counted:
        floor = max(floor, math.sqrt(max(0.0, baseline.mean) / n + max(0.0, candidate.mean) / m))
    if paired and n == m:
        return _evidence_of_pairs(baseline.values, candidate.values, margin, family, floor)
    if _constant(baseline) and _constant(candidate):
        return _constants(baseline, candidate, margin, floor, counted=counted)
    return _evidence_of_repeats(baseline, candidate, margin, family, floor, dependence, scatters)


def exact(baseline: Sample, candidate: Sample, margin: float, method: str) -> Evidence:
    """Return the evidence of values without any scatter: the difference itself is known."""
    difference = candidate.mean - baseline.mean
    differs = difference != 0.0
    return Evidence(
        difference, difference, difference,
        float(not differs), float(not differs or abs(difference) < margin),
        float(differs and abs(difference) >= margin), 0.0, method,
    )  # fmt: skip


def _evidence_of_pairs(
    baseline: FloatArray, candidate: FloatArray, margin: float, family: int, floor: float
) -> Evidence:
    differences = candidate - baseline
    n = differences.size
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    error = max(wider_of_pairs(baseline, candidate) * spread / math.sqrt(n), floor)
    believed = StudentMixture.one(mean, max(error, _TINY), n - 1.0)
    tests, method = _tests_of(believed), "Student's t of the pairs"
    if spread > 0.0 and 2.0 * permutation.smallest_paired_p(n) <= ALPHA / family:
        method = "permutation and Student's t of the pairs"
        tests = tests.and_also(
            lambda bound: permutation.p_greater_paired(differences - bound),
            lambda bound: permutation.p_greater_paired(bound - differences),
        )
    return _evidence_of_tests(tests, believed, mean, margin, max(spread, error), method)


def _evidence_of_repeats(
    baseline: Sample,
    candidate: Sample,
    margin: float,
    family: int,
    floor: float,
    dependence: FloatArray | None,
    scatters: FloatArray | None,
) -> Evidence:
    n, m = len(baseline), len(candidate)
    first, second = baseline.values, candidate.values
    ordered = dependence is not None and _shows_dependence(baseline, candidate)
    prior = dependence if dependence is not None and ordered else np.ones(1)
    found = two_samples(first, second, COEFFICIENTS[: prior.size], floor=floor)
    method = f"one run against repeats, scatters within {widest_ratio(n, m):g} : 1"
    wider, note = 1.0, "one run on one side"
    if min(n, m) > 1:
        method, note = "Student's t, any ratio of scatters", ""
        shown = found.shown_ratio(prior, scatters=scatters, share=SEEN)
        wider = wider_of_samples(first, second, shown)
    believed = found.difference(prior, scatters=scatters, wider=wider)
    tests = _tests_of(believed)
    if min(n, m) > 1 and 2.0 * permutation.smallest_p(n, m) <= ALPHA / family:
        method = f"permutation and {method}"
        tests = tests.and_also(
            lambda bound: permutation.p_greater(first + bound, second),
            lambda bound: permutation.p_greater(second, first + bound),
        )
    if ordered:
        method += ", correlated or not"
        note = _likeness(found.chances(prior)) or note
    difference = candidate.mean - baseline.mean
    spreads = [sample.variance for sample in (baseline, candidate) if len(sample) > 1]
    scatter = wider * math.sqrt(sum(spreads) / len(spreads))
    return _evidence_of_tests(tests, believed, difference, margin, scatter, method, note)


def _constants(
    baseline: Sample, candidate: Sample, margin: float, floor: float, *, counted: bool
) -> Evidence:
    """Compare values that do not scatter on either side, of runs that otherwise do.

    Their own intervals say how they may scatter; where they have none, nothing but how often it
    happens by chance that all of one side are on one side of the other.
    """
    n, m = len(baseline), len(candidate)
    difference = candidate.mean - baseline.mean
    own = math.hypot(_own_error(baseline), _own_error(candidate))
    if counted or own > 0.0:
        error = max(own, floor, _TINY)
        believed = StudentMixture.one(difference, error, n + m - 2.0)
        method = "values without scatter, Student's t by their own intervals"
        return _evidence_of_tests(_tests_of(believed), believed, difference, margin, error, method)
    least = permutation.smallest_p(n, m)
    tests = _Tests(
        lambda bound: least if difference > bound else 1.0,
        lambda bound: least if difference < bound else 1.0,
    )
    believed = StudentMixture.one(difference, max(floor, _TINY), n + m - 2.0)
    method = "values without scatter, permutation"
    return _evidence_of_tests(tests, believed, difference, margin, math.nan, method)


def _own_error(sample: Sample) -> float:
    """Return the standard error of the mean by the values' own intervals; 0 where unknown."""
    halves = (sample.high - sample.low) / 2.0 / _NORMAL
    known = halves[np.isfinite(halves)]
    return float(np.sqrt(np.mean(known**2) / len(sample))) if known.size else 0.0


def _likeness(chances: FloatArray) -> str:
    """Return that neighbouring repeats are correlated, if it is more likely than not."""
    if float(chances[COEFFICIENTS >= _ALIKE].sum()) <= _SURE:
        return ""
    about = float(chances @ COEFFICIENTS)
    return (
        f"neighbouring repeats are correlated (correlation about {about:.1f}), "
        "so they hold less information than independent ones; `ab` alternates the targets instead"
    )


@dataclass(frozen=True)
class _Tests:
    """One-sided tests of a difference, as p-values by bound.

    Attributes:
        not_above: of 'the difference is not above the bound'.
        not_below: of 'it is not below the bound'.
    """

    not_above: Callable[[float], float]
    not_below: Callable[[float], float]

    def and_also(
        self, not_above: Callable[[float], float], not_below: Callable[[float], float]
    ) -> _Tests:
        """Return the tests that reject where these and the others do."""
        return _Tests(
            lambda bound: max(self.not_above(bound), not_above(bound)),
            lambda bound: max(self.not_below(bound), not_below(bound)),
        )


def _tests_of(believed: StudentMixture) -> _Tests:
    return _Tests(believed.below, believed.above)


def _evidence_of_tests(
    tests: _Tests,
    believed: StudentMixture,
    difference: float,
    margin: float,
    scatter: float,
    method: str,
    note: str = "",
) -> Evidence:
    return Evidence(
        difference,
        believed.quantile(ALPHA / 2.0),
        believed.quantile(1.0 - ALPHA / 2.0),
        min(1.0, 2.0 * min(tests.not_above(0.0), tests.not_below(0.0))),
        min(1.0, 2.0 * min(tests.not_above(margin), tests.not_below(-margin))),
        max(tests.not_above(-margin), tests.not_below(margin)),
        scatter,
        method,
        note,
    )
