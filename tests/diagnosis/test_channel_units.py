"""A channel that is read in another dimension than the plant has it in."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.core.errors import InputError
from eha_bench.diagnosis.data.dataset import load_dataset

PLANT = """\
plant: axis
nodes: {shaft: {kind: rotation, inertia: 0.01 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, resistance: 1 ohm, torque_constant: 0.1 N*m/A}
inputs: {supply: motor.voltage}
channels: {speed: shaft.speed}
"""


def _dataset(folder: Path, unit: str) -> Path:
    (folder / "plant.yaml").write_text(PLANT)
    (folder / "log.csv").write_text("t,u,n\n" + "".join(f"{k / 100},1,2\n" for k in range(50)))
    (folder / "channels.yaml").write_text(
        "time: {column: t}\nchannels:\n"
        f"  supply: {{column: u, unit: {unit}}}\n"
        "  speed: {column: n, unit: rpm}\n"
    )
    path = folder / "dataset.yaml"
    path.write_text(
        "model: plant.yaml\nchannels: channels.yaml\ninputs: [supply]\n"
        "runs: [{log: log.csv, use: train}]\n"
    )
    return path


@pytest.mark.parametrize("unit", ["'%'", "bar", "A", "''"])
def test_a_unit_of_another_dimension_is_refused_where_it_stands(tmp_path: Path, unit: str) -> None:
    with pytest.raises(InputError) as caught:
        load_dataset(_dataset(tmp_path, unit))
    assert f"'supply' is read in '{unit.strip(chr(39))}'" in str(caught.value)
    assert "in V" in str(caught.value)
    assert caught.value.where.line == 3
    assert caught.value.where.key == "channels.supply.unit"


@pytest.mark.parametrize("unit", ["V", "mV"])
def test_a_unit_of_the_same_dimension_is_taken(tmp_path: Path, unit: str) -> None:
    load_dataset(_dataset(tmp_path, unit))


def test_known_channels_and_those_of_no_plant_are_as_they_were(tmp_path: Path) -> None:
    path = write_drive(tmp_path)
    with (tmp_path / "channels.yaml").open("a") as file:
        file.write("  cabinet_temperature: {column: x, unit: degC}\n")
    load_dataset(path)
