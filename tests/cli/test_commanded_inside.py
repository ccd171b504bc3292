"""A suite that commands what a controller inside the plant follows."""

import json
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.core.shipped import shipped_file
from eha_bench.plants.model import model_from
from eha_bench.plants.plant import Drive
from eha_bench.plants.session import Session

SUITE = """\
name: goals
model: {plant}
trials:
  - id: goal
    mode: goal_position
    settle: 0.1 s
    duration: 1 s
    sample_rate: {rate}
    signal: {{kind: steps, initial: 0 deg, levels: [30 deg, -10 deg], hold: 0.45 s, at: 50 ms}}
    accept:
      peak: {{limit: <= 40 deg, channel: angle, unit: rad}}
"""


@pytest.mark.parametrize("rate", [pytest.param("1 kHz", marks=pytest.mark.slow), "50 Hz"])
def test_a_smart_servo_is_commanded_through_its_own_loop(cli, tmp_path: Path, rate: str) -> None:
    plant = shipped_file("plants/position_servo.yaml")
    (tmp_path / "suite.yaml").write_text(SUITE.format(plant=plant, rate=rate))
    cli("run", "suite.yaml", "--out", "out", check=0)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "passed"
    recording = eb.read(next((tmp_path / "out" / "recordings").glob("*.mcap")))
    model = model_from(plant)
    drive = Drive(recording.time, {"goal_position": np.array(recording["goal_position"])})
    replayed = model.plant.at(model.vector()).simulate(drive, {}, 12.5e-6)
    angle = replayed[:, model.plant.outputs.index("angle")]
    # the same loop, tick by tick and over the whole recording
    assert np.allclose(recording["angle"], angle, atol=1e-9)
    assert np.ptp(recording["angle"]) > 0.5


def test_a_plant_without_such_a_controller_says_so() -> None:
    model = model_from(shipped_file("plants/geared_servo.yaml"))
    with pytest.raises(InputError, match="nothing that a controller inside geared_servo follows"):
        Session(model.plant, model.vector(), {}, step=1e-4, command="goal_position")
