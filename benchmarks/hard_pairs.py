"""Pairs of results that mislead a careless comparison, for `benchmarks.comparison`.

Unequal scatter and repeats, repeats that are alike, skewed noise, one run a side, a result against
itself, values that are lost, a difference that just does not matter; and what is found where there
is nothing special, so that refusing everything does not pass.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from benchmarks.line import Line, rate
from benchmarks.nights import alike

from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.sequential import FIRST_LOOK, shares
from eha_bench.comparison.side import Side
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.arrays import FloatArray
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus

ANY = "0 % of baseline"
SAID = (ComparisonVerdict.WORSE, ComparisonVerdict.BETTER, ComparisonVerdict.CHANGED)
FAMILY = 20


def side_of(values: FloatArray, matters: str = ANY) -> Side:
    """Return a side of values, (runs, metrics), NaN where not scored, in seconds about 100."""
    runs = tuple(
        TrialResult("drawn", i, Status.PASSED, "", "", tuple(
            Score(f"metric_{m}", "", Measure(100.0 + float(v), reason="lost"), "s",
                  ScoreStatus.PASSED, limit="<= 1 s", matters=matters)
            for m, v in enumerate(row)
        ))
        for i, row in enumerate(values)
    )  # fmt: skip
    return Side("drawn", ((Result("s", "rig", Status.PASSED, runs), Path()),))


def hard_pairs(pairs: int, seed: int = 0) -> Iterator[Line]:
    """Yield the lines; `pairs` comparisons each."""
    yield from _unequal(pairs, seed)
    yield from _dependent(pairs, seed)
    yield from _taking_turns(pairs, seed)
    yield from _plain(pairs, seed)
    yield from _at_the_margin(pairs, seed)
    yield from _found(max(1, pairs // 4), seed)


def _said(found: Comparison) -> bool:
    return bool(found.of(*SAID))


def _line(what: str, found: list[Comparison], most: float = 0.05) -> Line:
    verdicts = Counter(item.verdict for one in found for item in one.items)
    open_ones = verdicts[ComparisonVerdict.UNDECIDED] / max(1, verdicts.total())
    line = rate(what, [_said(one) for one in found], most=most)
    return Line(line.what, line.tried, line.share, line.wanted, line.kept,
                f"undecided {open_ones:.0%} of metrics")  # fmt: skip


def _unequal(pairs: int, seed: int) -> Iterator[Line]:
    cases = ((3, 10, 4.0, 1.0), (5, 10, 4.0, 1.0), (1, 5, 4.0, 1.0), (10, 3, 4.0, 1.0),
             (3, 3, 4.0, 1.0), (10, 10, 4.0, 1.0), (4, 12, 6.0, 1.0),
             (2, 30, 4.0, 1.0))  # fmt: skip
    for n, m, first, second in cases:
        for metrics in (1, FAMILY):
            rng = np.random.default_rng([n, seed])
            found = [
                compare_sides(
                    side_of(first * rng.normal(size=(n, metrics))),
                    side_of(second * rng.normal(size=(m, metrics))),
                )
                for _ in range(pairs if metrics == 1 else max(1, pairs // 2))
            ]
            what = f"no difference, {n} against {m}, scatter {first:g} : {second:g}, "
            yield _line(f"{what}{metrics} metric{'s' if metrics > 1 else ''}", found)
    for count in (3, 5):
        rng = np.random.default_rng([count, seed])
        found = []
        for _ in range(max(1, pairs // 2)):
            scatter = rng.choice([0.25, 4.0], FAMILY)
            values = rng.normal(size=(2, count, FAMILY))
            found.append(compare_sides(side_of(scatter * values[0]), side_of(values[1])))
        what = f"no difference, {count} against {count}, each metric 4 : 1 or 1 : 4"
        yield _line(f"{what}, {FAMILY} metrics", found)


def _dependent(pairs: int, seed: int) -> Iterator[Line]:
    for count in (10, 20):
        for correlation in (0.5, 0.8):
            for metrics in (1, FAMILY):
                rng = np.random.default_rng([count, seed])
                draw = alike(correlation)
                found = [
                    compare_sides(*(
                        side_of(np.array([draw(rng, count) for _ in range(metrics)]).T)
                        for _ in range(2)
                    ))
                    for _ in range(pairs if metrics == 1 else max(1, pairs // 4))
                ]  # fmt: skip
                what = f"no difference, correlated by {correlation:g}, {count} and {count}, "
                yield _line(f"{what}{metrics} metric{'s' if metrics > 1 else ''}", found)


def _taking_turns(pairs: int, seed: int) -> Iterator[Line]:
    looks, metrics = shares(10), 10
    for sigma in (0.5, 0.7):
        rng = np.random.default_rng([0, seed])
        false = []
        for _ in range(max(1, pairs // 4)):
            a, b = rng.lognormal(0.0, sigma, (2, 10, metrics)) - np.exp(sigma**2 / 2.0)
            hit = False
            for count in range(FIRST_LOOK, 11):
                sides = side_of(a[:count]), side_of(0.1 * b[:count])
                hit = hit or _said(compare_sides(*sides, looks=looks))
            false.append(hit)
        what = f"ab, no difference, log-normal ({sigma:g}) against a tenth of its scatter"
        yield rate(what, false, most=0.05)
    rng = np.random.default_rng([1, seed])
    hits = []
    for _ in range(max(1, pairs // 4)):
        a, b = rng.normal(size=(2, 20, 1))
        b[rng.permutation(20)[:11]] = np.nan
        (item,) = compare_sides(side_of(a), side_of(b), looks=shares(20)).items
        hits.append(
            item.verdict is ComparisonVerdict.WORSE and "not scored any more" in item.reason
        )
    yield rate("ab, 11 of B's 20 runs unscored: worse, not scored any more", hits, least=0.95)


def _plain(pairs: int, seed: int) -> Iterator[Line]:
    rng = np.random.default_rng([2, seed])
    same = []
    for place in range(pairs):
        runs = side_of(rng.normal(size=(1 + place % 10, 3)), ("", ANY)[place % 2])
        same.append(
            all(i.verdict is ComparisonVerdict.SAME for i in compare_sides(runs, runs).items)
        )
    yield rate("a result against itself: same", same, least=1.0)
    open_ones = []
    for _ in range(pairs):
        found = compare_sides(*(side_of(rng.normal(size=(1, 3)), "") for _ in range(2)))
        open_ones.append(
            all(
                i.verdict is ComparisonVerdict.UNDECIDED and "one run a side" in i.reason
                for i in found.items
            )
        )
    yield rate("one against one: undecided, one run a side", open_ones, least=1.0)


def _at_the_margin(pairs: int, seed: int) -> Iterator[Line]:
    """A true difference of exactly what matters must not be called worse."""
    for scatter in (0.5, 5.0):
        rng = np.random.default_rng([3, seed])
        found = []
        for _ in range(pairs):
            a, b = scatter * rng.normal(size=(2, 8, 1))
            found.append(compare_sides(side_of(a, "2 s"), side_of(b + 2.0, "2 s")))
        worse = [bool(one.of(ComparisonVerdict.WORSE)) for one in found]
        yield rate(
            f"worse by no more than what matters, scatter {scatter:g} of 2", worse, most=0.05
        )
        margins = {one.items[0].margin for one in found}
        yield rate(
            f"what matters is fixed, scatter {scatter:g} of 2", [margins == {2.0}], least=1.0
        )


_BEFORE = {(3, 1, 0.0): 0.06, (3, FAMILY, 0.0): 0.80}
"""Share that was undecided before, by repeats, metrics and per cent slower; none in other cases."""


def _found(pairs: int, seed: int) -> Iterator[Line]:
    """Normal noise of 0.5 %, 2 % matter by default: no more refusals than before, and 10 %."""
    cases = [(n, k, share) for n in (3, 5, 10) for k in (1, FAMILY) for share in (0.0, 5.0, 10.0)]
    for count, metrics, share in cases:
        before = _BEFORE.get((count, metrics, share), 0.0)
        rng = np.random.default_rng([4, seed])
        tried = pairs if metrics == 1 else max(1, pairs // 4)
        undecided = []
        for _ in range(tried):
            a, b = 0.5 * rng.normal(size=(2, count, metrics))
            found = compare_sides(side_of(a, ""), side_of(b + share, ""))
            undecided += [item.verdict is ComparisonVerdict.UNDECIDED for item in found.items]
        what = f"undecided, {share:g} % slower, {count} and {count}, {metrics} metric(s)"
        yield rate(what, undecided, most=before + 0.10)
