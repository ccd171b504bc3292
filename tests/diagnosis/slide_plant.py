"""A mass that slides, with viscous friction and one dry level."""

from __future__ import annotations

from pathlib import Path

from eha_bench.plants.model import Model, load_model

_PLANT = """\
plant: slide
nodes: {rod: {kind: translation, mass: 10 kg}}
elements:
  seals:  {kind: friction, on: rod, viscous: 100 N*s/m, coulomb: 30 N}
  motor:  {kind: linear_motor, on: rod, force_constant: 1 N/V}
inputs:   {command: motor.voltage}
channels: {position: rod.position, velocity: rod.velocity}
calibrate: [{parameter: seals.coulomb, within: 10 %}]
"""


def slide(folder: Path) -> Model:
    """Write the plant, and return its model."""
    path = folder / "plant.yaml"
    path.write_text(_PLANT, encoding="utf-8")
    return load_model(path)
