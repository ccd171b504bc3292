"""Free simulation of runs by a model of eha_bench: for entrants that revise such a model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from benchmarks.league.question import FloatArray, Question, Run

from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Drive

STEP = 1e-4
"""Integration step, s: its error is below a tenth of the sensors' noise."""
_REST = 4.0
"""A speed of so many standard deviations of its noise, at most, is taken for none."""


def predicted(question: Question, model: Model) -> Mapping[str, Mapping[str, FloatArray]]:
    """Return every held-out run simulated freely from its opening: run -> channel -> (n,) SI."""
    return {run.name: simulated(run, model) for run in question.held_out}


def simulated(run: Run, model: Model) -> dict[str, FloatArray]:
    """Return a run's channels, (n,) SI, from its command and first readings."""
    plant = model.plant
    inputs = {"current_command": run.command}
    at = plant.at(model.vector())
    drive = Drive(
        run.time, inputs, first_readings(run), locked=run.locked, bypass_open=run.bypass_open
    )
    values = at.simulate(drive, start_of(at, drive, drive.initial), STEP)
    return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(plant.outputs)}


def first_readings(run: Run) -> dict[str, float]:
    """Return where a run starts, SI: its first readings, and rest where the noise shows no more."""
    found = {}
    for name, values in run.measured.items():
        seen = values[np.isfinite(values)]
        first = float(seen[0])
        if name in ("motor_speed", "piston_velocity", "current"):
            noise = float(np.std(np.diff(seen))) / np.sqrt(2.0)
            first = 0.0 if abs(first) <= _REST * noise else first
        found[name] = first
    return found
