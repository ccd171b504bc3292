"""How often a 95 % interval holds the truth, over simulated recordings of random systems.

    python -m benchmarks.coverage [--recordings 2000] [--seed 0] [--only steps ...] [--json FILE]

Every recording has its own system, drawn at random; the truth is from theory, not from a metric.
Noise is a share of the step or amplitude: two levels of white noise, and one of noise whose
lag-one correlation is 0.7; every line has recordings and noise of its own. Holds that leak and
strokes with friction or play bring their own disturbance. The last lines are the
medians of a trial's repeats: 3, 5 and 10 values of a normal and of a skewed distribution.

Wanted: 93 to 97 %, or at least 93 % where an interval cannot be as narrow: nobody knows how much
of its resolution a sensor's noise dithers away, nor what a response did between two samples. The
count of recordings leaves a standard error (0.5 % of 2,000); a line whose coverage is within two of
them of a border says 'near', since another seed may decide otherwise. Refusals are counted: at most
a tenth more than before the intervals were mended. The last table holds the relative errors of our
figures, python-control's and SciPy's on clean models.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.clean_models import compared
from benchmarks.coverage_cases import CASES, Case
from benchmarks.truths import CHANNEL, Made, multisines, sines, steps
from benchmarks.wear_cases import WEAR
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.metrics.repeats import median_interval
from eha_bench.metrics.scoring import measure_safely, metric

WANTED = (0.93, 0.97)
HARD = 1000
"""Recordings a line of the hard cases at most."""

REFUSED = 0.10
"""Share of recordings that may go without a score where none did before."""


@dataclass(frozen=True)
class Line:
    """One line of the table."""

    metric: str
    noise: str
    recordings: int
    scored: int
    coverage: float
    below: float  # share of intervals that lie below the truth
    above: float
    width: float  # median width over the truth
    wanted: tuple[float, float] = WANTED
    may_refuse: float = REFUSED

    @property
    def refused(self) -> float:
        """Share of the recordings that were not scored."""
        return 1.0 - self.scored / self.recordings

    @property
    def error(self) -> float:
        """Standard error of the coverage, by the number of recordings."""
        inside = min(max(self.coverage, 0.01), 0.99)
        return math.sqrt(inside * (1.0 - inside) / max(self.scored, 1))

    @property
    def surely_not(self) -> bool:
        """Whether the true coverage lies outside of what is wanted, whatever the seed."""
        low, high = self.wanted
        if not self.scored or self.refused > self.may_refuse:
            return True
        return self.coverage < low - 2.0 * self.error or self.coverage > high + 2.0 * self.error

    @property
    def verdict(self) -> str:
        low, high = self.wanted
        if self.refused > self.may_refuse:
            return "no, refused"
        most = high - 2.0 * self.error if high < 1.0 else 1.0
        if low + 2.0 * self.error <= self.coverage <= most:
            return "yes"
        if self.surely_not:
            return "no"
        return "yes, near" if low <= self.coverage <= high else "no, near"


@dataclass(frozen=True)
class Noise:
    name: str
    level: float
    colour: float = 0.0

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        white = rng.normal(0.0, self.level, count + 100)
        if not self.colour:
            return white[100:]
        gain = math.sqrt(1.0 - self.colour**2)
        return np.asarray(lfilter([gain], [1.0, -self.colour], white))[100:]


def cover(
    make: Callable[[int, int], Iterator[Made]], noise: Noise, count: int, seed: int
) -> list[Line]:
    """Score `count` recordings and count in how many of them the interval holds the truth."""
    # every line its own luck: systems and noise are drawn again for each kind of noise
    own = zlib.crc32(f"{make.__name__} {noise.name}".encode())
    rng = np.random.default_rng([seed, own, 1])
    found: dict[str, list[tuple[float, float, float]]] = {}
    for recording, asked, truths, size in make(count, own + seed):
        data = recording[CHANNEL] + size * noise.draw(rng, len(recording))
        held((recording.with_values({CHANNEL: data}), asked, truths, size), tuple(truths), found)
    return [counted(name, noise.name, count, intervals) for name, intervals in found.items()]


def held(
    made: Made, names: tuple[str, ...], found: dict[str, list[tuple[float, float, float]]]
) -> None:
    """Add (low, truth, high) of every metric that has an interval of this recording."""
    recording, asked, truths, _ = made
    for name in names:
        scored = metric(name)
        measure = measure_safely(scored, recording, asked, scored.spec.channel_for(CHANNEL))
        intervals = found.setdefault(name, [])
        if math.isfinite(measure.low) and math.isfinite(measure.high):
            intervals.append((measure.low, truths[name], measure.high))


def cover_case(case: Case, count: int, seed: int) -> list[Line]:
    """The same for recordings that come with their own disturbance."""
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])
    found: dict[str, list[tuple[float, float, float]]] = {}
    for _ in range(count):
        held(case.draw(rng), case.metrics, found)
    return [
        counted(name, case.name, count, intervals, case.wanted, case.may_refuse)
        for name, intervals in found.items()
    ]


def counted(
    name: str,
    noise: str,
    count: int,
    intervals: list[tuple[float, float, float]],
    wanted: tuple[float, float] = WANTED,
    may_refuse: float = REFUSED,
) -> Line:
    """The line of (low, truth, high) of the recordings that were scored."""
    low, truth, high = np.array(intervals or [(math.nan,) * 3]).T
    return Line(
        metric=name,
        noise=noise,
        recordings=count,
        scored=len(intervals),
        coverage=float(np.mean((low <= truth) & (truth <= high))),
        below=float(np.mean(high < truth)),
        above=float(np.mean(low > truth)),
        width=float(np.median((high - low) / np.where(truth == 0.0, 1.0, np.abs(truth)))),
        wanted=wanted,
        may_refuse=may_refuse,
    )


def repeats(count: int, seed: int) -> Iterator[Line]:
    """Medians of few repeats; the truth is the median of the distribution they are drawn from."""
    rng = np.random.default_rng([seed, 2])
    for size in (3, 5, 10):
        for name, spread in (("normal", 0.0), ("skewed", 0.5)):
            found = []
            for _ in range(count):
                drawn = rng.normal(size=size)
                # lognormal with a shape of 0.5, or normal; the median is 1
                values = np.exp(spread * drawn) if spread else 1.0 + 0.1 * drawn
                low, high = median_interval(values)
                found.append((low, 1.0, high))
            yield counted(f"median of {size}", name, count, found)


WHITE = {"steps": (0.003, 0.02), "sines": (0.01, 0.1), "multisines": (0.01, 0.05)}
MAKERS: dict[str, Callable[[int, int], Iterator[Made]]] = {
    "steps": steps,
    "sines": sines,
    "multisines": multisines,
}


def table(count: int, seed: int, only: list[str]) -> Iterator[Line]:
    """Every line of the table."""
    for kind, make in MAKERS.items():
        if kind not in only:
            continue
        low, high = WHITE[kind]
        for noise in (
            Noise(f"white {100 * low:g} %", low),
            Noise(f"white {100 * high:g} %", high),
            Noise(f"correlated {100 * low:g} %", low, 0.7),
        ):
            yield from cover(make, noise, count, seed)
    if "hard" in only:
        for case in CASES:
            yield from cover_case(case, min(count, HARD), seed)
    if "wear" in only:
        for case in WEAR:
            yield from cover_case(case, min(count, HARD), seed)
    if "repeats" in only:
        yield from repeats(count, seed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    kinds = [*MAKERS, "hard", "wear", "repeats"]
    parser.add_argument("--only", nargs="+", choices=kinds, default=kinds)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    start = time.perf_counter()
    header = f"{'metric':20}{'noise':20}{'refused':>8}{'coverage':>15}{'below':>8}{'above':>8}"
    print(f"{header}{'width':>10}  wanted")
    lines = []
    for line in table(options.recordings, options.seed, options.only):
        lines.append(line)
        low, high = line.wanted
        wanted = f"{100 * low:.0f}-{100 * high:.0f} %" if high < 1.0 else f">= {100 * low:.0f} %"
        print(
            f"{line.metric:20}{line.noise:20}{100 * line.refused:7.1f}%"
            f"{100 * line.coverage:8.1f} +- {100 * line.error:.1f}"
            f"{100 * line.below:7.1f}%{100 * line.above:7.1f}%"
            f"{100 * line.width:9.2g}%  {wanted}: {line.verdict}",
            flush=True,
        )
    print("\nclean models: relative errors, each from the same samples")
    for row in compared():
        print(row)
    print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)
    if options.json:
        options.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n")
    return 1 if any(line.surely_not for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())
