"""A linear drive with friction, simulated and written as CSV: small, quick data for whole runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

MODEL = """\
model: linear_drive
parameters: {mass: 95 kg, viscous_friction: 210 N*s/m}
calibrate: [mass, viscous_friction, force_offset]
"""
CHANNELS = """\
time: {column: t, unit: s}
channels:
  reference:       {column: r, unit: m}
  piston_position: {column: x, unit: m}
  voltage:         {column: u, unit: V}
"""


def write_drive(folder: Path, *, friction: float = 20.0, seconds: float = 3.0) -> Path:
    """Write a training and a held-out run of a drive in closed loop; return dataset.yaml."""
    generator = np.random.default_rng(5)
    effects = (DeclaredEffect("coulomb_friction", {"friction_force": friction}),)
    truth = Model("linear_drive", {"mass": 93.0, "viscous_friction": 200.0}, (), effects)
    time = np.arange(0.0, seconds, 2e-3)
    for name, rate in (("train", 1.3), ("held", 0.9)):
        reference = 0.02 * np.sin(2 * np.pi * rate * time) + 0.01 * np.sin(2 * np.pi * 0.4 * time)
        drive = Drive(time, {"reference": reference}, {"piston_position": 0.0})
        values = truth.plant.simulate(truth.vector(), drive, 1e-4)
        noise = generator.standard_normal((time.size, 2)) * (2e-2, 2e-6)
        table = np.column_stack([time, reference, values[:, 1] + noise[:, 1],
                                 values[:, 0] + noise[:, 0]])  # fmt: skip
        np.savetxt(folder / f"{name}.csv", table, "%.9g", ",", header="t,r,x,u", comments="")
    (folder / "model.yaml").write_text(MODEL)
    (folder / "channels.yaml").write_text(CHANNELS)
    path = folder / "dataset.yaml"
    path.write_text(
        "model: model.yaml\nchannels: channels.yaml\ninputs: [reference]\nruns:\n"
        "  - {log: train.csv, use: train}\n  - {log: held.csv, use: holdout}\n"
    )
    return path
