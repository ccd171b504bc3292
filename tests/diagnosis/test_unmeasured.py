"""States without a sensor: carried to where windows begin, even at rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.fit.candidates import effect_starts
from eha_bench.diagnosis.fit.own_parameters import with_own
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.unmeasured import missing, with_carried_states
from eha_bench.diagnosis.search.state import _is_of_unread_sensor
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.plant import Drive

NOISE = {
    "current": 0.05,
    "motor_speed": 0.1,
    "pressure_a": 3e4,
    "piston_position": 4e-6,
    "piston_velocity": 1e-3,
}
STEP = 1e-4


@pytest.fixture(scope="module")
def model():
    return load_model(shipped_file("models/physical.yaml"))


@pytest.fixture(scope="module")
def truth(model):
    """A free rod that swings: time, command, and every output without noise."""
    time = np.arange(1500) * 1e-3
    command = 8.0 * np.sin(2 * np.pi * 2.0 * time)
    start = {"pressure_a": 2e6, "pressure_b": 2e6}
    drive = Drive(time, {"current_command": command}, start)
    return time, command, model.plant.simulate(model.vector(), drive, STEP)


def _measured(model, truth):
    """The run without a sensor in chamber b."""
    time, command, out = truth
    values = {name: out[:, k] for k, name in enumerate(model.plant.outputs) if name in NOISE}
    reading = Recording(time, {"current_command": command, **values})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    return admit(run, reading, ["current_command"], model.plant.outputs)


def test_a_chamber_without_a_sensor_begins_where_the_simulation_has_it(model, truth) -> None:
    measured = _measured(model, truth)
    edges = (0, 500, 1000, 1500)
    windows = [window_at(measured, a, b, NOISE) for a, b in pairwise(edges)]
    assert [missing(model.plant, window) for window in windows] == [("pressure_b",)] * 3
    found = with_carried_states(model.plant, model.vector(), windows, STEP)
    true = truth[2][:, model.plant.outputs.index("pressure_b")]
    for window in found:
        error = abs(window.carried["pressure_b"] - true[window.first])
        assert error < 0.02 * np.ptp(true)
        assert error < window.spread["pressure_b"] < np.ptp(true)
    # a window alone is reached from the run's beginning
    (last,) = with_carried_states(model.plant, model.vector(), windows[2:], STEP)
    assert abs(last.carried["pressure_b"] - true[1000]) < last.spread["pressure_b"]


def test_the_right_model_leaves_nothing_though_a_sensor_is_dead(model, truth) -> None:
    measured = _measured(model, truth)
    windows = [window_at(measured, k, k + 300, NOISE) for k in range(0, 1500, 300)]
    problem = Problem(model.plant, windows, NOISE, STEP)
    before = np.sqrt(np.mean(problem.residual(model.vector()) ** 2))
    problem.prepare(model.vector())
    after = np.sqrt(np.mean(problem.residual(model.vector()) ** 2))
    assert before > 1.0
    assert after < 0.5


def test_at_rest_one_chamber_tells_the_other(model) -> None:
    assert model.plant.at_rest({"pressure_a": 6e5}) == {"pressure_b": 6e5}
    assert model.plant.at_rest({"pressure_a": 6e5, "pressure_b": 1e5}) == {}
    assert model.plant.at_rest({"motor_speed": 0.0}) == {}


FED = """\
plant: fed
nodes:
  a:    {kind: volume, bulk_modulus: 1 GPa, pressure: 6 bar}
  b:    {kind: volume, bulk_modulus: 1 GPa, pressure: 6 bar}
  feed: {kind: volume, pressure: 5 bar}
  rod:  {kind: translation, mass: 5 kg}
  shaft: {kind: rotation, inertia: 4e-4 kg*m^2}
elements:
  cylinder: {kind: cylinder, on: rod, a: a, b: b, area_a: 6 cm^2, area_b: 6 cm^2,
             volume_a: 30 cm^3, volume_b: 30 cm^3}
  gas:      {kind: accumulator, on: feed, precharge: 5 bar, gas_volume: 60 cm^3}
  leak:     {kind: laminar_leakage, between: [a, b], conductance: 1e-12 m^3/(s*Pa)}
  drain:    {kind: laminar_leakage, between: [a, feed], conductance: 1e-13 m^3/(s*Pa)}
  motor:    {kind: motor, on: shaft, torque_constant: 0.3 N*m/A}
  pump:     {kind: pump, on: shaft, from: b, to: a, displacement: 0.5 cm^3/rad}
inputs:   {current_command: motor.current}
channels: {pressure_a: a.pressure, pressure_b: b.pressure, position: rod.position}
"""


def test_an_accumulator_begins_as_declared_beside_a_chamber_under_pressure(tmp_path) -> None:
    (tmp_path / "plant.yaml").write_text(FED)
    plant = load_plant(tmp_path / "plant.yaml")
    names = {place: name for name, place in plant.state_places.items()}
    fed = next(names[v.pressure] for v in plant.system.volumes if v.name == "feed")
    assert fed not in plant.at_rest({"pressure_a": 2.7e6, "pressure_b": 6e5})
    assert plant.at_rest({"pressure_a": 2.7e6})["pressure_b"] == 2.7e6


def test_what_nobody_measured_is_left_to_be_carried(model, truth) -> None:
    measured = _measured(model, truth)
    dataset = Dataset(model, ("current_command",), (measured.run,))
    _, windows, _, _ = gather(dataset)
    later = [window for window in windows if window.first > 0]
    assert later
    assert all(missing(model.plant, window) == ("pressure_b",) for window in later)


ARM = """\
plant: arm
nodes:
  supply:  {kind: reservoir, pressure: 160 bar}
  tank:    {kind: reservoir, pressure: 5 bar}
  cap:     {kind: volume, bulk_modulus: 0.9 GPa, pressure: 50 bar}
  rodside: {kind: volume, bulk_modulus: 0.9 GPa, pressure: 80 bar}
  piston:  {kind: translation, mass: 40 kg, stroke: [-100 mm, 100 mm]}
elements:
  valve:    {kind: spool_valve, supply: supply, tank: tank, a: cap, b: rodside, full_scale: 10 V,
             flow_gain: 7e-8 m^3/(s*Pa^0.5), natural_frequency: 1257 rad/s, damping_ratio: 0.8}
  cylinder: {kind: cylinder, on: piston, a: cap, b: rodside, area_a: 200 mm^2, area_b: 120 mm^2,
             volume_a: 30 cm^3, volume_b: 20 cm^3}
  leakage:  {kind: laminar_leakage, between: [cap, rodside], conductance: 5e-13 m^3/(s*Pa)}
  seals:    {kind: friction, on: piston, coulomb: 40 N, viscous: 300 N*s/m}
inputs: {valve_command: valve.command}
channels: {piston_position: piston.position}
"""
ARM_NOISE = {"piston_position": 2e-6}


def _arm(
    tmp_path: Path,
    own: tuple[str, ...] = (),
    text: str = ARM,
    noise: Mapping[str, float] = ARM_NOISE,
) -> tuple[Model, Measured]:
    """A cylinder of which only some channels are read, logged from within a motion."""
    (tmp_path / "arm.yaml").write_text(text)
    model = load_model(tmp_path / "arm.yaml")
    plant = model.plant
    time = np.arange(1800) * 1e-3
    command = 1.5 * np.sin(2 * np.pi * 1.5 * time)
    drive = Drive(time, {"valve_command": command}, {})
    out = plant.simulate(model.vector(), drive, STEP)[600:]
    rng = np.random.default_rng(1)
    read = {
        name: out[:, plant.outputs.index(name)] + rng.normal(0.0, level, 1200)
        for name, level in noise.items()
    }
    reading = Recording(time[:1200], {"valve_command": command[600:], **read})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    run = with_own(plant.layout, [run], own)[0]
    return model, admit(run, reading, ["valve_command"], plant.outputs, roles=plant.roles)


def test_pressures_that_no_channel_shows_are_carried_too(tmp_path) -> None:
    model, measured = _arm(tmp_path)
    windows = [window_at(measured, k, k + 150, ARM_NOISE) for k in range(0, 1200, 150)]
    for window in windows:
        assert {"cap_pressure", "rodside_pressure"} <= {*missing(model.plant, window)}
    vector = model.vector()
    problem = Problem(model.plant, windows, ARM_NOISE, STEP)
    problem.prepare(vector)
    # a log's first pressures are 2 MPa off the declared ones here, and nobody read them
    assert np.sqrt(np.mean(problem.residual(vector) ** 2)) < 1.1


def test_a_first_pressure_that_a_run_has_for_its_own_is_left_to_it(tmp_path) -> None:
    model, measured = _arm(tmp_path, ("cap.pressure",))
    plant = model.plant
    windows = [window_at(measured, k, k + 300, ARM_NOISE) for k in (0, 300)]
    assert "cap_pressure" not in missing(plant, windows[0])
    assert "rodside_pressure" in missing(plant, windows[0])
    assert "cap_pressure" in missing(plant, windows[1])


def test_a_sensor_that_no_log_has_is_no_cause(tmp_path) -> None:
    shown = ARM.replace("{piston_position:", "{cap_pressure: cap.pressure, piston_position:")
    model, measured = _arm(tmp_path, text=shown)
    effect = model.plant.layout.effect("pressure_sensor_offset")
    windows = [window_at(measured, k, k + 150, ARM_NOISE) for k in range(0, 1200, 150)]
    problem = Problem(model.plant, windows, ARM_NOISE, STEP)
    (start, *_) = effect_starts(model.plant.layout, effect)
    assert _is_of_unread_sensor(problem, start)
    problem.noise["cap_pressure"] = 1e4
    assert not _is_of_unread_sensor(problem, start)


CELL = """\
  rod_end:  {kind: translation, mass: 20 kg}
elements:
  cell:     {kind: load_cell, between: [piston, rod_end], stiffness: 20 kN/mm, damping: 200 N*s/m}
"""


def test_a_window_begins_with_the_force_that_a_load_cell_reads(tmp_path) -> None:
    text = ARM.replace("elements:\n", CELL).replace(
        "{piston_position: piston.position}",
        "{rod_force: cell.force, rod_end_position: rod_end.position}",
    )
    noise = {"rod_force": 2.0, "rod_end_position": 2e-6}
    model, measured = _arm(tmp_path, text=text, noise=noise)
    windows = [window_at(measured, k, k + 150, noise) for k in range(0, 1200, 150)]
    for window in windows:
        unread = missing(model.plant, window)
        assert {"piston_position", "cap_pressure"} <= {*unread}
    vector = model.vector()
    problem = Problem(model.plant, windows, noise, STEP)
    problem.prepare(vector)
    assert np.sqrt(np.mean(problem.residual(vector) ** 2)) < 1.5
