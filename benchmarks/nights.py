"""Histories made up for `benchmarks.comparison`: flat ones, changed ones, and what can be known.

Thresholds were chosen on normal, Student's t and log-normal noise, with a look at Laplace, wild
nights and nights that are alike; rounded values led to the last correction. Uniform noise and
counts alone had no say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from benchmarks.line import Line, rate
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.core.workers import InProcess, Workers
from eha_bench.trends.specimens import kin_of
from eha_bench.trends.trend import Trend, TrendState, judge

Draw = Callable[[np.random.Generator, int], FloatArray]

_HERE = InProcess()
METRICS = 20
LONGEST = 60
"""Nights after which a drift that was put in ends, if the history does not end before."""


def alike(correlation: float) -> Draw:
    """Return noise whose neighbouring nights are correlated (first-order autoregression)."""
    return lambda rng, count: np.asarray(
        lfilter([1.0], [1.0, -correlation], rng.normal(size=count + 100))[100:], dtype=np.float64
    )


NOISES: dict[str, Draw] = {
    "normal": lambda rng, count: rng.normal(size=count),
    "Student's t, 3 degrees": lambda rng, count: rng.standard_t(3, count),
    "Student's t, 5 degrees": lambda rng, count: rng.standard_t(5, count),
    "Laplace": lambda rng, count: rng.laplace(size=count),
    "uniform": lambda rng, count: rng.uniform(-1.0, 1.0, count),
    "5 % wild nights": lambda rng, count: (
        rng.normal(size=count) * np.where(rng.random(count) < 0.05, 10.0, 1.0)
    ),
    "rounded": lambda rng, count: np.round(rng.normal(size=count)),
    "whole numbers": lambda rng, count: rng.poisson(2.0, count).astype(np.float64),
    "log-normal": lambda rng, count: rng.lognormal(0.0, 0.7, count),
    "neighbours correlated by 0.3": alike(0.3),
    "neighbours correlated by 0.6": alike(0.6),
}


def flat_histories(dashboards: int, workers: Workers = _HERE) -> Iterator[Line]:
    """Histories that nothing happened in, 20 of them watched together on a dashboard.

    A history is one metric over all its nights. It is false where it shows any change, or where its
    newest night is an alarm. A dashboard is false where any of its histories is.

    Args:
        dashboards: of normal noise in 60 nights; fewer of a year, and of each other noise.
        workers: where they are drawn and judged.
    """
    tasks = []
    for noise in NOISES:
        for count in (60, 365):
            tried = dashboards if (noise, count) == ("normal", 60) else dashboards // 5
            tried = max(1, dashboards // 3 if (noise, count) == ("normal", 365) else tried)
            tasks.append((noise, count, tried))
    for outcome in workers.ordered(_flat, tasks):
        yield outcome.get()


def _flat(task: tuple[str, int, int]) -> Line:
    noise, count, tried = task
    rng = np.random.default_rng(count)
    found: list[tuple[bool, bool]] = []
    for _ in range(tried * METRICS):
        values = 100.0 + NOISES[noise](rng, count)
        judged = judge(values, family=METRICS, margin=0.05)
        found.append((bool(judged.course.changes), judged.state.drifted))
    each = np.array(found).reshape(tried, METRICS, 2)
    false = each[..., 0] | each[..., 1]
    what = f"flat history, {noise}, {count} nights"
    line = rate(what, false.ravel().tolist(), most=0.02)
    return replace(
        line,
        also=f"by changes {each[..., 0].mean():.2%}, by the newest night alone "
        f"{(each[..., 1] & ~each[..., 0]).mean():.2%}; of {tried} dashboards of {METRICS} "
        f"{np.mean(false.any(axis=1)):.1%}",
    )


def weekends(rng: np.random.Generator, count: int) -> FloatArray:
    """Return normal noise whose Saturdays and Sundays lie 1 sigma higher (a warmer hall)."""
    return rng.normal(size=count) + np.isin(np.arange(count) % 7, (5, 6))


def doubled(rng: np.random.Generator, count: int) -> FloatArray:
    """Return normal noise whose variance doubles half-way."""
    return rng.normal(size=count) * np.where(np.arange(count) < count // 2, 1.0, np.sqrt(2.0))


SHORT: dict[str, Draw] = {
    "normal": NOISES["normal"],
    "neighbours correlated by 0.3": alike(0.3),
    "neighbours correlated by 0.5": alike(0.5),
    "neighbours correlated by 0.8": alike(0.8),
    "2 % outliers": lambda rng, count: (
        rng.normal(size=count) * np.where(rng.random(count) < 0.02, 8.0, 1.0)
    ),
    "weekends 1 sigma higher": weekends,
    "doubled variance": doubled,
}
_SIGMA = {"neighbours correlated by 0.3": 1.048, "neighbours correlated by 0.5": 1.155,
          "neighbours correlated by 0.8": 1.667}  # fmt: skip


def newest_nights(histories: int, workers: Workers = _HERE) -> Iterator[Line]:
    """Short histories as they are every morning: is a flat one left alone, is a step found.

    A flat history is false where its newest night is an alarm. A step of three standard deviations
    of a night is found where the first or the second night after it is an alarm, and marked where
    one of them is at least suspected or out of its limits. Own intervals are those of the nights'
    whole scatter, a third of it, or none.

    Args:
        histories: of each kind. workers: where they are drawn and judged.
    """
    flat = [
        (noise, count, own, family, 0.0, histories)
        for count in (8, 15, 30, 60)
        for noise in SHORT
        for own, family in ((np.nan, 1), (1.0, 1), (np.nan, METRICS))
    ]
    steps = [
        ("normal", count, own, family, 3.0, histories)
        for count in (8, 15, 30, 60)
        for own, family in ((np.nan, 1), (0.33, 1), (1.0, 1), (1.0, METRICS))
    ]
    for outcome in workers.ordered(_newest, [*flat, *steps]):
        yield from outcome.get()


_MARKS = (TrendState.SUSPECTED, TrendState.ONE_NIGHT_OUT)


def _newest(task: tuple[str, int, float, int, float, int]) -> tuple[Line, ...]:
    noise, count, own, family, size, histories = task
    rng = np.random.default_rng(count)
    hits, marks = [], []
    for _ in range(histories):
        values = 100.0 + SHORT[noise](rng, count + (2 if size else 0))
        values[count:] += size * _SIGMA.get(noise, 1.0)
        spread = own * _SIGMA.get(noise, 1.0)
        ends = (count + 1, count + 2) if size else (count,)
        states = [judge(values[:end], family=family, margin=0.05, own=spread).state for end in ends]
        hits.append(any(state.drifted for state in states))
        marks.append(hits[-1] or any(state in _MARKS for state in states))
    told = "no" if np.isnan(own) else "true" if own == 1.0 else f"{own:g} of the"
    about = f"{noise}, {count} nights, {told} own intervals, 1 metric of {family}"
    if not size:
        also = f"{np.mean(marks):.1%} at least marked"
        return (replace(rate(f"flat, {about}", hits, most=0.01), also=also),)
    least = 0.9 if family == 1 else None
    what = f"step of 3 sigma after {count} nights, {told} own intervals, of {family}"
    return rate(what, hits, least=least), rate(f"{what}: marked", marks, least=least)


def seasons(histories: int, workers: Workers = _HERE) -> Iterator[Line]:
    """A season of 90 nights is no drift; a drift beside it is one.

    Args:
        histories: of each kind. workers: where they are drawn and judged.
    """
    tasks = [
        (amplitude, count, drift, histories)
        for amplitude in (1.0, 2.0, 4.0)
        for count, drift in ((180, 0.0), (365, 0.0), (365, 0.1))
    ]
    for outcome in workers.ordered(_season, tasks):
        yield outcome.get()


def _season(task: tuple[float, int, float, int]) -> Line:
    amplitude, count, drift, histories = task
    rng = np.random.default_rng(count)
    hits = []
    for _ in range(histories):
        turn = 2.0 * np.pi * (np.arange(count) / 90.0 + rng.random())
        values = 100.0 + rng.normal(size=count) + amplitude * np.sin(turn)
        values[-60:] += drift * np.arange(1, 61)
        hits.append(judge(values, family=1, margin=0.05).state.drifted)
    what = f"season of 90 nights of {amplitude:g} sigma, {count} nights"
    if drift:
        return rate(f"{what}, a drift of {drift:g} sigma a night on it", hits, least=0.9)
    return rate(f"{what}, alarms", hits, most=0.05)


def lost_metrics(histories: int) -> Line:
    """A metric that dies for ten nights has drifted."""
    rng = np.random.default_rng(0)
    hits = [
        judge(rng.normal(100.0, 1.0, 20), family=1, margin=0.05, missing=(10, 0)).state.drifted
        for _ in range(histories)
    ]
    return rate("a metric not scored for ten nights: drifted", hits, least=1.0)


def units(kinds: int) -> Iterator[Line]:
    """Five units side by side, one metric: is an odd one called so, and none where there is none.

    Args:
        kinds: how often five units are drawn.
    """
    rng = np.random.default_rng(5)
    for noise in ("normal", "neighbours correlated by 0.5"):
        for wear, differ in ((0.0, 0.0), (0.0, 2.0), (6.0, 0.0)):
            hits = []
            for _ in range(kinds):
                trends = []
                for name in range(5):
                    values = 100.0 * rng.uniform(0.5, 2.0) + SHORT[noise](rng, 40)
                    own = differ * rng.normal() + (wear if name == 2 else 0.0)
                    values += own * np.arange(40) / 40.0
                    judged = judge(values, family=1, margin=0.05)
                    trends.append(Trend("s", f"rig {name}", "t", "m", "", "s", -1, np.nan, (),
                                        values, judged, 0.05, 0))  # fmt: skip
                (kin,) = kin_of(trends)
                odd = [one.trend.target for one in kin.specimens if one.odd]
                hits.append(odd == ["rig 2"] if wear else bool(odd))
            if wear:
                yield rate(f"one of five units wears by {wear:g} sigma, {noise}: named", hits)
            else:
                kind = "wearing differently" if differ else "of one kind"
                yield rate(f"five units {kind}, {noise}: any called odd", hits, most=0.02)


def changed_histories(histories: int, workers: Workers = _HERE) -> Iterator[Line]:
    """Histories of one metric among 20, changed at a random night.

    Args:
        histories: of each kind of change and noise. workers: where they are drawn and judged.
    """
    steps = [("step", size, count) for size, count in ((2.0, 365), (3.0, 365), (3.0, 60))]
    drifts = [("drift a night", size, 365) for size in (0.1, 0.15, 0.2, 0.3)]
    drifts += [("drift a night", 0.3, 60), ("drift a night", 0.5, 60)]
    tasks = [
        (noise, kind, size, count, histories)
        for noise in ("normal", "Student's t, 3 degrees", "Laplace", "neighbours correlated by 0.3")
        for kind, size, count in [*steps, *drifts]
    ]
    for outcome in workers.ordered(_changed, tasks):
        yield outcome.get()


def _changed(task: tuple[str, str, float, int, int]) -> Line:
    noise, kind, size, count, histories = task
    possible = best_possible(kind, size, count, 500) if noise == "normal" else 1.0
    rng = np.random.default_rng(count)
    near, held, nights, anything, extra = [], [], [], [], []
    for _ in range(histories):
        values = NOISES[noise](rng, count)
        start = int(rng.integers(15, count - (15 if kind == "step" else 25)))
        values = 100.0 + (values - values.mean()) / values.std() + shape(kind, size, start, count)
        course = judge(values, family=METRICS, margin=0.05).course
        nearest = min(course.changes, key=lambda c: abs(c.start - start), default=None)
        near.append(nearest is not None and abs(nearest.start - start) <= 2)
        anything.append(nearest is not None)
        extra.append(len(course.changes) > (1 if kind == "step" else 2))
        if nearest is not None:
            held.append(nearest.earliest <= start <= nearest.latest)
            nights.append(nearest.latest - nearest.earliest + 1)
    # a target only where anybody could reach it
    least = 0.9 if noise == "normal" and possible >= 0.95 else None
    what = f"{kind} of {size:g} sigma in {count} nights, {noise}, within 2 nights"
    most = f"; best possible {possible:.1%}" if noise == "normal" else ""
    interval = f"; interval {np.mean(nights):.1f} nights, right in {np.mean(held):.1%}"
    return replace(
        rate(what, near, least=least),
        also=f"found at all {np.mean(anything):.1%}, more than there is {np.mean(extra):.1%}"
        f"{interval if nights else ''}{most}",
    )


def shape(kind: str, size: float, start: int, count: int) -> FloatArray:
    """Return what a change adds to each night, shape (count,)."""
    night = np.arange(count) - start + 1
    if kind == "step":
        return size * (night > 0).astype(np.float64)
    return size * np.clip(night, 0, min(LONGEST, count - start)).astype(np.float64)


def best_possible(kind: str, size: float, count: int, histories: int) -> float:
    """Return how often a start is placed within 2 nights by whoever knows all but the numbers.

    The noise is normal with a known standard deviation, and there is one change of a known kind;
    unknown are level, size, start, and the end of a drift, all as likely beforehand. Named is the
    start with most probability within 2 nights of it: on average nobody can do better.
    """
    rng = np.random.default_rng(1)
    places = np.arange(5, count - 4)
    night = np.arange(count)
    if kind == "step":
        columns = (night >= places[:, None]).astype(np.float64)
        ends = np.zeros((1, count))
    else:
        columns = np.maximum(night - places[:, None] + 1.0, 0.0)
        ends = np.concatenate((columns, np.zeros((1, count))))
    columns -= columns.mean(axis=1, keepdims=True)
    ends -= ends.mean(axis=1, keepdims=True)
    squares = np.sum(columns**2, axis=1)[:, None] + np.sum(ends**2, axis=1) - 2.0 * columns @ ends.T
    last = len(ends) - 1
    apart = (np.arange(last + 1) >= np.arange(len(places))[:, None] + 5) | (
        np.arange(last + 1) == last
    )
    squares = np.where(apart, squares, np.inf)
    near = 0
    for _ in range(histories):
        start = int(rng.integers(15, count - (15 if kind == "step" else 25)))
        values = shape(kind, size, start, count) + rng.normal(size=count)
        onto = (columns @ values)[:, None] - ends @ values
        likely = onto**2 / squares / 2.0 - np.log(squares) / 2.0
        share = np.exp(likely - likely.max()).sum(axis=1)
        named = places[int(np.argmax(np.convolve(share, np.ones(5), "same")))]
        near += abs(int(named) - start) <= 2
    return near / histories
