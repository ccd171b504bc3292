"""A speed that nobody reads is the slope of a position that is read, and a curve may follow it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use, load_dataset
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.slopes import Slope, slope_of
from eha_bench.diagnosis.fit.baseline import COARSE, calibrated_baseline, no_progress
from eha_bench.diagnosis.outcome.diagnosis import Unknown
from eha_bench.diagnosis.outcome.remainder import Remainder, remainder
from eha_bench.diagnosis.search.state import Search, begin
from eha_bench.diagnosis.unknown.curves import Curves
from eha_bench.diagnosis.unknown.learn import learn
from eha_bench.diagnosis.unknown.locator import locate
from eha_bench.diagnosis.unknown.places import places_of, variables_of
from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.effects.learned import KNOTS
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.plant import Drive, Plant
from eha_bench.plants.registry import get_plant
from eha_bench.recordings import write

SPINDLE = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag: {kind: friction, on: shaft, viscous: 0.004 N*m*s/rad}
inputs: {current_command: motor.current}
channels: {shaft_turn: shaft.angle}
calibrate: [shaft.inertia]
"""
TICK, STEPS, DRAG = 2e-3, 20, 2e-4


def slope(time: FloatArray, values: FloatArray, noise: float) -> Slope:
    found = slope_of(time, time, values, noise, "angle")
    assert found is not None
    return found


def test_a_slope_is_the_rate() -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    found = slope(time, np.sin(2.0 * np.pi * time), 0.0)
    assert found.noise == 0.0
    inner = slice(10, -10)
    rate = 2.0 * np.pi * np.cos(2.0 * np.pi * time)
    assert np.abs(found.values - rate)[inner].max() < 1e-3


def test_its_noise_is_as_stated_and_little_of_the_motion_where_that_can_be() -> None:
    """White noise of 1e-3 rad: within 20 ms at 1 kHz a line's slope has 1.4e-3 / 0.15 = 8e-3."""
    time = np.arange(0.0, 4.0, 1e-3)
    white = 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    still = slope(time, white, 1e-3)
    assert still.noise == pytest.approx(1e-3 / np.sqrt(2 * np.sum((1e-3 * np.arange(21)) ** 2)))
    assert np.std(still.values) == pytest.approx(still.noise, rel=0.15)
    fast = slope(time, 20.0 * np.sin(time) + white, 1e-3)
    assert still.noise < fast.noise < 0.02 * 15.0  # fewer readings are enough
    error = fast.values - 20.0 * np.cos(time)
    assert np.std(error) == pytest.approx(fast.noise, rel=0.15)


def test_nothing_is_told_across_a_gap_nor_of_few_readings() -> None:
    time = np.arange(0.0, 1.0, 1e-3)
    read = np.where((time > 0.4) & (time < 0.6), np.nan, 3.0 * time)
    found = slope(time, read, 0.0).values
    assert np.isnan(found[480:520]).all()
    assert found[[100, 900]] == pytest.approx(3.0)
    assert slope_of(time[:5], time[:5], read[:5] * [1, 1, np.nan, 1, 1], 0.0, "angle") is None


def run_of(roles: ChannelRoles, *, locked: bool = False, **columns: FloatArray) -> Measured:
    run = Run("run", Path("none"), None, locked, False, Use.TRAIN, Recording)
    values = np.column_stack([*columns.values()])
    time = 1e-3 * np.arange(len(values))
    valid = np.ones(values.shape, dtype=np.bool_)
    return Measured(run, time, {}, tuple(columns), values, valid, roles=roles)


RAMP = 2.0 * 1e-3 * np.arange(200)


def test_a_rate_is_derived_only_where_nothing_reads_it() -> None:
    roles = ChannelRoles(rates=("speed",), rate_of={"angle": "speed"}, locked=("angle", "speed"))
    (found,) = run_of(roles, angle=RAMP).slopes.items()
    assert (found[0], found[1].of) == ("speed", "angle")
    assert found[1].values == pytest.approx(2.0)
    assert variables_of(run_of(roles, angle=RAMP))["speed"] == pytest.approx(2.0)
    both = run_of(roles, angle=RAMP, speed=np.full(200, 2.1))
    assert not both.slopes
    assert variables_of(both)["speed"] == pytest.approx(2.1)
    assert not run_of(roles, pressure=RAMP).slopes
    # what is locked stands still, whatever its sensor's noise says
    assert not run_of(roles, locked=True, angle=RAMP).slopes["speed"].values.any()


def test_behind_a_gear_the_shaft_turns_by_the_ratio() -> None:
    roles = ChannelRoles(rate_of={"table": "shaft_speed"}, geared={"table": ("shaft_angle", 0.1)})
    assert run_of(roles, table=RAMP).slopes["shaft_speed"].values == pytest.approx(20.0)


@pytest.mark.parametrize(("noise", "told"), [(0.2, True), (0.4, False)])
def test_a_slope_that_is_noise_is_nothing_to_follow(noise: float, told: bool) -> None:
    """A tenth of the variance at most: 0.32 of a standard deviation of 1."""
    rows = np.tile([-1.0, 1.0], (4, 6))
    speed = Slope(rows[0], noise, "angle")
    window = SimpleNamespace(measured=SimpleNamespace(slopes={"speed": speed}))
    curves = object.__new__(Curves)
    curves.short = cast("Any", SimpleNamespace(windows=[window, window]))
    assert curves._is_told("speed", rows) is told
    assert curves._is_told("current", rows)


def variables_at(plant: Plant, place: str) -> set[str]:
    return {name for spot in places_of(plant) if spot.at == place for name in spot.variables}


def plant_of(folder: Path, text: str) -> Plant:
    path = folder / "plant.yaml"
    path.write_text(text, encoding="utf-8")
    return load_model(path).plant


def test_what_may_be_followed_of_a_shaft(tmp_path: Path) -> None:
    assert variables_at(plant_of(tmp_path, SPINDLE), "shaft") >= {"shaft_turn", "shaft_speed"}
    read = SPINDLE.replace("shaft.angle}", "shaft.angle, turns: shaft.speed}")
    assert variables_at(plant_of(tmp_path, read), "shaft") >= {"shaft_turn", "turns"}
    assert "shaft_speed" not in variables_at(plant_of(tmp_path, read), "shaft")
    geared = SPINDLE.replace("nodes: {", "nodes: {table: {kind: rotation}, ")
    geared = geared.replace(
        "elements:", "elements:\n  gear: {kind: gear, from: table, to: shaft, ratio: 0.1}"
    )
    geared = geared.replace("shaft.angle", "table.angle")
    assert "shaft_speed" in variables_at(plant_of(tmp_path, geared), "shaft")


MOTOR = """\
plant: turntable
nodes:
  tank:   {kind: reservoir, pressure: 5 bar}
  line_a: {kind: volume, volume: 30 cm^3, bulk_modulus: 1.1 GPa, pressure: 60 bar}
  line_b: {kind: volume, volume: 30 cm^3, bulk_modulus: 1.1 GPa, pressure: 60 bar}
  table:  {kind: rotation, inertia: 0.1 kg*m^2}
elements:
  valve: {kind: spool_valve, supply: supply, tank: tank, a: line_a, b: line_b, full_scale: 10 V,
          flow_gain: 5.5e-8 m^3/(s*Pa^0.5)}
  hydromotor: {kind: pump, on: table, from: line_a, to: line_b, displacement: 16 cm^3/rev}
  drag:  {kind: friction, on: table, coulomb: 1.2 N*m, viscous: 0.05 N*m*s/rad}
inputs:   {valve_command: valve.command}
channels: {table_angle: table.angle, p_in: line_a.pressure, p_out: line_b.pressure}
calibrate: [drag.viscous]
"""
MOTOR = MOTOR.replace("nodes:\n", "nodes:\n  supply: {kind: reservoir, pressure: 160 bar}\n")


def test_a_hydraulic_motors_pressures_and_its_speed_are_there(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, MOTOR)
    assert plant.roles.facing == ("p_out", "p_in")  # what a pump would make
    assert plant.roles.pair == ()
    known = {"table_speed", "pressure_difference", "pressure_sum"}
    assert variables_at(plant, "table") == known | {"table_angle"}
    assert variables_at(plant, "hydromotor") >= {"table_speed", "pressure_difference"}
    read = run_of(plant.roles, table_angle=RAMP, p_in=RAMP + 9.0, p_out=RAMP + 4.0)
    found = variables_of(read)
    assert known < found.keys()
    assert found["pressure_difference"] == pytest.approx(-5.0)


def test_a_cylinders_chambers_are_looked_at_before_a_pumps_lines() -> None:
    roles = get_plant("eha_knee").roles
    assert roles.facing == roles.pair == ("pressure_a", "pressure_b")


def angle_of(current: FloatArray) -> FloatArray:
    """Return the angle of a spindle that turns against air, k w |w|, by its own equation."""
    angle, speed, out = 0.0, 0.0, np.empty(current.size)
    for at, asked in enumerate(current):
        out[at] = angle
        for _ in range(STEPS):
            torque = 0.13 * asked - 0.004 * speed - DRAG * speed * abs(speed)
            speed += TICK / STEPS * torque / 9e-4
            angle += TICK / STEPS * speed
    return out


def searched(folder: Path, noise: float) -> Search:
    """Log the angle alone, and find what the declared model leaves."""
    (folder / "plant.yaml").write_text(SPINDLE, encoding="utf-8")
    generator = np.random.default_rng(3)
    text = "model: plant.yaml\ninputs: [current_command]\nruns:\n"
    for number in range(2):
        current = np.repeat(generator.uniform(-8.0, 8.0, 120), 20)
        angle = angle_of(current) + noise * generator.standard_normal(current.size)
        columns = {"current_command": current, "shaft_turn": angle}
        write(folder / f"{number}.mcap", Recording(TICK * np.arange(current.size), columns))
        text += f"  - {{log: {number}.mcap}}\n"
    (folder / "dataset.yaml").write_text(text, encoding="utf-8")
    return begin(calibrated_baseline(load_dataset(folder / "dataset.yaml")))


def test_a_drag_follows_the_slope_of_the_angle_and_the_curve_is_the_drag(tmp_path: Path) -> None:
    search = searched(tmp_path, 1e-4)
    found = remainder(search, [], COARSE, no_progress)
    assert found is not None
    assert (found.equation, found.at, found.variable) == ("torque", "shaft", "shaft_speed")
    assert found.explained > 0.9
    assert "a curve of shaft_speed (derivative of shaft_turn) explains" in found.note
    assert found.to_dict()["derived"] == {"shaft_speed": "shaft_turn"}
    locator, _, curves = locate(search.problem, search.fit, COARSE, no_progress)
    assert curves[0].template.variable == "shaft_speed"
    low, high = curves[0].knots[[0, -1]]
    runs = {id(own.measured): own.measured for own in search.problem.windows}.values()
    ran = np.concatenate([np.diff(angle_of(own.inputs["current_command"])) / TICK for own in runs])
    assert low == pytest.approx(ran.min(), rel=0.1)
    assert high == pytest.approx(ran.max(), rel=0.1)
    _, fit = learn(search.problem, locator.short, search.fit, curves[0], COARSE)
    layout = search.problem.plant.layout
    at = layout.index["learned.values"]
    learned = fit.vector[at : at + layout.by_key["learned.values"].size]
    speeds = np.linspace(low, high, learned.size)
    inertia = fit.vector[layout.index["shaft.inertia"]] / 9e-4
    drag = -DRAG * speeds * np.abs(speeds)
    assert inertia == pytest.approx(1.0, abs=0.03)
    # neighbours are told by their mean; the ends are hardly visited
    error = np.convolve(learned - drag, [0.5, 0.5], mode="valid")[:-2]
    assert np.abs(error).max() < 0.06 * np.abs(drag).max()


def test_a_slope_within_its_noise_is_not_followed(tmp_path: Path) -> None:
    """Half a radian's noise at 500 Hz: 20 ms either way leave 12 rad/s of some 35."""
    search = searched(tmp_path, 0.5)
    locator, _, curves = locate(search.problem, search.fit, COARSE, no_progress)
    assert not locator.curves.varies("shaft_speed")
    assert "shaft_speed" not in {item.template.variable for item in curves}


def turned(model: Model, at: Path, seed: int) -> None:
    """Log what a turntable does as its valve opens and closes."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, 3.0, 2.5e-3)
    tones = [np.sin(2.0 * np.pi * (f * time + generator.random())) for f in (0.35, 0.8, 1.7, 3.1)]
    command = 0.9 * np.sum(tones, axis=0)
    initial = {"table_angle": 0.0, "p_in": 60e5, "p_out": 60e5}
    read = model.plant.simulate(
        model.vector(), Drive(time, {"valve_command": command}, initial), 2.5e-4
    )
    read = read[:, :3] + generator.standard_normal((time.size, 3)) * [2e-4, 1e4, 1e4]
    columns = dict(zip(model.plant.outputs, read.T, strict=False))
    write(at, Recording(time, {"valve_command": command, **columns}))


@pytest.mark.slow(5)
@pytest.mark.parametrize(("variable", "most"), [("table_speed", 3.0), ("table_angle", 0.8)])
def test_a_turntable_tells_speed_and_angle_apart(
    tmp_path: Path, variable: str, most: float
) -> None:
    """What follows the angle is not said to follow a speed because that is there."""
    (tmp_path / "plant.yaml").write_text(MOTOR, encoding="utf-8")
    declared = load_model(tmp_path / "plant.yaml")
    at = np.linspace(-most, most, KNOTS)
    law = -1.5 * at * np.abs(at) / most**2 if variable == "table_speed" else 1.5 * np.cos(5.0 * at)
    hidden = {"scale": 1.0, "form": "additive", "variable": variable, "low": -most, "high": most,
              "at": "table", "values": law.tolist()}  # fmt: skip
    text = "model: plant.yaml\ninputs: [valve_command]\nruns:\n"
    for number in range(2):
        turned(declared.with_effect(DeclaredEffect("learned", hidden)),
               tmp_path / f"{number}.mcap", number)  # fmt: skip
        text += f"  - {{log: {number}.mcap}}\n"
    (tmp_path / "dataset.yaml").write_text(text, encoding="utf-8")
    search = begin(calibrated_baseline(load_dataset(tmp_path / "dataset.yaml")))
    _, equation, curves = locate(search.problem, search.fit, COARSE, no_progress)
    told = curves[0].template
    assert (equation, told.place, told.variable) == ("torque", "table", variable)
    assert curves[0].share > 0.5


def test_it_is_named_with_what_it_is_the_derivative_of() -> None:
    found = Unknown("torque", ("table_speed", "time"), derived={"table_speed": "table_angle"})
    assert found.in_words == ("table_speed (derivative of table_angle)", "time")
    left = Remainder(0.3, "torque", "shaft", "motor_speed", 0.9)
    assert left.follows == "motor_speed"
    assert left.to_dict()["derived"] == {}
