"""How time and memory grow with the work: recordings, runs, scores, histories at 1, 10, 100 times.

    python -m benchmarks.growth [--ticks 6000] [--json FILE]

Time is the processor's, the best of several rounds; memory is the peak while it is done. The
exponent is that of the power law between the two largest sizes: 1 is linear, and below 1 is what
starting costs. Nothing may be worse than linear.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.recordings import CHANNELS, ten_minutes, write_twelve

import eha_bench as eb
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.plants.plant import Drive, get_plant
from eha_bench.recordings import info, read, recover, write
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target

TIMES = (1, 10, 100)
LINEAR = 1.1
"""What is called linear: a busy machine bends a line by a few percent."""

SUITE = """\
name: long
trials:
  - id: steps
    mode: pressure
    setup: {{piston: locked}}
    duration: {seconds} s
    signal: {{kind: steps, levels: [0 MPa, 5 MPa, 2 MPa, 8 MPa], hold: {hold} s}}
    scores: [rise_time, settling_time, overshoot, tracking_rms, tracking_max]
"""

Act = Callable[[], object]


@dataclass(frozen=True)
class Growth:
    """How one piece of work grows.

    Attributes:
        name: of the work.
        ticks: sizes; results for a history.
        seconds: of the processor at each size.
        megabytes: at their peak at each size.
        time_exponent, memory_exponent: between the two largest sizes.
    """

    name: str
    ticks: tuple[int, ...]
    seconds: tuple[float, ...]
    megabytes: tuple[float, ...]

    @property
    def time_exponent(self) -> float:
        return _exponent(self.ticks, self.seconds)

    @property
    def memory_exponent(self) -> float:
        return _exponent(self.ticks, self.megabytes)

    @property
    def linear(self) -> bool:
        """Whether neither grows faster than the recording."""
        return max(self.time_exponent, self.memory_exponent) <= LINEAR


def _exponent(sizes: tuple[int, ...], costs: tuple[float, ...]) -> float:
    return math.log(costs[-1] / costs[-2]) / math.log(sizes[-1] / sizes[-2])


def works(folder: Path, ticks: int) -> Iterator[tuple[str, Act]]:
    """Yield what is measured, made for a recording of so many ticks."""
    recording = ten_minutes(ticks)
    wide = write(folder / "wide.mcap", recording)
    twelve = folder / "twelve.mcap"
    write_twelve(twelve, recording.time, dict(recording.values))
    torn = folder / "torn.mcap"
    torn.write_bytes(wide.read_bytes()[:-5000])
    names = [f"c{k}" for k in range(CHANNELS)]
    equal = {name: {"topic": f"/rig/{name}", "field": "value", "unit": ""} for name in names}
    table = folder / "table.csv"
    recording.to_frame().to_csv(table)
    columns = {name: {"column": name, "unit": ""} for name in names}
    yield "write", lambda: write(folder / "out.mcap", recording)
    yield "read", lambda: read(wide)
    yield "read twelve topics", lambda: read(twelve, channels={"channels": equal})
    yield "read a torn file", lambda: read(torn)
    yield (
        "read CSV",
        lambda: read(table, channels={"time": {"column": "time"}, "channels": columns}),
    )
    yield "info", lambda: info(twelve)
    yield "recover", lambda: recover(torn, folder / "clean.mcap")


def jobs(folder: Path, times: int) -> Iterator[tuple[str, int, Act]]:
    """Yield what is done with suites and results, with its size, so many times the smallest."""
    ticks = 600 * times
    suite = folder / "long.yaml"
    suite.write_text(SUITE.format(seconds=ticks / 1000.0, hold=ticks / 20_000.0))
    trial = load_suite(suite).trials[0]
    recording = open_target("simulator").run(trial, 0).recording
    vectors = np.repeat(get_plant("eha_knee").layout.defaults()[None], times, axis=0)
    command = {"current_command": recording["current_command"][:600]}
    drive = Drive(recording.time[:600], command, locked=True)
    yield "run a suite, with its report", ticks, lambda: eb.run(suite, out=folder / "run")
    yield "score a recording", ticks, lambda: eb.score(recording, trial)
    yield "sweep, by sets", times, lambda: get_plant("eha_knee").sweep(vectors, drive, 25e-6)
    for night in range(3 * times):
        scores = tuple(
            Score(f"metric_{k}", "", Measure(1.0 + 0.01 * ((7 * night + k) % 11)), "s",
                  ScoreStatus.PASSED)
            for k in range(10)
        )  # fmt: skip
        year, day = divmod(night, 336)
        when = f"{2000 + year}-{1 + day // 28:02}-{1 + day % 28:02}T02:00:00+00:00"
        runs = (TrialResult("step", 0, Status.PASSED, "", "", scores),)
        place = folder / "nights" / f"{night:04}"
        place.mkdir(parents=True)
        Result("night", "rig", Status.PASSED, runs, {"started": when}).write(place / "result.json")
    yield (
        "history, by results",
        3 * times,
        lambda: eb.history(folder / "nights", folder / "site", rebuild=True),
    )


def cost(act: Act, rounds: int) -> tuple[float, float]:
    """Return seconds of the processor and the peak of memory in MB."""
    act()
    seconds = math.inf
    for _ in range(rounds):
        start = time.process_time()
        act()
        seconds = min(seconds, time.process_time() - start)
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return seconds, peak / 1e6


def run(ticks: int, rounds: int) -> list[Growth]:
    """Measure everything at every size."""
    sizes = tuple(ticks * times for times in TIMES)
    costs: dict[str, list[tuple[float, float]]] = {}
    for size in sizes:
        with tempfile.TemporaryDirectory() as name:
            for work, act in works(Path(name), size):
                costs.setdefault(work, []).append(cost(act, rounds))
    found_sizes: dict[str, list[int]] = {work: list(sizes) for work in costs}
    for times in TIMES:
        with tempfile.TemporaryDirectory() as name:
            for work, size, act in jobs(Path(name), times):
                costs.setdefault(work, []).append(cost(act, 1 if times > 1 else rounds))
                found_sizes.setdefault(work, []).append(size)
    return [
        Growth(
            work,
            tuple(found_sizes[work]),
            tuple(seconds for seconds, _ in found),
            tuple(megabytes for _, megabytes in found),
        )
        for work, found in costs.items()
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=6_000, help="ticks of the smallest recording")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, help="also write the table here")
    given = parser.parse_args()
    found = run(given.ticks, given.rounds)
    width = max(len(growth.name) for growth in found)
    print(f"{'':{width}}        {'1 x':>9}  {'10 x':>9}  {'100 x':>9}  exponent")
    for growth in found:
        times = "  ".join(f"{1e3 * seconds:9.1f}" for seconds in growth.seconds)
        sizes = "  ".join(f"{megabytes:9.2f}" for megabytes in growth.megabytes)
        print(f"{growth.name:{width}}  ms    {times}  {growth.time_exponent:8.2f}")
        print(f"{'':{width}}  MB    {sizes}  {growth.memory_exponent:8.2f}")
    worse = [growth.name for growth in found if not growth.linear]
    print(f"worse than linear: {', '.join(worse) or 'nothing'}")
    if given.json:
        content = [
            asdict(growth)
            | {"time_exponent": growth.time_exponent, "memory_exponent": growth.memory_exponent}
            for growth in found
        ]
        given.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
