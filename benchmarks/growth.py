"""How time and memory grow with the work: 1, 10 and 100 times the recording, run, or night.

    python -m benchmarks.growth [--ticks 6000] [--most 100] [--only diagnoses] [--json FILE]
    python -m benchmarks.growth --page docs/growth.md

Time is the processor's, the best of several rounds; memory is the peak of what Python and NumPy
hold while it is done. The exponent is that of the power law between the two largest sizes: 1 is
linear, and below 1 is what starting costs. Nothing may be worse than linear. `--page` puts the
table between the marks of a page, and a figure into the folder `images` beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.marked_page import write_between
from benchmarks.recordings import CHANNELS, ten_minutes, write_twelve
from fixtures.rig.case import Conditions, record_case
from fixtures.rig.plans import make_plans

import eha_bench as eb
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant
from eha_bench.recordings import info, read, recover, write
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target

RUNS = 10
"""Runs of a case of the independent rig."""
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
class Work:
    """Something that is done, with its size.

    Attributes:
        name: what is done.
        unit: what its size counts.
        size: how many.
        act: does it.
    """

    name: str
    unit: str
    size: int
    act: Act


@dataclass(frozen=True)
class Growth:
    """How one piece of work grows.

    Attributes:
        name: of the work.
        unit: what its sizes count.
        sizes: the work done.
        seconds: of the processor at each size.
        megabytes: at their peak at each size.
        time_exponent, memory_exponent: between the two largest sizes.
    """

    name: str
    unit: str
    sizes: tuple[int, ...]
    seconds: tuple[float, ...]
    megabytes: tuple[float, ...]

    @property
    def time_exponent(self) -> float:
        return _exponent(self.sizes, self.seconds)

    @property
    def memory_exponent(self) -> float:
        return _exponent(self.sizes, self.megabytes)

    @property
    def linear(self) -> bool:
        """Whether neither grows faster than the work."""
        return max(self.time_exponent, self.memory_exponent) <= LINEAR


def _exponent(sizes: tuple[int, ...], costs: tuple[float, ...]) -> float:
    found = [(size, cost) for size, cost in zip(sizes, costs, strict=True) if math.isfinite(cost)]
    if len(found) < 2:
        return math.nan
    (before, less), (after, more) = found[-2:]
    return math.log(more / less) / math.log(after / before)


def files(folder: Path, ticks: int) -> Iterator[Work]:
    """Yield what is done with a recording of twelve channels and so many ticks."""
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
    mapped = {"time": {"column": "time"}, "channels": columns}
    for name, act in (
        ("write", lambda: write(folder / "out.mcap", recording)),
        ("read", lambda: read(wide)),
        ("read twelve topics", lambda: read(twelve, channels={"channels": equal})),
        ("read a torn file", lambda: read(torn)),
        ("read CSV", lambda: read(table, channels=mapped)),
        ("info", lambda: info(twelve)),
        ("recover", lambda: recover(torn, folder / "clean.mcap")),
    ):
        yield Work(name, "ticks", ticks, act)


def trials(folder: Path, ticks: int) -> Iterator[Work]:
    """Yield what is done with a suite of one trial of so many ticks."""
    suite = folder / "long.yaml"
    suite.write_text(SUITE.format(seconds=ticks / 1000.0, hold=ticks / 20_000.0))
    trial = load_suite(suite).trials[0]
    recording = open_target("simulator").run(trial, 0).recording
    out = folder / "run"
    yield Work("run a suite, with its report", "ticks", ticks, lambda: eb.run(suite, out=out))
    yield Work("score a recording", "ticks", ticks, lambda: eb.score(recording, trial))


WRITTEN_OUT = """\
  - id: step-{number}
    duration: 1 s
    signal:
      kind: step
      final: {final:.3f} MPa
    accept:
      response_time: <= 41 ms
      overshoot: <= 20 %
"""
MATRIX = """\
  - id: step
    matrix: {{level: [{levels}], length: [{lengths}]}}
    duration: ${{length}}
    signal: {{kind: step, final: "${{level}}"}}
    accept: {{response_time: <= 41 ms, overshoot: <= 20 %}}
"""


def suites(folder: Path, count: int) -> Iterator[Work]:
    """Yield the loading of suites: so many trials written out, and twice as many by matrix."""
    head = "name: many\ndefaults: {mode: pressure, setup: {piston: locked}}\ntrials:\n"
    written = folder / "written.yaml"
    trials = (WRITTEN_OUT.format(number=k, final=5 + k / 1000) for k in range(count))
    written.write_text(head + "".join(trials))
    yield Work("load a suite", "trials", count, lambda: load_suite(written))
    folded = folder / "matrix.yaml"
    levels = ", ".join(f"{5 + k / 1000:.3f} MPa" for k in range(count // 5))
    lengths = ", ".join(f"{1 + k / 10:.1f} s" for k in range(10))
    folded.write_text(head + MATRIX.format(levels=levels, lengths=lengths))
    yield Work("load a suite, by matrix", "trials", 2 * count, lambda: load_suite(folded))


def sweeps(_: Path, sets: int) -> Iterator[Work]:
    """Yield a sweep of so many parameter sets over the same half second."""
    plant = get_plant("eha_knee")
    vectors = np.repeat(plant.layout.defaults()[None], sets, axis=0)
    clock = np.arange(501) / 1000.0
    drive = Drive(clock, {"current_command": 6.0 * np.sin(4 * np.pi * clock)}, locked=True)
    yield Work("sweep", "sets", sets, lambda: plant.sweep(vectors, drive, 25e-6))


OVER = {
    "gains": {
        "pressure.k_p": {"from": "5.5 A/MPa", "to": "6.7 A/MPa"},
        "pressure.k_2": {"from": "2.0 A*s/rad", "to": "2.4 A*s/rad"},
    },
    "parameters": {"bulk_modulus": {"from": "850 MPa", "to": "1050 MPa"}},
}


def suite_sweeps(folder: Path, points: int) -> Iterator[Work]:
    """Yield a sweep of the paper's suite over so many points, with its journal, table and page."""
    runs = points * len(load_suite("paper").trials)

    def act() -> object:
        over = {"over": OVER, "design": "sobol", "points": points}
        return eb.sweep("paper", over, "physical", out=tempfile.mkdtemp(dir=folder))

    yield Work("sweep the paper's suite", "runs", runs, act)


def nights(folder: Path, count: int) -> Iterator[Work]:
    """Yield the history of so many nights of ten metrics."""
    for night in range(count):
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
    site = folder / "site"
    act = partial(eb.history, folder / "nights", site, rebuild=True)
    yield Work("history", "nights", count, act)


def diagnoses(folder: Path, ticks: int) -> Iterator[Work]:
    """Yield the diagnosis of a case of the independent rig, its runs of so many ticks in all."""
    (plan,) = make_plans(7, 1, effects=["command_delay"], strengths=["strong"])
    record_case(plan, folder, Conditions(duration=ticks / 1000.0 / RUNS))
    case = folder / "cases" / plan.name / "dataset.yaml"
    yield Work("diagnose", "ticks", ticks, lambda: eb.diagnose(case, folder / "diagnosis"))


LONG = 120.0
"""Processor time, s, from which work is not done again for its memory: tracing takes six times."""


def cost(act: Act, rounds: int) -> tuple[float, float]:
    """Return seconds of the processor, the best of some rounds, and the peak of memory in MB.

    The memory is NaN where that would take too long.
    """
    seconds = math.inf
    for _ in range(rounds):
        start = time.process_time()
        act()
        seconds = min(seconds, time.process_time() - start)
    if seconds > LONG:
        return seconds, math.nan
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return seconds, peak / 1e6


def run(ticks: int, times: tuple[int, ...], rounds: int, only: list[str]) -> Iterator[Growth]:
    """Yield how the chosen groups of work grow, measured at each of so many times the smallest."""
    smallest = {
        "files": (files, ticks),
        "trials": (trials, ticks // 10),
        "suites": (suites, 50),
        "sweeps": (sweeps, 8),
        "suite_sweeps": (suite_sweeps, 12),
        "nights": (nights, 3),
        "diagnoses": (diagnoses, ticks),
    }
    for group in only:
        make, first = smallest[group]
        found: dict[str, list[tuple[Work, float, float]]] = {}
        for factor in times:
            with tempfile.TemporaryDirectory() as name:
                for work in make(Path(name), first * factor):
                    # the smallest is done first, which leaves nothing to compile or to load
                    spent = cost(work.act, rounds if factor == 1 or group == "files" else 1)
                    found.setdefault(work.name, []).append((work, *spent))
        for name, costs in found.items():
            done, seconds, megabytes = zip(*costs, strict=True)
            sizes = tuple(work.size for work in done)
            yield Growth(name, done[0].unit, sizes, seconds, megabytes)


GROUPS = ("files", "trials", "suites", "sweeps", "suite_sweeps", "nights", "diagnoses")


def table(growths: list[Growth]) -> str:
    """Return the table of a page."""
    lines = ["| | size | processor, ms | exponent | peak memory, MB | exponent |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for growth in growths:
        cells = (
            growth.name,
            _steps(growth.sizes) + f" {growth.unit}",
            _steps(1e3 * seconds for seconds in growth.seconds),
            f"{growth.time_exponent:.2f}",
            _steps(growth.megabytes),
            f"{growth.memory_exponent:.2f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _steps(values: Iterable[float]) -> str:
    return " → ".join(_three(value) for value in values)


def _three(value: float) -> str:
    """Return a number of three digits, large ones in groups."""
    if math.isnan(value):
        return "–"
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}".replace(",", " ") if rounded >= 100 else f"{rounded:g}"


COLOURS = 10
"""Colours of a plot before they come again; lines are dashed from there on."""


def draw(growths: list[Growth], path: Path) -> None:
    """Draw time and memory over the size of the work, each as a multiple of its smallest."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "growth", "font.size": 9}):
        figure = Figure((8.0, 4.0), layout="constrained")
        time_axes, memory_axes = figure.subplots(1, 2, sharex=True)
        for axes, what in ((time_axes, "seconds"), (memory_axes, "megabytes")):
            most = max(growth.sizes[-1] / growth.sizes[0] for growth in growths)
            axes.loglog([1, most], [1, most], color="#59636f", lw=6, alpha=0.25, label="linear")
            for number, growth in enumerate(growths):
                costs = np.array(getattr(growth, what))
                sizes = np.array(growth.sizes)
                style = "o-" if number < COLOURS else "o--"
                axes.loglog(sizes / sizes[0], costs / costs[0], style, ms=3, label=growth.name)
            axes.xaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.set_xlabel("work, times the smallest")
            axes.grid(color="#e3e7ec")
        time_axes.set_title("processor time, times that of the smallest", fontsize=9)
        memory_axes.set_title("peak memory, times that of the smallest", fontsize=9)
        figure.legend(*time_axes.get_legend_handles_labels(), loc="outside right upper",
                      frameon=False)  # fmt: skip
        figure.savefig(path, metadata={"Date": None})


MARKS = ("<!-- table by benchmarks.growth -->", "<!-- end of the table -->")


def write_page(growths: list[Growth], page: Path) -> None:
    """Put table and figure into a page, between its marks."""
    write_between(page, MARKS, table(growths))
    draw(growths, page.parent / "images" / "growth.svg")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--ticks", type=int, default=6_000, help="ticks of the smallest recording")
    parser.add_argument("--most", type=int, default=100, choices=(10, 100), help="times the work")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--add", type=Path, help="figures of an earlier --json, shown as well")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    parser.add_argument("--page", type=Path, help="put the table and a figure into this page")
    given = parser.parse_args()
    times = tuple(factor for factor in (1, 10, 100) if factor <= given.most)
    found = list(earlier(given.add)) if given.add else []
    print(f"{'':30}     {'  '.join(f'{factor:>7} x' for factor in times)}  exponent")
    for growth in run(given.ticks, times, given.rounds, given.only):
        found.append(growth)
        for unit, costs, exponent in (
            ("ms", [1e3 * seconds for seconds in growth.seconds], growth.time_exponent),
            ("MB", growth.megabytes, growth.memory_exponent),
        ):
            numbers = "  ".join(f"{cost:9.2f}" for cost in costs)
            print(f"{growth.name:30}  {unit} {numbers}  {exponent:8.2f}", flush=True)
    worse = [growth.name for growth in found if not growth.linear]
    print(f"worse than linear: {', '.join(worse) or 'nothing'}")
    if given.json:
        content = [
            asdict(growth)
            | {"time_exponent": growth.time_exponent, "memory_exponent": growth.memory_exponent}
            for growth in found
        ]
        given.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    if given.page:
        write_page(found, given.page)
    return 1 if worse else 0


def earlier(path: Path) -> Iterator[Growth]:
    """Yield what an earlier run found."""
    for entry in json.loads(path.read_text(encoding="utf-8")):
        yield Growth(
            entry["name"], entry["unit"],
            tuple(entry["sizes"]), tuple(entry["seconds"]), tuple(entry["megabytes"]),
        )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
