"""Report of 100 signals of 100,000 samples: size, time to the first chart, heap; beside its peers.

    python -m benchmarks.report [--signals 100] [--samples 100000] [--json FILE] [--no-peers]

Needs Chromium. plotly is compared where it is installed (`pip install plotly`). A peer's page is
what a report would embed: plotly's own full-html file, matplotlib's SVG in an HTML file.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.signal import Edge, Signal
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.report import write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "report"))
from chromium import Browser, Page, find_chromium

SIZE_MB, FIRST_CHART_S, HEAP_MB = 3.5, 0.2, 15.0
ROUNDS = 5


@dataclass(frozen=True)
class Line:
    """One measured figure and its target (NaN: none)."""

    page: str
    figure: str
    value: float
    unit: str
    target: float = math.nan

    @property
    def verdict(self) -> str:
        if math.isnan(self.target):
            return ""
        return "met" if self.value <= self.target else "missed"


@dataclass(frozen=True)
class Steps(Signal):
    """A jump every ten seconds."""

    length: float

    @property
    def duration(self) -> float:
        return self.length

    def __call__(self, time: FloatArray) -> FloatArray:
        return 1e6 * (np.floor(np.asarray(time) / 10.0) % 2.0)

    @property
    def edges(self) -> tuple[Edge, ...]:
        times = np.arange(10.0, self.length, 10.0)
        return tuple(
            Edge(t, *self(np.array([t - 1.0, t + 1.0])).tolist(), min(t + 10.0, self.length))
            for t in times.tolist()
        )


def recording_of(signals: int, samples: int) -> Recording:
    """Steps, oscillations and noise of half a per cent, as a rig's log has them."""
    rng = np.random.default_rng(0)
    clock = np.arange(samples) / 1000.0
    reference = Steps(samples / 1000.0)(clock)
    values = {"reference": reference}
    values["pressure_difference"] = reference + 5e3 * rng.standard_normal(samples)
    for k in range(signals - 2):
        wave = np.sin(2 * math.pi * (0.02 + 0.05 * k) * clock + k)
        values[f"signal_{k:02d}"] = wave + 5e-3 * rng.standard_normal(samples)
    return Recording(clock, values, metadata={"signal_start": "0.0"})


def ours(recording: Recording, folder: Path) -> Path:
    duration = len(recording) / 1000.0
    trial = Trial("steps", Steps(duration), ControlMode.PRESSURE, Setup(), duration)
    score = Score("peak", "pressure_difference", Measure(1e6), "Pa", ScoreStatus.PASSED, "<= 2 MPa")
    run = TrialResult("steps", 0, Status.PASSED, "", "", (score,))
    result = Result("benchmark", "none", Status.PASSED, (run,))
    return write_report(folder, result, {("steps", 0): lambda: recording}, {"steps": trial})


def by_matplotlib(recording: Recording, folder: Path) -> Path:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 1.5 * len(recording.values)))
    FigureCanvasSVG(figure)
    for place, values in enumerate(recording.values.values()):
        figure.add_subplot(len(recording.values), 1, place + 1).plot(recording.time, values)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    path = folder / "matplotlib.html"
    path.write_text(f"<!DOCTYPE html><title>x</title>{buffer.getvalue()}", encoding="utf-8")
    return path


def by_plotly(recording: Recording, folder: Path) -> Path:
    from plotly import graph_objects
    from plotly.subplots import make_subplots

    rows = len(recording.values)
    figure = make_subplots(rows=rows, cols=1, vertical_spacing=0.2 / rows)
    for place, values in enumerate(recording.values.values()):
        small = values.astype(np.float32)
        line = graph_objects.Scattergl(x0=0.0, dx=1e-3, y=small, mode="lines")
        figure.add_trace(line, row=place + 1, col=1)
    figure.update_layout(height=140 * rows)
    path = folder / "plotly.html"
    figure.write_html(path, include_plotlyjs=True)
    return path


def first_chart(page: Page, path: Path, drawn: str) -> tuple[float, float]:
    """Return seconds from navigation until `drawn` (ms, or null) and the heap in MB."""
    page.open(path)
    page.wait(f"({drawn}) !== null")
    return float(page.run(drawn)) / 1e3, page.heap() / 1e6


def scrolled_heap(page: Page) -> float:
    """Return the largest heap in MB while the page is scrolled through."""
    height = int(page.run("document.documentElement.scrollHeight"))
    most = 0.0
    for top in range(0, height, 2500):
        page.run(f"scrollTo(0, {top})")
        page.run("new Promise(done => setTimeout(done, 150))")
        most = max(most, page.heap() / 1e6)
    return most


OURS = "performance.getEntriesByName('eha-first-chart')[0]?.startTime ?? null"
# The peers draw before the load event, or in a frame after it.
LOADED = "performance.timing.loadEventEnd ? performance.now() : null"
PLOTLY = "document.querySelector('.gl-canvas, .main-svg .xy') ? performance.now() : null"


def measured(
    browser: Browser, name: str, write: Callable[[Recording, Path], Path], recording: Recording,
    folder: Path, drawn: str, rounds: int,
) -> list[Line]:  # fmt: skip
    began = time.perf_counter()
    path = write(recording, folder)
    wrote = time.perf_counter() - began
    own = name == "eha-bench"
    page = browser.page()
    found = [first_chart(page, path, drawn) for _ in range(rounds)]
    lines = [
        Line(name, "size", path.stat().st_size / 1e6, "MB", SIZE_MB if own else math.nan),
        Line(name, "first chart, best", min(t for t, _ in found), "s",
             FIRST_CHART_S if own else math.nan),
        Line(name, "first chart, median", float(np.median([t for t, _ in found])), "s"),
        Line(name, "heap", max(heap for _, heap in found), "MB", HEAP_MB if own else math.nan),
        Line(name, "time to write", wrote, "s"),
    ]  # fmt: skip
    if own:
        lines.append(Line(name, "heap while scrolling", scrolled_heap(page), "MB", HEAP_MB))
        lines += [Line(name, f"complaint: {text[:80]}", 1, "", 0) for text in page.complaints]
    page.close()
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--signals", type=int, default=100)
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    executable = find_chromium()
    if executable is None:
        print("benchmarks.report needs chromium", file=sys.stderr)
        return 2
    recording = recording_of(arguments.signals, arguments.samples)
    lines: list[Line] = []

    def show(found: list[Line]) -> None:
        lines.extend(found)
        for line in found:
            target = "" if math.isnan(line.target) else f"<= {line.target:g} {line.unit}"
            print(
                f"{line.page:<12}{line.figure:<24}{line.value:>10.3f} {line.unit:<4}"
                f"{target:<12}{line.verdict}",
                flush=True,
            )

    with tempfile.TemporaryDirectory() as name, Browser(executable, timeout=400.0) as browser:
        folder = Path(name)
        show(measured(browser, "eha-bench", ours, recording, folder, OURS, ROUNDS))
        if not arguments.no_peers:
            show(measured(browser, "matplotlib", by_matplotlib, recording, folder, LOADED, 1))
            if find_spec("plotly") is None:
                print("plotly is not installed: not compared", file=sys.stderr)
            else:
                show(measured(browser, "plotly", by_plotly, recording, folder, PLOTLY, 1))
    if arguments.json:
        found = [{**asdict(line), "verdict": line.verdict} for line in lines]
        text = json.dumps(found, indent=1).replace("NaN", "null")
        arguments.json.write_text(text + "\n", encoding="utf-8")
    return int(any(line.verdict == "missed" for line in lines))


if __name__ == "__main__":
    sys.exit(main())
