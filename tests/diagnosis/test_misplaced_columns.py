"""A column that a log holds a row beside its place: said where it is so, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.data.noise import is_rough
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.outcome.misplaced_columns import misplaced_column
from eha_bench.diagnosis.search.state import Search, begin
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

PLANT = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag: {kind: friction, on: shaft, viscous: 0.004 N*m*s/rad}
inputs: {current_command: motor.current}
channels: {current: motor.current, motor_speed: shaft.speed}
calibrate: [shaft.inertia, drag.viscous]
"""
TICK = 2e-3


def stepped(generator: np.random.Generator, time: np.ndarray) -> np.ndarray:
    return np.repeat(generator.uniform(-6.0, 6.0, time.size // 20), 20)


def swinging(_: np.random.Generator, time: np.ndarray) -> np.ndarray:
    return 5.0 * np.sin(2.0 * np.pi * 3.0 * time)


def searched(folder: Path, rows: int, current_rows: int = 0, asked=stepped) -> Search:
    """Begin a search where the command was logged so many rows late, and the current early."""
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    model = load_model(folder / "plant.yaml")
    generator = np.random.default_rng(7)
    time = TICK * np.arange(1200)
    text = "model: plant.yaml\ninputs: [current_command]\nruns:\n"
    for number in range(2):
        current = asked(generator, time)
        out = model.plant.simulate(
            model.vector(), Drive(time, {"current_command": current}, {"motor_speed": 0.0}), 2e-4
        )
        read = {
            name: out[:, at] + 0.02 * generator.standard_normal(time.size)
            for at, name in enumerate(model.plant.outputs)
        }
        read["current"] = np.roll(read["current"], -current_rows)
        logged = np.concatenate([np.full(rows, current[0]), current[: time.size - rows]])
        write(folder / f"{number}.mcap", Recording(time, {"current_command": logged, **read}))
        text += f"  - {{log: {number}.mcap}}\n"
    (folder / "dataset.yaml").write_text(text, encoding="utf-8")
    return begin(calibrated_baseline(load_dataset(folder / "dataset.yaml")))


@pytest.mark.parametrize("rows", [1, 2])
def test_a_current_that_was_read_back_is_said_to_have_acted_before(
    tmp_path: Path, rows: int
) -> None:
    search = searched(tmp_path, rows)
    found = misplaced_column(search)
    assert found is not None
    assert (found.name, found.rows) == ("current_command", -rows)
    assert found.share > 0.9
    words = "one row" if rows == 1 else "2 rows"
    assert f"with 'current_command' {words} earlier" in found.note


def test_a_current_that_its_rows_command_has_led_to_belongs_later(tmp_path: Path) -> None:
    found = misplaced_column(searched(tmp_path, 0, current_rows=1, asked=swinging))
    assert found is not None
    assert (found.name, found.rows) == ("current", 1)
    assert "with 'current' one row later" in found.note


def test_of_a_current_that_acts_from_its_row_on_nothing_is_said(tmp_path: Path) -> None:
    assert misplaced_column(searched(tmp_path, 0)) is None


@pytest.mark.parametrize("name", ["current", "current_command"])
def test_a_motors_current_that_was_read_back_has_a_sensors_noise(tmp_path: Path, name: str) -> None:
    content = PLANT.replace("current: motor.current, ", "").replace("current_command", name)
    (tmp_path / "plant.yaml").write_text(content, encoding="utf-8")
    roles = load_model(tmp_path / "plant.yaml").plant.roles
    is_read_back = name == "current"
    assert (name in roles.commands) != is_read_back
    assert (name in roles.added_up) == is_read_back


def test_only_what_is_rough_has_noise() -> None:
    generator = np.random.default_rng(3)
    smooth = 3.0 * np.sin(2.0 * np.pi * 0.8 * np.arange(0.0, 2.0, 2e-3))
    held = np.repeat(generator.uniform(-5.0, 5.0, 50), 20)
    assert is_rough(smooth + 0.03 * generator.standard_normal(smooth.size))
    assert is_rough(held + 0.03 * generator.standard_normal(held.size))
    assert not is_rough(smooth)
    assert not is_rough(held)
    assert not is_rough(smooth[:5])
