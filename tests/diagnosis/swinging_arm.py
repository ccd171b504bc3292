"""An arm that swings by its weight, and runs in which its angle is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive

_PLANT = """\
plant: swing
nodes:
  axis: {{kind: rotation, inertia: 1e-6 kg*m^2}}
elements:
  arm:  {{kind: pendulum, on: axis, mass: 1 kg, length: 1 m}}
  drag: {{kind: friction, on: axis, viscous: {viscous} N*m*s/rad, creep_speed: 0 rad/s}}
channels: {{angle: axis.angle}}
calibrate: [arm.length, drag.viscous]
"""


def arm(folder: Path, viscous: float) -> Model:
    """Declare the arm, with some friction of its bearing in N*m*s/rad."""
    path = folder / "plant.yaml"
    path.write_text(_PLANT.format(viscous=viscous))
    return load_model(path)


def swung(model: Model, time: np.ndarray, angle: float, noise: np.ndarray, step: float):
    """Let go of it at an angle, and read it with some noise, rad."""
    out = model.plant.simulate(model.vector(), Drive(time, {}, {"angle": angle}), step)
    return out[:, model.plant.outputs.index("angle")] + noise


def measured_as(model: Model, time: np.ndarray, angle: np.ndarray, name: str = "swing") -> Measured:
    """Pass a run of readings through the gate."""
    recording = Recording(time, {"angle": angle})
    run = Run(name, Path("swing.csv"), None, False, False, Use.TRAIN, lambda: recording)
    return admit(run, recording, [], model.plant.outputs, roles=model.plant.roles)
