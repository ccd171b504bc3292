"""How time and memory grow with a recording: read, write, info, recover at 1, 10 and 100 times.

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

from benchmarks.recordings import CHANNELS, ten_minutes, write_twelve

from eha_bench.recordings import info, read, recover, write

TIMES = (1, 10, 100)
LINEAR = 1.1
"""What is called linear: a busy machine bends a line by a few percent."""

Act = Callable[[], object]


@dataclass(frozen=True)
class Growth:
    """How one piece of work grows.

    Attributes:
        name: of the work.
        ticks: sizes.
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
    return [
        Growth(
            work,
            sizes,
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
    sizes = "  ".join(f"{size:>9,}" for size in found[0].ticks)
    print(f"{'':{width}}        {sizes}  exponent")
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
