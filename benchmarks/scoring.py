"""Scoring a long recording against reading it by rosbags, side by side.

    python -m benchmarks.scoring [--seconds 600] [--json FILE]

The recording has twelve channels at 1 kHz, one wide message a tick, which is the least work that it
can be for rosbags. It is scored under every kind of signal by all metrics that are installed, asked
for by name, so that none is left out; a line says how many of them found a value. Wanted: less
than half of the time that rosbags takes to read and deserialize the same file. Both are times of
the processor, the best of three, so that what else runs on the machine does not decide.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from benchmarks.recordings import by_rosbags

from eha_bench.core.recording import Recording
from eha_bench.core.score import Score
from eha_bench.core.trial import Trial
from eha_bench.metrics import all_metrics, score
from eha_bench.recordings import write
from eha_bench.suites import load_suite

T = TypeVar("T")

WANTED = 0.5
"""Share of the time of reading."""

SUITE = """\
name: long
defaults: {{sample_rate: 1 kHz, mode: pressure, setup: {{piston: locked}}}}
trials:
  - id: steps
    signal: {{kind: steps, levels: {levels}, hold: {hold} s, at: 1 s}}
  - id: sine
    signal: {{kind: sine, amplitude: 5 MPa, offset: 10 MPa, frequency: 2 Hz, cycles: {cycles}}}
  - id: stepped_sine
    signal:
      kind: stepped_sine
      amplitude: 5 MPa
      offset: 10 MPa
      frequencies: {{first: 1 Hz, last: 30 Hz, count: 20}}
      cycles: 8
      dwell: {dwell} s
  - id: chirp
    signal:
      kind: chirp
      amplitude: 5 MPa
      offset: 10 MPa
      f_start: 0.5 Hz
      f_stop: 60 Hz
      duration: {seconds} s
  - id: multisine
    signal:
      kind: multisine
      amplitude: 5 MPa
      offset: 10 MPa
      period: 2 s
      f_min: 0.5 Hz
      f_max: 60 Hz
      harmonics: odd
      periods: 6
      realisations: {realisations}
  - id: locked_staircase
    mode: current
    setup: {{piston: locked, bypass: closed}}
    signal: {{kind: steps, levels: {currents}, hold: {hold} s, at: 1 s}}
  - id: bypass_staircase
    mode: current
    setup: {{piston: locked, bypass: open}}
    signal: {{kind: steps, levels: {currents}, hold: {hold} s, at: 1 s}}
"""
CONSTANTS = {
    "torque_constant": 0.3, "pump_displacement": 1.0982e-7, "rotor_inertia": 1e-3,
    "volume_a": 1.2535e-5, "bulk_modulus": 9e8, "piston_area_a": 3.1337e-4,
    "piston_area_b": 3.1337e-4, "link_a": 0.2, "link_b": 0.2, "link_c0": 0.2,
}  # fmt: skip


@dataclass(frozen=True)
class Line:
    """One kind of signal: seconds to score it, and the share of what rosbags takes to read it."""

    trial: str
    seconds: float
    of_reading: float
    found: int
    metrics: int


def trials(seconds: float, folder: Path) -> tuple[Trial, ...]:
    """One trial of every kind, each as long as the recording."""
    count = 60
    hold = (seconds - 1.0) / count
    text = SUITE.format(
        levels=[f"{5 + 10 * (k % 2)} MPa" for k in range(count)],
        currents=[f"{4 + 2 * (k % 6)} A" for k in range(count)],
        hold=f"{hold:.6f}",
        cycles=int(2 * seconds),
        dwell=max(seconds / 20 - 3.0, 2.0),
        seconds=seconds,
        realisations=max(int(seconds / 12), 1),
    )
    path = folder / "long.yaml"
    path.write_text(text)
    everything = tuple((name, "") for name in all_metrics())
    return tuple(replace(trial, scores=everything) for trial in load_suite(path).trials)


def recorded(trial: Trial, seconds: float) -> Recording:
    """What a second-order loop with noise would answer, in twelve channels."""
    rng = np.random.default_rng(0)
    clock = np.arange(round(1000 * seconds)) / 1000.0
    reference = trial.signal(clock)
    lag = np.exp(-np.arange(200) / 30.0)
    answer = np.convolve(reference - reference[0], lag / lag.sum())[: clock.size] + reference[0]
    unit = max(float(np.ptp(reference)), 1e-9)

    def noisy(values: np.ndarray, share: float = 0.003) -> np.ndarray:
        return values + share * max(float(np.ptp(values)), 1e-9) * rng.normal(size=clock.size)

    values = {
        "reference": reference,
        "pressure_difference": noisy(answer),
        "pressure_a": noisy(answer + 0.6 * unit),
        "pressure_b": noisy(0.6 * unit + 0.0 * answer),
        "current_command": reference if "current" in trial.channel else answer / 1.5e6,
        "current": noisy(answer if "current" in trial.channel else answer / 1.5e6),
        "motor_speed": noisy(np.gradient(answer) / unit * 1e3),
        "piston_position": noisy(0.0 * clock + 1e-3 * np.sin(clock)),
        "piston_velocity": noisy(1e-3 * np.cos(clock)),
        "joint_angle": noisy(1.4 + 0.01 * np.sin(clock)),
        "force": noisy(answer * 3.1e-4),
        "oil_temperature": 300.0 + 0.01 * clock,
    }
    metadata = {"signal_start": "0.0"} | {f"model.{k}": repr(v) for k, v in CONSTANTS.items()}
    return Recording(clock, values, metadata=metadata, epoch_ns=1_760_000_000_000_000_000)


def timed(work: Callable[[], T], rounds: int) -> tuple[float, T]:
    """Return the least time of the processor in s that some work takes, and what it gives."""
    best = math.inf
    for _ in range(rounds):
        start = time.process_time()
        found = work()
        best = min(best, time.process_time() - start)
    return best, found


def run(seconds: float, rounds: int) -> list[Line]:
    """Every line of the table; what takes the least time of some rounds counts."""
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        every = trials(seconds, folder)
        path = folder / "long.mcap"
        write(path, recorded(every[0], seconds))
        reading, messages = timed(partial(by_rosbags, path), rounds)
        print(f"rosbags reads {messages} messages of 12 channels in {reading:.2f} s")
        for trial in every:
            best, scores = timed(partial(scored, recorded(trial, seconds), trial), rounds)
            found = sum(math.isfinite(item.value) for item in scores)
            lines.append(Line(trial.id, best, best / reading, found, len(trial.scores)))
    return lines


def scored(recording: Recording, trial: Trial) -> tuple[Score, ...]:
    """Score a recording of which nothing is remembered."""
    return score(replace(recording), trial)


def main() -> int:
    """Print the table; return 1 if a line takes longer than it may."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rounds", type=int, default=3, help="the fastest counts")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lines = run(options.seconds, options.rounds)
    print(f"{'scored as':18}{'time':>10}{'of reading':>12}  values   < 50 %")
    for line in lines:
        verdict = "met" if line.of_reading < WANTED else "missed"
        print(
            f"{line.trial:18}{line.seconds:9.2f}s{100 * line.of_reading:11.1f}%"
            f"  {line.found:2} of {line.metrics}  {verdict}"
        )
    if options.json:
        options.json.write_text(json.dumps([asdict(line) for line in lines], indent=1) + "\n")
    return 0 if all(line.of_reading < WANTED for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
