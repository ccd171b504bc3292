"""A seal tester: a rod that a carriage moves, whose position is read with noise."""

from __future__ import annotations

from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.diagnosis.outcome.diagnosis import Verdict

PLANT = """\
plant: my_seal_rig
nodes:
  air:      {kind: reservoir, pressure: 1 bar}
  ambient:  {kind: reservoir, pressure: 0 bar}
  carriage: {kind: translation}
  rod:      {kind: translation, mass: 0.3 kg}
elements:
  cylinder: {kind: cylinder, on: rod, a: air, b: ambient, area_a: 4.91 cm^2, area_b: 4.91 cm^2}
  cell:     {kind: load_cell, between: [rod, carriage], stiffness: 4e4 N/m, damping: 50 N*s/m}
  guide:    {kind: friction, on: rod, coulomb: 3 N, viscous: 50 N*s/m}
channels: {carriage_position: carriage.position, cell_force: cell.force}
calibrate:
  - {parameter: cylinder.area_a, within: 10 %}
  - guide.coulomb
  - guide.viscous
"""
SUITE = """\
name: first
defaults: {mode: carriage_position, sample_rate: 500 Hz}
trials:
  - {id: slow, duration: 4 s, signal: {kind: sine, amplitude: 10 mm, frequency: 0.5 Hz}}
  - {id: ramp, duration: 2 s, signal: {kind: ramp, final: 10 mm, over: 1 s, at: 0.2 s}}
  - {id: slower, duration: 4 s, signal: {kind: sine, amplitude: 8 mm, frequency: 0.4 Hz}}
"""
RIG = """\
target: simulator
model: plant.yaml
sensors: {carriage_position: {noise: 2 um}, cell_force: {noise: 0.05 N}}
"""
DATASET = """\
model: plant.yaml
inputs: [carriage_position]
runs:
  - {log: run/recordings/slow-0.mcap, use: train}
  - {log: run/recordings/ramp-0.mcap, use: train}
  - {log: run/recordings/slower-0.mcap, use: holdout}
"""


@pytest.mark.slow
def test_a_healthy_tester_that_jerks_at_first_is_healthy(tmp_path: Path) -> None:
    # the air pushes the rod from the first moment on: the cell reads 0 and then 50 N
    for name, text in (("plant", PLANT), ("rig", RIG), ("first", SUITE), ("dataset", DATASET)):
        (tmp_path / f"{name}.yaml").write_text(text)
    eb.run(tmp_path / "first.yaml", str(tmp_path / "rig.yaml"), tmp_path / "run")
    found = eb.diagnose(tmp_path / "dataset.yaml", tmp_path / "diagnosis")
    assert found.verdict is Verdict.NONE
    assert found.calibrated["guide.coulomb"].value == pytest.approx(3.0, rel=0.01)
    assert found.calibrated["guide.viscous"].value == pytest.approx(50.0, rel=0.02)
    assert not any("not white" in note for note in found.notes)
