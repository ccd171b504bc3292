"""How often comparisons and histories say something false, and how often they find what is there.

    python -m benchmarks.comparison [--pairs 500] [--histories 300] [--seed 0] [--quick]
        [--only PART] [--workers N] [--json FILE]

The repeats come from the simulator with its sensor noise, run once and drawn from without
replacement: two draws never share a run. Further noises are drawn from distributions.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import chain
from pathlib import Path

import numpy as np
from benchmarks.hard_pairs import hard_pairs
from benchmarks.line import Line, rate
from benchmarks.nights import (
    METRICS,
    NOISES,
    changed_histories,
    flat_histories,
    lost_metrics,
    newest_nights,
    seasons,
    units,
)

import eha_bench as eb
from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.correction import holm
from eha_bench.comparison.evidence import ALPHA, evidence
from eha_bench.comparison.planning import more_repeats
from eha_bench.comparison.sample import Sample
from eha_bench.comparison.sequential import FIRST_LOOK, sequential, shares
from eha_bench.comparison.side import Side
from eha_bench.comparison.verdict import ComparisonVerdict
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.workers import workers_from

SUITE = """\
name: noise
defaults: {{sample_rate: 1 kHz, repeats: {repeats}}}
trials:
  - id: pressure_step
    mode: pressure
    setup: {{piston: locked}}
    duration: 0.5 s
    signal: {{kind: step, final: 15 MPa, at: 50 ms}}
  - id: pressure_sine
    mode: pressure
    setup: {{piston: locked}}
    settle: 0.2 s
    signal: {{kind: sine, amplitude: 4 MPa, offset: 10 MPa, frequency: 8 Hz, cycles: 4}}
"""
ANY = "0 % of baseline"
"""The smallest difference that matters where any does: only the tests stand against noise then."""

SAID = (ComparisonVerdict.WORSE, ComparisonVerdict.BETTER, ComparisonVerdict.CHANGED)


def pool(repeats: int) -> Result:
    """Run the suite once on the simulator."""
    with tempfile.TemporaryDirectory() as folder:
        suite = Path(folder) / "noise.yaml"
        suite.write_text(SUITE.format(repeats=repeats), encoding="utf-8")
        return eb.run(suite, "simulator", Path(folder) / "out")


def side(runs: Sequence[TrialResult], factor: float = 1.0) -> Side:
    """Return runs as a side, everything that is a time made longer by a factor."""
    counts: dict[str, int] = {}
    kept = []
    for run in runs:
        repeat = counts.get(run.id, 0)
        counts[run.id] = repeat + 1
        scores = tuple(slower(score, factor) for score in run.scores)
        kept.append(replace(run, repeat=repeat, scores=scores))
    result = Result("noise", "simulator", Status.PASSED, tuple(kept))
    return Side("drawn", ((result, Path()),))


def slower(score: Score, factor: float) -> Score:
    if score.unit != "s" or factor == 1.0:
        return score
    found = score.measure
    measure = Measure(found.value * factor, found.low * factor, found.high * factor, found.reason)
    return replace(score, measure=measure)


def draws(
    whole: Result, repeats: int, pairs: int, factor: float = 1.0
) -> Iterator[tuple[Side, Side]]:
    """Yield pairs of sides that share no run."""
    rng = np.random.default_rng(repeats)
    by_trial: dict[str, list[TrialResult]] = {}
    for run in whole.trials:
        by_trial.setdefault(run.id, []).append(run)
    for _ in range(pairs):
        a: list[TrialResult] = []
        b: list[TrialResult] = []
        for runs in by_trial.values():
            order = rng.permutation(len(runs))
            a += [runs[i] for i in order[:repeats]]
            b += [runs[i] for i in order[repeats : 2 * repeats]]
        yield side(a), side(b, factor)


def drawn(
    noise: str, repeats: tuple[int, int], pairs: int, *, lost: float = 0.0
) -> Iterator[tuple[Side, Side]]:
    """Yield pairs of sides of metrics with a noise of 1 % about the same value; any difference
    matters.

    Args:
        noise: of `NOISES`.
        repeats: of the baseline and of the candidate.
        pairs: how many.
        lost: share of the values that could not be scored.
    """
    rng = np.random.default_rng(repeats[0])
    counted = noise == "whole numbers"
    for _ in range(pairs):
        both = []
        for count in repeats:
            values = NOISES[noise](rng, count * METRICS).reshape(count, METRICS)
            values = (0.0 if counted else 100.0) + values
            values[rng.random(values.shape) < lost] = np.nan
            runs = [
                TrialResult("drawn", i, Status.PASSED, "", "", tuple(
                    Score(f"metric_{m}", "", Measure(float(v), reason="lost"),
                          "" if counted else "s", ScoreStatus.PASSED, limit="<= 1 s", matters=ANY)
                    for m, v in enumerate(row)
                ))
                for i, row in enumerate(values)
            ]  # fmt: skip
            both.append(side(runs))
        yield both[0], both[1]


def said_something(found: Comparison) -> bool:
    return bool(found.of(*SAID))


def no_difference(whole: Result, pairs: int) -> Iterator[Line]:
    strict = mattering(whole, lambda _: ANY)
    for repeats in (10, 5, 3, 1):
        for runs, matters in ((whole, "2 %"), (strict, "any difference")):
            hits = [said_something(compare_sides(a, b)) for a, b in draws(runs, repeats, pairs)]
            what = f"no difference, simulator, {repeats} repeats, {matters} matters"
            yield rate(what, hits, most=0.05)
    noises = ("normal", "Student's t, 3 degrees", "log-normal", "whole numbers", "rounded")
    cases = [(noise, (n, n), 0.0) for noise in noises for n in (10, 5, 3)]
    cases += [("normal", (5, 10), 0.0), ("log-normal", (4, 12), 0.0), ("normal", (10, 10), 0.2)]
    for noise, counts, lost in cases:
        tried = pairs if noise == "normal" else max(1, pairs // 2)
        sides = drawn(noise, counts, tried, lost=lost)
        hits = [said_something(compare_sides(a, b)) for a, b in sides]
        counted = " and ".join(f"{n}" for n in dict.fromkeys(counts))
        gone = f", {lost:.0%} of the values lost" if lost else ""
        yield rate(f"no difference, {noise}, {counted} repeats{gone}", hits, most=0.05)


def slow_downs(whole: Result, pairs: int) -> Iterator[Line]:
    for repeats in (10, 5, 3):
        for share in (0.03, 0.05, 0.10):
            hits, false = [], []
            for a, b in draws(whole, repeats, pairs, 1.0 + share):
                found = compare_sides(a, b)
                worse = found.of(ComparisonVerdict.WORSE)
                hits.append(any(item.metric == "response_time" for item in worse))
                false.append(any(item.unit != "s" for item in found.of(*SAID)))
            least = 0.95 if (repeats, share) == (10, 0.10) else None
            line = rate(f"response time {share:.0%} slower, {repeats} repeats", hits, least=least)
            yield replace(line, also=f"another metric falsely named in {np.mean(false):.1%}")


def wide(values: Sequence[float]) -> str:
    """Return a difference that matters of 5 %, or of three times the scatter."""
    return f"{max(0.05 * abs(float(np.mean(values))), 3.0 * float(np.std(values))):.9g}"


def mattering(whole: Result, matters: Callable[[Sequence[float]], str]) -> Result:
    """Return the pool with what matters said for every metric, by all its values."""
    values: dict[tuple[str, str], list[float]] = {}
    for run in whole.trials:
        for score in run.scores:
            if np.isfinite(score.value):
                values.setdefault((run.id, score.metric), []).append(score.value)
    said = {key: matters(found) for key, found in values.items()}
    trials = (
        replace(run, scores=tuple(
            replace(score, matters=said.get((run.id, score.metric), ANY)) for score in run.scores
        ))
        for run in whole.trials
    )  # fmt: skip
    return replace(whole, trials=tuple(trials))


def interleaved(whole: Result, pairs: int) -> Iterator[Line]:
    looks = shares(10)
    whole = mattering(whole, wide)
    for share in (0.0, 0.10):
        hits, used = [], []
        for a, b in draws(whole, 10, pairs, 1.0 + share):
            for count in range(FIRST_LOOK, 11):
                found = compare_sides(first(a, count), first(b, count), looks=looks)
                if not found.of(ComparisonVerdict.UNDECIDED):
                    break
            used.append(count)
            worse = any(i.metric == "response_time" for i in found.of(ComparisonVerdict.WORSE))
            hits.append(worse if share else said_something(found))
        what = f"response time {share:.0%} slower" if share else "no difference"
        limits = {"least": 0.95} if share else {"most": 0.05}
        line = rate(f"ab, looked at after every pair, {what}", hits, **limits)
        yield replace(line, also=f"{np.mean(used):.1f} of 10 pairs used")


def looked_at(sequences: int) -> Iterator[Line]:
    """Pairs without a difference, looked at after every one of them, 10 metrics at once."""
    looks, metrics = shares(10), 10
    for noise in ("normal", "Student's t, 3 degrees", "log-normal"):
        rng = np.random.default_rng(0)
        for sigmas in (0.0, 1.0, 2.0):
            false, found = [], []
            for _ in range(sequences):
                a, b = NOISES[noise](rng, 20 * metrics).reshape(2, metrics, 10)
                b[0] += sigmas * float(np.std(NOISES[noise](np.random.default_rng(1), 10_000)))
                # the least of all looks: what any of them would have said
                p_values = holm([
                    sequential(Sample.of(a[m]), Sample.of(b[m]), 0.0, family=metrics,
                               counted=False, looks=looks).p_difference
                    for m in range(metrics)
                ])  # fmt: skip
                found.append(p_values[0] <= ALPHA)
                false.append(min(p_values[1:] if sigmas else p_values) <= ALPHA)
            if not sigmas:
                yield rate(f"ab, 10 pairs looked at 8 times, {noise}", false, most=0.05)
            else:
                line = rate(f"ab, one of 10 metrics moved by {sigmas:g} sigma, {noise}", found)
                yield replace(line, also=f"another metric falsely named in {np.mean(false):.1%}")


def planned(sequences: int) -> Iterator[Line]:
    """As many repeats as are said to decide: how often they do (80 % is meant)."""
    rng = np.random.default_rng(0)
    for difference, margin in ((1.0, 0.5), (2.0, 0.5), (0.0, 1.0), (0.5, 1.0)):
        for metrics in (1, 20):
            alpha = ALPHA / metrics
            more = more_repeats(difference, margin, 1.0, 4, alpha=alpha)
            assert more is not None
            hits = []
            for _ in range(sequences):
                a, b = rng.normal(size=(2, 4 + more))
                found = evidence(Sample.of(a), Sample.of(b + difference), margin, family=metrics)
                hits.append(min(found.p_beyond, found.p_same) <= alpha)
            what = f"{difference:g} sigma, {margin:g} matter, {metrics} metrics"
            yield rate(f"decided after {more} more repeats than 4, {what}", hits)


def first(whole: Side, count: int) -> Side:
    result = whole.results[0][0]
    runs = tuple(run for run in result.trials if run.repeat < count)
    return Side(whole.name, ((replace(result, trials=runs), Path()),))


def building(count: int, metrics: int) -> Iterator[Line]:
    """Build the site of many nights from their files."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        for night in range(count):
            scores = tuple(
                Score(f"metric_{i % 10}", "", Measure(float(v)), "s", ScoreStatus.PASSED)
                for i, v in enumerate(rng.normal(1.0, 0.01, metrics))
            )
            runs = tuple(
                TrialResult(f"trial_{t}", 0, Status.PASSED, "", "", scores[10 * t : 10 * t + 10])
                for t in range(metrics // 10)
            )
            stamp = f"20{20 + night // 336:02d}-{night // 28 % 12 + 1:02d}-{night % 28 + 1:02d}"
            said = {"started": f"{stamp}T02:00:00+00:00", "revision": f"{night // 7:07x}"}
            path = Path(folder) / f"{night:04d}"
            path.mkdir()
            Result("night", "rig", Status.PASSED, runs, said).write(path / "result.json")
            (path / "report.html").write_text("", encoding="utf-8")
        begun, cpu = time.perf_counter(), time.process_time()
        eb.history(folder)
        wall, cpu = time.perf_counter() - begun, time.process_time() - cpu
    what = f"history of {count} nights x {metrics} metrics built, s"
    full = (count, metrics) == (1000, 100)
    kept = wall < 10.0 if full else None
    yield Line(what, 1, wall, "< 10" if full else "", kept, f"{cpu:.1f} s of CPU")


def main() -> int:
    """Print every line as it is known; 1 if a target is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.comparison", description=__doc__)
    parser.add_argument("--pairs", type=int, default=500)
    parser.add_argument("--histories", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the hard pairs")
    parser.add_argument("--quick", action="store_true", help="a small version, for CI")
    parser.add_argument(
        "--only",
        action="append",
        metavar="PART",
        help="null, hard, slower, ab, looks, planned, flat, newest, seasons, changed or building",
    )
    parser.add_argument(
        "--workers", default="", help="of histories: processes, dask://host:port, ray://host:port"
    )
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    workers = workers_from(chosen.workers)
    pairs, histories = (1, 1) if chosen.quick else (chosen.pairs, chosen.histories)
    whole = cache(lambda: pool(20 if chosen.quick else 60))
    nights = (30, 20) if chosen.quick else (1000, 100)
    sections: dict[str, Callable[[], Iterator[Line]]] = {
        "null": lambda: no_difference(whole(), pairs),
        "hard": lambda: hard_pairs(1 if chosen.quick else max(1000, pairs), chosen.seed),
        "slower": lambda: slow_downs(whole(), max(1, pairs // 2)),
        "ab": lambda: interleaved(whole(), max(1, pairs // 8)),
        "looks": lambda: looked_at(max(1, pairs * 4 // 5)),
        "planned": lambda: planned(max(1, pairs // 2)),
        "flat": lambda: flat_histories(histories, workers),
        "newest": lambda: newest_nights(1 if chosen.quick else 5 * histories, workers),
        "seasons": lambda: chain(seasons(histories, workers), [lost_metrics(histories)]),
        "units": lambda: units(histories),
        "changed": lambda: changed_histories(histories, workers),
        "building": lambda: building(*nights),
    }
    names = chosen.only or list(sections)
    lines = []
    print(f"{'':78} {'tried':>6} {'share':>7}  wanted")
    for name in names:
        for line in sections[name]():
            lines.append(line)
            mark = {True: "kept", False: "MISSED", None: ""}[line.kept]
            share = f"{line.share:7.2f}" if line.tried == 1 else f"{line.share:7.1%}"
            print(f"{line.what:78} {line.tried:6} {share}  {line.wanted:7} {mark:6} {line.also}",
                  flush=True)  # fmt: skip
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n")
    return int(any(line.kept is False for line in lines))


if __name__ == "__main__":
    sys.exit(main())
