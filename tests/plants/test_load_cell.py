"""A load cell between two parts: what it reads, and what it tells of a part without a sensor."""

from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.plants.elements.load_cell import force_on_first, force_on_second
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Drive

RIG = """\
plant: pulled_rod
nodes:
  carriage: {kind: translation}
  rod:      {kind: translation, mass: 0.3 kg}
elements:
  cell:  {kind: load_cell, between: [rod, carriage], stiffness: 4e4 N/m, damping: 50 N*s/m}
  guide: {kind: friction, on: rod, coulomb: 8 N, viscous: 100 N*s/m}
  air:   {kind: load, on: rod, force: -60 N}
channels: {carriage_position: carriage.position, cell_force: cell.force}
"""


def test_both_sides_feel_the_same_force() -> None:
    state = {"position_first": 2e-3, "position_second": 1e-3, "speed_first": 0.1,
             "speed_second": 0.3, "stiffness": 1e4, "damping": 20.0}  # fmt: skip
    assert force_on_second(**state) == pytest.approx(10.0 - 4.0)
    assert force_on_first(**state) == -force_on_second(**state)


@pytest.mark.slow  # compiles a kernel
def test_a_rod_is_pulled_to_and_fro_against_its_friction(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(RIG)
    plant = load_plant(tmp_path / "plant.yaml")
    assert plant.determined(("carriage_position",)) == ("cell_force",)
    vector = plant.layout.defaults()
    time = np.arange(0.0, 2.0, 0.01)
    position = 0.01 * np.interp(time, [0.0, 1.0, 2.0], [1.0, 2.0, 1.0])
    drive = Drive(time, {"carriage_position": position})
    at = plant.at(vector)
    start = start_of(at, drive, {"cell_force": 50.0})
    # the rod has no sensor: it stands where the force bends the cell by that much
    assert start["rod_position"] == pytest.approx(0.01 + 50.0 / 4e4)
    force = at.simulate(drive, start, 2e-4)[:, plant.outputs.index("cell_force")]
    assert force[0] == pytest.approx(50.0, abs=1.0)
    # 60 N from the load, less or more the friction at 10 mm/s, forwards and back
    assert force[60:95] == pytest.approx(60.0 - 9.0, abs=1e-3)
    assert force[160:195] == pytest.approx(60.0 + 9.0, abs=1e-3)
