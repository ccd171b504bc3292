"""What nobody measured: a load that is another one in every run, and what a data sheet says."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.calibrate import calibrate
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.fit.beliefs import beliefs_of
from eha_bench.diagnosis.fit.least_squares import free_parameters, jacobian
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.replay.prediction import predict
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

OFFSETS = {"one": 4.0, "two": -9.0, "held": 15.0, "kind": -20.0}
"""Force on the drive in each run, N: nobody says it."""
MODEL = """\
model: linear_drive
parameters: {{mass: 95 kg, viscous_friction: 210 N*s/m}}
calibrate: {calibrate}
per_run: [force_offset]
"""


def write_runs(folder: Path, calibrate: str = "[mass, viscous_friction]") -> Path:
    """Write four runs, each with its own force; the last one has 10 kg more, which are known."""
    generator = np.random.default_rng(8)
    time = np.arange(0.0, 1.2, 2e-3)
    lines = []
    for number, (name, force) in enumerate(OFFSETS.items()):
        more = 10.0 if name == "kind" else 0.0
        values = {"mass": 93.0 + more, "viscous_friction": 200.0, "force_offset": force}
        truth = Model("linear_drive", values)
        voltage = 0.4 * np.sin(2 * np.pi * (1.5 + number) * time)
        drive = Drive(time, {"voltage": voltage}, {"piston_position": 0.0})
        out = truth.plant.simulate(truth.vector(), drive, 1e-4)
        position = out[:, truth.plant.outputs.index("piston_position")]
        noisy = position + 2e-6 * generator.standard_normal(time.size)
        write(
            folder / f"{name}.mcap", Recording(time, {"voltage": voltage, "piston_position": noisy})
        )
        use = {"held": "holdout", "kind": "unseen"}.get(name, "train")
        known = ", parameters: {mass: 103 kg}" if more else ""
        lines.append(f"  - {{log: {name}.mcap, use: {use}{known}}}\n")
    (folder / "model.yaml").write_text(MODEL.format(calibrate=calibrate))
    path = folder / "dataset.yaml"
    path.write_text("model: model.yaml\ninputs: [voltage]\nruns:\n" + "".join(lines))
    return path


def test_every_run_gets_its_own_force(tmp_path):
    found = calibrate(write_runs(tmp_path), tmp_path / "out")
    for run, force in OFFSETS.items():
        item = found.per_run[run]["force_offset"]
        assert item.value == pytest.approx(force, abs=0.5), run
        assert item.high - item.low < 2.0
    assert found.parameters["mass"].value == pytest.approx(93.0, rel=5e-3)
    assert set(found.parameters) >= {"mass", "viscous_friction"}
    assert not any("force_offset" in key for key in found.parameters)
    content = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert content["per_run"]["one"]["force_offset"]["unit"] == "N"
    assert set(content["error"]) == {"train", "holdout", "unseen"}
    held = found.holdout["piston_position"]
    assert held.after < 1.5 * held.noise_floor < held.before
    unseen = found.unseen["piston_position"]
    # the 103 kg of that run are what its entry says, the calibrated mass is the others'
    assert unseen.after < 1.5 * unseen.noise_floor
    assert sum("from its first 0.399 s only" in note for note in found.notes) == 2


def test_a_prediction_estimates_it_from_the_first_part(tmp_path):
    path = write_runs(tmp_path)
    calibrate(path, tmp_path / "out")
    found = {item.run: item for item in predict(path, tmp_path / "out" / "calibrated.yaml")}
    assert any("from its first 0.399 s only" in note for note in found["held"].notes)
    assert found["held"].errors["piston_position"] < 1e-5


def test_only_its_own_run_tells_of_a_value(tmp_path):
    dataset = load_dataset(write_runs(tmp_path))
    measured, windows, noise, _ = gather(dataset)
    problem = Problem(dataset.model.plant, windows, noise, 2e-4, beliefs_of(dataset.model))
    vector = problem.places.lengthened(dataset.model.vector())
    keys = [item.key for item in problem.places.own]
    assert keys == ["force_offset in one", "force_offset in two"]
    free = free_parameters(problem.places, keys, vector)
    base = problem.residual(vector)
    matrix = jacobian(problem, vector, free, base)
    for column, run in enumerate(item.run.name for item in measured):
        _, rows = problem.of_run(run)
        others = np.setdiff1d(np.arange(base.size), rows)
        assert np.abs(matrix[rows, column]).max() > 0.0
        assert np.abs(matrix[others, column]).max() == 0.0
        # the same by moving it in the whole problem
        moved = vector.copy()
        moved[free[column].at] += 1.0
        change = problem.at_step(3.4e-4).residual(moved) - problem.at_step(3.4e-4).residual(vector)
        assert matrix[rows, column] / free[column].scale == pytest.approx(change[rows], rel=0.02,
                                                                          abs=1e-3)  # fmt: skip


def test_what_is_believed_decides_what_the_data_leave_open(tmp_path):
    """Mass and everything that drives it scale together: only their ratio shows."""
    path = write_runs(tmp_path, "[{parameter: mass, within: 6 %}, viscous_friction]")
    dataset = load_dataset(path)
    belief = beliefs_of(dataset.model)[0]
    assert belief.value == 95.0
    assert belief.deviation == pytest.approx(0.06 * 95.0 / math.sqrt(3.0))
    found = calibrate(dataset)
    # a thousand readings say far more than the data sheet
    assert found.parameters["mass"].value == pytest.approx(93.0, rel=5e-3)
