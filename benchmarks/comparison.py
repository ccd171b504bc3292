"""How often comparisons and histories say something false, and how often they find what is there.

    python -m benchmarks.comparison [--pairs 500] [--histories 300] [--quick]
        [--only PART] [--json FILE]

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
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import eha_bench as eb
from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.sequential import FIRST_LOOK, shares
from eha_bench.comparison.side import Side
from eha_bench.comparison.verdict import Verdict
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.trends.trend import judge

FloatArray = NDArray[np.float64]

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
SAID = (Verdict.WORSE, Verdict.BETTER, Verdict.CHANGED)
METRICS = 20


@dataclass(frozen=True)
class Line:
    """One line of the table; `kept` is None where there is no target, only a figure."""

    what: str
    tried: int
    share: float
    wanted: str = ""
    kept: bool | None = None
    also: str = ""


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


NOISES: dict[str, Callable[[np.random.Generator, tuple[int, int]], FloatArray]] = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "Student's t, 3 degrees": lambda rng, shape: rng.standard_t(3, shape),
    "log-normal": lambda rng, shape: rng.lognormal(0.0, 0.7, shape),
    "whole numbers": lambda rng, shape: rng.poisson(2.0, shape).astype(np.float64),
}


def drawn(noise: str, repeats: int, pairs: int) -> Iterator[tuple[Side, Side]]:
    """Yield pairs of sides of metrics with a noise of 1 % about the same value."""
    rng = np.random.default_rng(repeats)
    scale = 0.0 if noise == "whole numbers" else 100.0
    for _ in range(pairs):
        both = []
        for _ in range(2):
            values = scale + NOISES[noise](rng, (repeats, METRICS))
            runs = [
                TrialResult(
                    "drawn",
                    i,
                    Status.PASSED,
                    "",
                    "",
                    tuple(
                        Score(
                            f"metric_{m}",
                            "",
                            Measure(float(v)),
                            "s" if scale else "",
                            ScoreStatus.PASSED,
                            limit="<= 1 s",
                        )
                        for m, v in enumerate(row)
                    ),
                )
                for i, row in enumerate(values)
            ]
            both.append(side(runs))
        yield both[0], both[1]


def said_something(found: Comparison) -> bool:
    return bool(found.of(*SAID))


def no_difference(whole: Result, pairs: int) -> Iterator[Line]:
    for repeats in (10, 5, 3, 1):
        hits = [said_something(compare_sides(a, b)) for a, b in draws(whole, repeats, pairs)]
        yield rate(f"no difference, simulator, {repeats} repeats", hits, most=0.05)
    for noise in NOISES:
        for repeats in (10, 5, 3):
            some = max(1, pairs // 2)
            hits = [said_something(compare_sides(a, b)) for a, b in drawn(noise, repeats, some)]
            yield rate(f"no difference, {noise}, {repeats} repeats", hits, most=0.05)


def slow_downs(whole: Result, pairs: int) -> Iterator[Line]:
    for repeats in (10, 5, 3):
        for share in (0.03, 0.05, 0.10):
            hits, false = [], []
            for a, b in draws(whole, repeats, pairs, 1.0 + share):
                found = compare_sides(a, b)
                worse = found.of(Verdict.WORSE)
                hits.append(any(item.metric == "response_time" for item in worse))
                false.append(any(item.unit != "s" for item in found.of(*SAID)))
            least = 0.95 if (repeats, share) == (10, 0.10) else None
            line = rate(f"response time {share:.0%} slower, {repeats} repeats", hits, least=least)
            yield replace(line, also=f"another metric falsely named in {np.mean(false):.1%}")


def with_margins(whole: Result) -> Result:
    """Return the pool with a difference that matters of 5 %, or of three times the scatter."""
    values: dict[tuple[str, str], list[float]] = {}
    for run in whole.trials:
        for score in run.scores:
            if np.isfinite(score.value):
                values.setdefault((run.id, score.metric), []).append(score.value)
    matters = {
        key: max(0.05 * abs(float(np.mean(found))), 3.0 * float(np.std(found)))
        for key, found in values.items()
    }
    return replace(
        whole,
        trials=tuple(
            replace(
                run,
                scores=tuple(
                    replace(score, matters=f"{matters.get((run.id, score.metric), 0.0):.9g}")
                    for score in run.scores
                ),
            )
            for run in whole.trials
        ),
    )


def interleaved(whole: Result, pairs: int) -> Iterator[Line]:
    looks = shares(10)
    whole = with_margins(whole)
    for share in (0.0, 0.10):
        hits, used = [], []
        for a, b in draws(whole, 10, pairs, 1.0 + share):
            for count in range(FIRST_LOOK, 11):
                found = compare_sides(first(a, count), first(b, count), looks=looks)
                if not found.of(Verdict.UNDECIDED):
                    break
            used.append(count)
            worse = any(i.metric == "response_time" for i in found.of(Verdict.WORSE))
            hits.append(worse if share else said_something(found))
        what = f"response time {share:.0%} slower" if share else "no difference"
        limits = {"least": 0.95} if share else {"most": 0.05}
        line = rate(f"ab, looked at after every pair, {what}", hits, **limits)
        yield replace(line, also=f"{np.mean(used):.1f} of 10 pairs used")


def first(whole: Side, count: int) -> Side:
    result = whole.results[0][0]
    runs = tuple(run for run in result.trials if run.repeat < count)
    return Side(whole.name, ((replace(result, trials=runs), Path()),))


def nights(noise: str, rng: np.random.Generator, count: int) -> FloatArray:
    if noise == "alike neighbours":
        made = lfilter([1.0], [1.0, -0.3], rng.normal(size=count + 50))[50:]
        return np.asarray(made / np.std(made), dtype=np.float64)
    values = NOISES[noise](rng, (1, count))[0]
    return (values - values.mean()) / values.std()


def flat_histories(histories: int) -> Iterator[Line]:
    """Histories of 20 metrics: any change or alarm in any of them is a false one."""
    for noise in (*NOISES, "alike neighbours"):
        for count in (60, 365):
            rng = np.random.default_rng(count)
            hits = []
            for _ in range(histories):
                false = False
                for _ in range(METRICS):
                    values = 100.0 + nights(noise, rng, count)
                    course, _, _, state = judge(values, family=METRICS, margin=0.5, scored=True)
                    false |= bool(course.changes) or state.drifted
                hits.append(false)
            yield rate(
                f"flat history of {METRICS} metrics, {noise}, {count} nights", hits, most=0.02
            )


def changed_histories(histories: int) -> Iterator[Line]:
    """Histories of one metric among 20, changed at a random night."""
    cases = [("step", size, 365) for size in (2.0, 3.0, 5.0)]
    cases += [("drift a night", size, 365) for size in (0.1, 0.2, 0.3, 0.5)]
    cases += [("step", 3.0, 60), ("drift a night", 0.3, 60)]
    for kind, size, count in cases:
        rng = np.random.default_rng(count)
        near, found_at_all, extra = [], [], []
        for _ in range(histories):
            values = 100.0 + nights("normal", rng, count)
            if kind == "step":
                start = int(rng.integers(15, count - 15))
                values[start:] += size
            else:
                start = int(rng.integers(15, count - 25))
                length = min(60, count - start)
                values[start:] += size * np.minimum(np.arange(1, count - start + 1), length)
            course, *_ = judge(values, family=METRICS, margin=0.5, scored=True)
            starts = [change.start for change in course.changes]
            near.append(any(abs(found - start) <= 2 for found in starts))
            found_at_all.append(bool(starts))
            extra.append(len(starts) > (2 if kind != "step" else 1))
        clear = size >= (3.0 if kind == "step" else 0.3)
        line = rate(
            f"{kind} of {size:g} sigma in {count} nights, within 2 nights", near,
            least=0.9 if clear else None,
        )  # fmt: skip
        also = f"found at all {np.mean(found_at_all):.1%}, more than there is {np.mean(extra):.1%}"
        yield replace(line, also=also)


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


def rate(
    what: str, hits: Sequence[bool], *, most: float | None = None, least: float | None = None
) -> Line:
    share = float(np.mean(hits))
    if most is not None:
        return Line(what, len(hits), share, f"<= {most:.0%}", share <= most)
    if least is not None:
        return Line(what, len(hits), share, f">= {least:.0%}", share >= least)
    return Line(what, len(hits), share)


def main() -> int:
    """Print every line as it is known; 1 if a target is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.comparison", description=__doc__)
    parser.add_argument("--pairs", type=int, default=500)
    parser.add_argument("--histories", type=int, default=300)
    parser.add_argument("--quick", action="store_true", help="a small version, for CI")
    parser.add_argument(
        "--only",
        action="append",
        metavar="PART",
        help="null, slower, ab, flat, changed or building",
    )
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    pairs, histories = (40, 20) if chosen.quick else (chosen.pairs, chosen.histories)
    whole = pool(24 if chosen.quick else 60)
    nights = (100, 20) if chosen.quick else (1000, 100)
    sections: dict[str, Callable[[], Iterator[Line]]] = {
        "null": lambda: no_difference(whole, pairs),
        "slower": lambda: slow_downs(whole, max(1, pairs // 2)),
        "ab": lambda: interleaved(whole, max(1, pairs // 8)),
        "flat": lambda: flat_histories(max(1, histories // 3)),
        "changed": lambda: changed_histories(histories),
        "building": lambda: building(*nights),
    }
    names = chosen.only or list(sections)
    lines = []
    print(f"{'':66} {'tried':>6} {'share':>7}  wanted")
    for name in names:
        for line in sections[name]():
            lines.append(line)
            mark = {True: "kept", False: "MISSED", None: ""}[line.kept]
            share = f"{line.share:7.2f}" if line.tried == 1 else f"{line.share:7.1%}"
            print(f"{line.what:66} {line.tried:6} {share}  {line.wanted:7} {mark:6} {line.also}",
                  flush=True)  # fmt: skip
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n")
    return int(any(line.kept is False for line in lines))


if __name__ == "__main__":
    sys.exit(main())
