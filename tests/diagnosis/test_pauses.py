"""Logs that pause are compared in parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.calibrate import calibrate
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.data.pauses import parted_at_pauses, pauses
from eha_bench.diagnosis.replay.prediction import predict
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

PLANT = """
plant: axis
nodes:
  supply:    {kind: reservoir, pressure: 14 MPa}
  tank:      {kind: reservoir, pressure: 3 bar}
  chamber_a: {kind: volume, bulk_modulus: 1.2 GPa, pressure: 7 MPa}
  chamber_b: {kind: volume, bulk_modulus: 1.2 GPa, pressure: 7 MPa}
  rod:       {kind: translation, mass: 120 kg, stroke: [-125 mm, 125 mm]}
elements:
  valve:    {kind: spool_valve, supply: supply, tank: tank, a: chamber_a, b: chamber_b,
             flow_gain: 9e-8 m^3/(s*Pa^0.5), natural_frequency: 440 rad/s, damping_ratio: 0.75}
  cylinder: {kind: cylinder, on: rod, a: chamber_a, b: chamber_b, area_a: 12 cm^2, area_b: 12 cm^2,
             dead_volume_a: 60 cm^3, dead_volume_b: 60 cm^3}
  friction: {kind: friction, on: rod, coulomb: 160 N, viscous: 1800 N*s/m}
inputs:   {valve_command: valve.command}
channels: {piston_position: rod.position}
calibrate: [{parameter: valve.flow_gain, within: 20 %}]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A log of 4 s at 500 Hz that pauses from 1.2 to 2.2 s, in which the rod is driven back."""
    (tmp_path / "plant.yaml").write_text(PLANT)
    model = load_model(tmp_path / "plant.yaml")
    time = np.arange(0.0, 4.0, 2e-3)
    command = 2.0 * np.sin(2.0 * np.pi * 1.3 * time) * (time > 0.1)
    command[(time > 1.3) & (time < 2.1)] = -4.0
    drive = Drive(time, {"valve_command": command}, {})
    vector = model.vector()
    vector[model.plant.layout.index["valve.flow_gain"]] *= 1.08
    values = model.plant.simulate(vector, drive, 1e-4)
    noise = np.random.default_rng(5).normal(0.0, 2e-5, time.size)
    position = values[:, model.plant.outputs.index("piston_position")] + noise
    there = (time <= 1.2) | (time >= 2.2)
    rows = np.column_stack([time, command, 1e3 * position])[there]
    header = "time [s],valve_command [V],piston_position [mm]"
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=header, comments="")
    (tmp_path / "dataset.yaml").write_text(
        "model: plant.yaml\ninputs: [valve_command]\nruns:\n  - {log: log.csv, use: train}\n"
        "  - {log: log.csv, from: 0 s, to: 4 s, use: train}\n"
    )
    return tmp_path


def test_a_pause_is_longer_than_twenty_periods_and_a_quarter_of_a_second() -> None:
    fast = np.delete(np.arange(0.0, 2.0, 1e-3), slice(500, 600))
    assert pauses(fast) == []
    longer = np.delete(np.arange(0.0, 2.0, 1e-3), slice(500, 800))
    assert pauses(longer) == [(pytest.approx(0.499), pytest.approx(0.8))]
    slow = np.delete(np.arange(0.0, 20.0, 0.1), slice(50, 65))
    assert pauses(slow) == []


def test_parts_are_runs_of_their_own_and_the_first_says_so(folder: Path) -> None:
    first, *others = load_dataset(folder / "dataset.yaml").runs
    parts = parted_at_pauses([first], [run.name for run in others])
    assert [part.name for part in parts] == ["log", "log-3"]
    before, after = (part.read() for part in parts)
    assert before.time[-1] - before.time[0] == pytest.approx(1.2)
    assert after.time[0] - before.time[0] == pytest.approx(2.2)
    assert "nothing was logged for 1 s from 1.2 s on" in before.notes[-1]
    assert len(after.notes) == len(before.notes) - 1


def test_a_log_stays_whole_where_a_part_lacks_a_channel(folder: Path) -> None:
    """A command that is logged on change is in force behind the pause, though no row says so."""
    rows = (folder / "log.csv").read_text().splitlines()
    header, *lines = rows
    cells = [line.split(",") for line in lines]
    kept = [[t, u if float(t) < 2.0 else "", x] for t, u, x in cells]
    (folder / "log.csv").write_text("\n".join([header, *map(",".join, kept)]) + "\n")
    runs = load_dataset(folder / "dataset.yaml").runs[:1]
    assert parted_at_pauses(runs, []) == runs


def test_what_drove_a_machine_in_a_pause_is_laid_to_nothing(folder: Path) -> None:
    """In the pause the rod was driven back by 60 mm; held, its last command drives it ahead."""
    found = calibrate(folder / "dataset.yaml")
    assert found.parameters["valve.flow_gain"].value == pytest.approx(1.08 * 9e-8, rel=2e-3)
    assert found.train["piston_position"].after < 1e-4
    assert not any("small errors add up" in note for note in found.notes)


def test_a_prediction_begins_anew_behind_a_pause(folder: Path) -> None:
    whole, part = predict(folder / "dataset.yaml")
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    assert whole.time == pytest.approx(rows[:, 0])
    assert part.time.size == whole.time.size
    # the flow gain is 8 % off: what the last command, held through the pause, adds is 60 mm
    predicted = whole.values["piston_position"]
    assert np.abs(predicted - 1e-3 * rows[:, 2]).max() < 8e-3
    assert whole.errors["piston_position"] == pytest.approx(
        float(np.sqrt(np.mean((predicted - 1e-3 * rows[:, 2]) ** 2))), rel=1e-3
    )
    assert any("nothing was logged for 1 s from 1.2 s on" in note for note in whole.notes)


def test_stamps_of_a_part_too_short_to_be_one_are_predicted_by_nothing(folder: Path) -> None:
    rows = (folder / "log.csv").read_text().splitlines()
    header, *lines = rows
    lines = [line for line in lines if not 0.004 < float(line.split(",")[0]) < 0.6]
    (folder / "log.csv").write_text("\n".join([header, *lines]) + "\n")
    found, _ = predict(folder / "dataset.yaml")
    assert found.time.size == len(lines)
    missing = np.isnan(found.values["piston_position"])
    assert found.time[missing] == pytest.approx([0.0, 0.002, 0.004])
