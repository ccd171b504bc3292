"""``python -m benchmarks.intervals``: how often 95 % intervals of parameters hold the truth.

Our own model of the knee's actuator is run with known parameters and a locked piston, its outputs
get noise of a known kind, and its parameters are fitted from 1 % off, as at the end of calibrations
and diagnoses. Noise is white, has a memory of 30 ms besides (a disturbance through a filter), or
every run was made with parameters of its own (the oil was warmer): then the interval is to hold the
mean of all such runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from benchmarks.line import rate
from benchmarks.table import Row, write_rows
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.evidence import groups_of
from eha_bench.diagnosis.fit.finish import converged_fit
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.uncertainty import estimates
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

Noise = Callable[[np.random.Generator, int], FloatArray]

TRUTH = {
    "coulomb_torque": 0.16,
    "viscous_torque": 0.005,
    "leakage": 1e-13,
    "bulk_modulus": 9e8,
    "rotor_inertia": 1e-3,
}
VALVES = DeclaredEffect("anti_cavitation", {})
RUNS, SECONDS, PERIOD, STEP = 6, 2.0, 1e-3, 1e-4
NOISE = {"motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}
"""Standard deviation of what is logged, rad/s and Pa."""
LEAST, MOST = 0.93, 0.97


def white(rng: np.random.Generator, count: int) -> FloatArray:
    """Return noise of standard deviation 1, (count, channels)."""
    return rng.standard_normal((count, len(NOISE)))


def with_memory(rng: np.random.Generator, count: int) -> FloatArray:
    """Return white noise and as much again with a memory of 30 ms, (count, channels)."""
    memory = float(np.exp(-PERIOD / 0.03))
    slow = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white(rng, count + 500), axis=0)
    return np.asarray(white(rng, count) + slow[500:])


KINDS: dict[str, tuple[Noise, float]] = {
    "white noise": (white, 0.0),
    "noise with a memory of 30 ms": (with_memory, 0.0),
    "runs with parameters of their own": (white, 0.002),
}
"""Name -> noise, and how far a run's own parameters are off, one standard deviation."""


def recorded(rng: np.random.Generator, noise: Noise, own: float) -> list[Measured]:
    """Return the runs of one actuator: steps of the current with a sine on top."""
    time = np.arange(0.0, SECONDS, PERIOD)
    runs = []
    for number in range(RUNS):
        values = {key: value * (1.0 + own * rng.standard_normal()) for key, value in TRUTH.items()}
        truth = Model("eha_knee", values, (), (VALVES,))
        levels = np.concatenate([[0.0], rng.uniform(2.0, 18.0, 7)])
        command = levels[np.minimum((time / 0.25).astype(np.intp), 7)]
        command = command + (time > 0.25) * 2.0 * np.sin(
            2.0 * np.pi * rng.uniform(2.0, 20.0) * time
        )
        start = {"pressure_a": 0.6e6, "pressure_b": 0.6e6}
        drive = Drive(time, {"current_command": command}, start, locked=True)
        clean = truth.plant.simulate(truth.vector(), drive, 2.5e-5)
        columns = [truth.plant.outputs.index(name) for name in NOISE]
        logged = clean[:, columns] + noise(rng, time.size) * list(NOISE.values())
        name = f"run{number}"
        run = Run(name, Path(name), None, True, False, Use.TRAIN, lambda: None)
        good = np.ones(logged.shape, dtype=np.bool_)
        runs.append(Measured(run, time, {"current_command": command}, tuple(NOISE), logged, good))
    return runs


def held(kind: str, case: int, seed: int) -> list[bool]:
    """Return whether each interval of one case holds the truth."""
    noise, own = KINDS[kind]
    rng = np.random.default_rng([seed, case, list(KINDS).index(kind)])
    windows = [window_at(run, 0, run.time.size, NOISE) for run in recorded(rng, noise, own)]
    off = {key: value * (1.0 + 0.01 * rng.uniform(-1.0, 1.0)) for key, value in TRUTH.items()}
    model = Model("eha_knee", off, tuple(off), (VALVES,))
    problem = Problem(model.plant, windows, NOISE, STEP)
    vector = model.vector()
    problem.prepare(vector)
    free = free_parameters(model.plant.layout, list(TRUTH), vector)
    fit = levenberg_marquardt(problem, vector, free)
    problem.prepare(fit.vector)
    end = converged_fit(problem, fit)
    found = estimates(end.fit, groups_of(problem), {}, shift=end.shifts)
    return [bool(found[key].low <= value <= found[key].high) for key, value in TRUTH.items()]


def main() -> None:
    """Fit them all, and print how often."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.intervals", description=__doc__)
    parser.add_argument("--cases", type=int, default=100, help="actuators of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    rows = []
    for kind in KINDS:
        hits = [hit for case in range(given.cases) for hit in held(kind, case, given.seed)]
        line = rate(f"95 % intervals hold the truth: {kind}", hits)
        note = f"{LEAST:.0%} to {MOST:.0%}, {line.tried} intervals"
        rows.append(Row(line.what, line.share, met=LEAST <= line.share <= MOST, note=note))
        print(rows[-1], flush=True)
    write_rows(given.json, rows)


if __name__ == "__main__":
    main()
