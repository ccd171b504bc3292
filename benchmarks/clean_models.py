"""Clean models: figures of ours, of python-control and of SciPy, from the same samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from benchmarks.coverage_cases import CHANNEL, Linear, Shape, sweep
from benchmarks.truths import Step, recorded, second_order, trial
from scipy import signal as scipy_signal

import control
from eha_bench.core.score import Measure
from eha_bench.core.signal import Edge
from eha_bench.metrics.scoring import measure_safely, metric

RATES = (1000.0, 250.0)
SHAPES = {
    "second order, damping 0.3": (0.3, 70.0),
    "second order, damping 0.7": (0.7, 70.0),
}


def compared() -> Iterator[str]:
    """One line a metric, model and rate: relative errors, and whether our interval holds."""
    columns = "".join(f"{name:>12}" for name in ("ours", "interval", "control", "SciPy"))
    yield f"{'metric':16}{'model':28}{'rate':>7}{columns}"
    for name, (damping, natural) in SHAPES.items():
        for rate in RATES:
            yield from _steps(name, damping, natural, rate)
    yield from _bands()


def _steps(name: str, damping: float, natural: float, rate: float) -> Iterator[str]:
    shape = Shape(lambda t: second_order(natural * t, damping), 1.0 / (damping * natural))
    ticks = np.arange(-round(0.2 * rate), round(1.2 * rate)) / rate
    values = shape.response(np.maximum(ticks, 0.0))
    step = Step(Edge(0.0, 0.0, 1.0, 1.2))
    asked = replace(trial(step, 1.2, 0.2), sample_rate=rate)
    recording = recorded(ticks, values, step)
    after = ticks >= 0.0
    theirs = control.step_info(values[after], ticks[after], SettlingTimeThreshold=0.02)
    ideal = scipy_signal.lti([natural**2], [1.0, 2.0 * damping * natural, natural**2])
    grid, answer = scipy_signal.step(ideal, T=ticks[after])
    scipys = {
        "rise_time": _first(grid, answer, 0.9) - _first(grid, answer, 0.1),
        "settling_time": float(grid[np.flatnonzero(np.abs(answer - 1.0) > 0.02)[-1] + 1]),
        "overshoot": float(answer.max()) - 1.0,
        "peak_time": float(grid[int(np.argmax(answer))]),
    }
    controls = {
        "rise_time": theirs["RiseTime"],
        "settling_time": theirs["SettlingTime"],
        "overshoot": theirs["Overshoot"] / 100.0,
        "peak_time": theirs["PeakTime"],
    }
    for key, scipys_value in scipys.items():
        truth = shape.truths()[key]
        ours = measure_safely(metric(key), recording, asked, CHANNEL)
        yield _row(key, name, f"{rate:.0f} Hz", truth, ours, controls[key], scipys_value)


def _first(time: np.ndarray, values: np.ndarray, share: float) -> float:
    return float(time[int(np.argmax(values >= share))])


def _bands() -> Iterator[str]:
    system = Linear(8.0, 0.5)
    signal = sweep(30.0, 0.5, 40.0)
    ticks, values = system.answer(signal, 30.0)
    command = signal(ticks)
    recording, asked = recorded(ticks, values, signal), trial(signal, 30.0, 0.0)
    turn = 2.0 * math.pi * system.natural
    model = control.tf([turn**2], [1.0, 2.0 * system.damping * turn, turn**2])
    frequency, cross = scipy_signal.csd(command, values, 1000.0, nperseg=4096)
    _, power = scipy_signal.welch(command, 1000.0, nperseg=4096)
    gain = np.abs(cross / power)
    low = gain[2]
    below = int(np.flatnonzero((gain < low * math.sqrt(0.5)) & (frequency > 1.0))[0])
    around = slice(below - 1, below + 1)
    welch = float(np.interp(-low * math.sqrt(0.5), -gain[around], frequency[around]))
    ours = measure_safely(metric("bandwidth_3db"), recording, asked, CHANNEL)
    theirs = control.bandwidth(model) / (2.0 * math.pi)
    truth = system.truths()["bandwidth_3db"]
    yield _row("bandwidth_3db", "second order, chirp 30 s", "1000 Hz", truth, ours, theirs, welch)


def _row(
    key: str, name: str, rate: str, truth: float, ours: Measure, controls: float, scipys: float
) -> str:
    holds = "holds" if ours.low <= truth <= ours.high else "misses"
    cells = "".join(f"{part / truth - 1.0:12.1e}" for part in (controls, scipys))
    return f"{key:16}{name:28}{rate:>7}{ours.value / truth - 1.0:12.1e}{holds:>12}{cells}"
