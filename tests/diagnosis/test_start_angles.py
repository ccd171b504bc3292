"""Runs that begin at different angles: found where they do, left alone where they do not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.start_angle import KNOWN, StartAngle
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.candidates import Start, effect_starts
from eha_bench.diagnosis.fit.evidence import groups_of
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.start_angles import (
    angles_of,
    begin_apart,
    estimated_angles,
    own_angles,
    starts_of,
    with_refined_angles,
)
from eha_bench.diagnosis.fit.uncertainty import spreads
from eha_bench.diagnosis.replay.first_sample import first_state
from eha_bench.diagnosis.replay.prediction import _anchors, predict, simulate_from
from eha_bench.diagnosis.search.periodic import Form, Wave, best_counts, scan
from eha_bench.diagnosis.search.refit import Near
from eha_bench.diagnosis.search.start_angles import with_own_angles
from eha_bench.diagnosis.search.state import Search, begin
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.plant import Drive

NOISE = {"current": 0.05, "motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}
COUNT, PHASE, AMPLITUDE = 7, 0.8, 0.02
ANGLES = {"one": 0.0, "two": 0.3, "three": -0.25}
PULL = {"amplitude": AMPLITUDE, "count": float(COUNT), "phase": PHASE}
TRUTH = Model("eha_knee", {}, (), (DeclaredEffect("cogging_torque", PULL),))


def turning(angles: dict[str, float], seed: int = 1, mean: float = 0.0) -> list[Measured]:
    """Shafts that turn with the bypass open while their magnets pull, each from its own angle.

    They swing about rest, or with a mean current in A turn one way.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 0.8, 1e-3)
    found = []
    for number, (name, angle) in enumerate(angles.items()):
        command = mean + (3.5 - 0.3 * number) * np.sin(2 * np.pi * (1.25 + 0.4 * number) * time)
        start = {"shaft_angle": angle}
        drive = Drive(time, {"current_command": command}, start, True, True)
        values = TRUTH.plant.simulate(TRUTH.vector(), drive, 2e-4)[:, :4]
        values += rng.standard_normal(values.shape) * list(NOISE.values())
        columns = dict(zip(NOISE, values.T, strict=True))
        reading = Recording(time, {"current_command": command, **columns})
        run = Run(name, Path(f"{name}.mcap"), None, True, True, Use.TRAIN, lambda r=reading: r)
        found.append(admit(run, reading, ["current_command"], TRUTH.plant.outputs))
    return found


def whole(runs: Sequence[Measured]) -> Problem:
    windows = [window_at(item, 0, item.time.size, NOISE) for item in runs]
    return Problem(TRUTH.plant, windows, NOISE, 2e-4)


def scanned(runs: Sequence[Measured]) -> list[Wave]:
    """What every count of cogging would gain, beside a friction that is fitted."""
    windows = [window_at(item, k, k + 100, NOISE) for item in runs for k in range(100, 800, 100)]
    problem = Problem(TRUTH.plant, windows, NOISE, 3.4e-4)
    vector = Model("eha_knee", {}).vector()
    problem.prepare(vector)
    layout = problem.plant.layout
    keys = ["viscous_torque", "coulomb_torque", "torque_constant"]
    free = free_parameters(layout, keys, vector)
    fit = levenberg_marquardt(problem, vector, free, iterations=2)
    starts = effect_starts(layout, layout.effect("cogging_torque"))
    few = [start for start in starts if dict(start.settings)[free_place(layout)] <= COUNT]
    return scan(problem, fit, layout, few)


def free_place(layout) -> int:
    return layout.index["cogging_torque.count"]


def searched(runs: Sequence[Measured]) -> tuple[Search, Near]:
    """A search that has calibrated two numbers, and its short windows."""
    problem = whole(runs)
    vector = Model("eha_knee", {}).vector()
    problem.prepare(vector)
    keys = ("viscous_torque", "coulomb_torque")
    free = free_parameters(problem.plant.layout, keys, vector)
    fit = levenberg_marquardt(problem, vector, free, iterations=2)
    dataset = Dataset(Model("eha_knee", {}), ("current_command",), tuple(r.run for r in runs))
    search = begin(Baseline(dataset, tuple(runs), problem, fit, keys, (), 0.0))
    return search, Near.of(search, problem)


def cogging(search: Search) -> list[Start]:
    layout = search.problem.plant.layout
    starts = effect_starts(layout, layout.effect("cogging_torque"))
    return [start for start in starts if dict(start.settings)[free_place(layout)] <= COUNT]


def off(angle: float, true: float) -> float:
    """How far an angle is from the true one, in rad of phase."""
    return abs(math.remainder(COUNT * (angle - true), 2.0 * math.pi))


def test_phases_of_their_own_show_the_count_and_the_angles() -> None:
    waves = scanned(turning(ANGLES))
    best = max(waves, key=lambda wave: wave.with_lead_angles(wave.lead_angles()).gain)
    assert best.count == COUNT
    apart = best.with_lead_angles(best.lead_angles())
    common = max(wave.gain for wave in waves)
    assert begin_apart(common, apart.gain, 2, tries=len(waves))
    for name, turn in best.lead_angles().items():
        assert off(turn, ANGLES[name]) < 0.3
    assert apart.start.strength == pytest.approx(AMPLITUDE, rel=0.2)


def test_runs_that_begin_alike_keep_one_phase() -> None:
    waves = scanned(turning(dict.fromkeys(ANGLES, 0.0)))
    common = max(waves, key=lambda wave: wave.gain)
    apart = max(wave.with_lead_angles(wave.lead_angles()).gain for wave in waves)
    assert common.count == COUNT
    assert not begin_apart(common.gain, apart, 2, tries=len(waves))
    assert best_counts(waves)[0] is common.start


def test_a_search_begins_apart_also_a_run_that_had_no_say() -> None:
    search, near = searched(turning(ANGLES))
    windows = [k for k, w in enumerate(near.problem.windows) if w.measured.run.name != "three"]
    near.problem = near.problem.subset(windows)
    near.fit = levenberg_marquardt(near.problem, near.fit.vector, near.fit.free, iterations=1)
    before = search.problem.residual(search.fit.vector)
    found = with_own_angles(search, near, cogging(search))
    assert found is not near
    assert Near.of(search, search.problem) is found
    angles = angles_of(search.problem)
    assert angles["one"] == 0.0
    for name, angle in angles.items():
        assert off(angle, ANGLES[name]) < 0.3
    # nothing turns yet, so nothing has changed
    assert np.array_equal(search.problem.residual(search.fit.vector), before)
    best = found.refit_periodic(cogging(search))[0]
    assert best.fit.values()["cogging_torque.amplitude"] == pytest.approx(AMPLITUDE, rel=0.1)


def test_a_search_whose_runs_begin_alike_stays_as_it_is() -> None:
    search, near = searched(turning(dict.fromkeys(ANGLES, 0.0)))
    problem = search.problem
    assert with_own_angles(search, near, cogging(search)) is near
    assert search.problem is problem


def test_a_wave_begun_where_it_was_scanned_gains_the_same() -> None:
    for wave in scanned(turning(ANGLES)):
        assert wave.with_lead_angles({}).gain == pytest.approx(wave.gain, rel=1e-9)
        assert wave.with_lead_angles({}).start.strength == pytest.approx(
            wave.start.strength, rel=1e-9
        )


def test_chance_alone_hardly_ever_sets_runs_apart() -> None:
    """Six runs, forty counts, nothing or one common phase in the noise: 1600 draws of each."""
    rng = np.random.default_rng(7)
    layout = TRUTH.plant.layout
    template = effect_starts(layout, layout.effect("cogging_torque"))[0]
    form = Form(template, free_place(layout), layout.index["cogging_torque.phase"])
    names = tuple("aabbccddeeff")
    normal = np.kron(np.diag([400.0, 900.0, 30.0, 100.0, 250.0, 5.0] * 2), np.eye(2))
    turns = np.tile(np.eye(2), (12, 1))

    def drawn(pair: np.ndarray) -> Wave:
        right = -normal @ np.tile(pair, 12) + np.sqrt(np.diag(normal)) * rng.standard_normal(24)
        best = form.best(9.0, turns.T @ normal @ turns, turns.T @ right)
        return Wave(form, 9.0, *best, names, normal, right)

    for size in (0.0, 0.5):
        told = 0
        for _ in range(40):
            waves = [drawn(np.array([size * (number == 0), 0.0])) for number in range(40)]
            apart = max(wave.with_lead_angles(wave.lead_angles()).gain for wave in waves)
            common = max(wave.gain for wave in waves)
            told += begin_apart(common, apart, 5, tries=len(waves))
        assert told <= 1


def test_angles_are_estimated_from_the_runs_themselves() -> None:
    found = own_angles(whole(turning(ANGLES)), TRUTH.vector())
    assert list(found) == list(ANGLES)
    for name, start in found.items():
        assert off(start.value, ANGLES[name]) < 0.1
        assert start.is_estimated


def test_nothing_is_estimated_where_runs_begin_at_zero_or_nothing_turns() -> None:
    alike = whole(turning(dict.fromkeys(ANGLES, 0.0)))
    assert own_angles(alike, TRUTH.vector()) == {}
    assert own_angles(whole(turning(ANGLES)), Model("eha_knee", {}).vector()) == {}
    assert estimated_angles(alike, Model("eha_knee", {}).vector()) == {}
    assert with_refined_angles(alike, TRUTH.vector()) is alike


def test_what_does_not_turn_does_not_see_where_a_run_begins() -> None:
    problem = whole(turning(ANGLES))
    plain = Model("eha_knee", {}).vector()
    begun = problem.at_angles({"two": StartAngle(1.0, 0.1)})
    assert np.array_equal(begun.residual(plain), problem.residual(plain))
    assert not np.array_equal(begun.residual(TRUTH.vector()), problem.residual(TRUTH.vector()))
    assert starts_of(begun) == {"two": StartAngle(1.0, 0.1)}
    assert begun.windows[1].initial["shaft_angle"] == 1.0
    assert begun.windows[0].measured.start == KNOWN


def test_a_prediction_begins_where_the_run_shows_it() -> None:
    """One number is estimated; where the run begins at zero the prediction is the plain one."""
    runs = [item.run for item in turning(ANGLES)]
    found = predict(Dataset(TRUTH, ("current_command",), tuple(runs)))
    for run, prediction in zip(runs, found, strict=True):
        error = prediction.values["motor_speed"] - run.read()["motor_speed"]
        assert np.sqrt(np.mean(error**2)) < 1.1 * NOISE["motor_speed"]
    zero = StartAngle()
    plain = TRUTH.plant.simulate(
        TRUTH.vector(), turning(ANGLES)[0].at_angles({"one": zero}).drive(0, 800, {}), 1e-4
    )
    first = TRUTH.plant.outputs.index("motor_speed")
    assert np.allclose(found[0].values["motor_speed"], plain[:, first], atol=1e-2)


@pytest.mark.slow
def test_the_interval_holds_though_the_angles_are_estimated() -> None:
    """Shafts that keep turning, angles that are a little off at first; forty sets of noise."""
    layout = TRUTH.plant.layout
    keys = ["cogging_torque.amplitude", "cogging_torque.phase"]
    at = {key: layout.index[key] for key in keys}
    held = dict.fromkeys(keys, 0)
    for seed in range(40):
        vector = TRUTH.vector()
        vector[at[keys[0]]] *= 0.9
        began = {"two": StartAngle(0.33, 1 / COUNT), "three": StartAngle(-0.28, 1 / COUNT)}
        problem = with_refined_angles(
            whole(turning(ANGLES, seed, mean=5.0)).at_angles(began), vector
        )
        problem.prepare(vector)
        free = free_parameters(layout, keys, vector)
        fit = levenberg_marquardt(problem, vector, free, iterations=4, tolerance=0.1)
        found = spreads(fit, groups_of(problem))
        for key in keys:
            error = fit.vector[at[key]] - TRUTH.vector()[at[key]]
            held[key] += bool(abs(error) < found[key].half_width)
    # of intervals of 95 % fewer hold once in a thousand
    assert min(held.values()) >= 33


def long_turn(seconds: float = 6.0) -> Measured:
    """A shaft that turns one way for long while its magnets pull."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, seconds, 1e-3)
    command = 3.0 + np.sin(2 * np.pi * 0.5 * time)
    drive = Drive(time, {"current_command": command}, {"shaft_angle": 0.0}, True, True)
    values = TRUTH.plant.simulate(TRUTH.vector(), drive, 2e-4)[:, :4]
    values += rng.standard_normal(values.shape) * list(NOISE.values())
    columns = dict(zip(NOISE, values.T, strict=True))
    reading = Recording(time, {"current_command": command, **columns})
    run = Run("long", Path("long.mcap"), None, True, True, Use.TRAIN, lambda: reading)
    return admit(run, reading, ["current_command"], TRUTH.plant.outputs)


def test_a_long_replay_keeps_the_phase_that_the_measured_speed_adds_up_to() -> None:
    """A model that is a hundredth off would be turns away after seconds, and a ripple with it."""
    measured = long_turn()
    off = {
        "viscous_torque": 1.01 * float(TRUTH.vector()[TRUTH.plant.layout.index["viscous_torque"]])
    }
    pulls, smooth = (
        Model("eha_knee", off, (), effects) for effects in (TRUTH.effects, ())
    )  # fmt: skip
    start = first_state(measured, pulls)

    def error(model: Model, run: Measured = measured) -> float:
        at = model.plant.outputs.index("motor_speed")
        speed = simulate_from(run, model, start, 2e-4)[:, at]
        left = measured.column("motor_speed") - speed
        return float(np.std(left[3000:] - np.convolve(left, np.ones(200) / 200, "same")[3000:]))

    deaf = replace(measured, roles=replace(measured.roles, turning={}))
    assert error(pulls, deaf) > error(smooth)
    assert error(pulls) < 1.05 * NOISE["motor_speed"]


def test_anchors_that_say_what_the_plant_does_change_nothing() -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    plant, vector = TRUTH.plant, TRUTH.vector()
    command = {"current_command": 3.0 * np.sin(9.0 * time)}
    start = {"shaft_angle": 0.4}
    free = plant.simulate(vector, Drive(time, command, start, True, True), 1e-4)
    speed = free[:, plant.outputs.index("motor_speed")]
    angle = 0.4 + np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    anchored = Drive(time, command, start, True, True, anchors={"shaft_angle": angle})
    assert plant.simulate(vector, anchored, 1e-4) == pytest.approx(free, rel=1e-4, abs=1e-3)
    other = Drive(time, command, start, True, True, anchors={"shaft_angle": angle + 0.5})
    apart = plant.simulate(vector, other, 1e-4)[:, plant.outputs.index("motor_speed")] - speed
    assert np.abs(apart[:11]).max() < 1e-9
    assert np.abs(apart).max() > 1.0


SPRUNG = """\
plant: sprung_shaft
nodes:
  shaft: {kind: rotation, inertia: 1e-4 kg*m^2}
  arm:   {kind: rotation}
elements:
  motor:  {kind: motor, on: shaft, torque_constant: 0.05 N*m/A}
  gear:   {kind: gear, from: shaft, to: arm, ratio: -5}
  drag:   {kind: friction, on: shaft, viscous: 1e-3 N*m*s/rad}
SPRING
inputs:   {current: motor.current}
channels: {motor_speed: shaft.speed}
"""
SPRING = "  spring: {kind: spring, on: arm, stiffness: 0.5 N*m/rad}"


def replayed(folder: Path, spring: str, dead: float = np.inf) -> tuple[Measured, Model]:
    """A shaft read as a speed behind a gear, on a spring or not, with next to no ripple."""
    path = folder / "plant.yaml"
    path.write_text(SPRUNG.replace("SPRING", spring))
    pull = DeclaredEffect("cogging_torque", {"amplitude": 1e-6, "count": 6.0})
    model = replace(load_model(path), effects=(pull,))
    time = np.arange(0.0, 4.0, 2e-3)
    current = 0.3 * np.sin(3.0 * time)
    at = model.plant.outputs.index("motor_speed")
    speed = model.plant.simulate(model.vector(), Drive(time, {"current": current}), 1e-4)[:, at]
    speed += 1e-3 * np.random.default_rng(2).standard_normal(time.size)
    speed[time > dead] = np.nan
    reading = Recording(time, {"current": current, "motor_speed": speed})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    roles = model.plant.roles
    return admit(run, reading, ["current"], model.plant.outputs, roles=roles), model


def test_an_angle_is_known_by_a_speed_behind_a_gear(tmp_path: Path) -> None:
    measured, model = replayed(tmp_path, "")
    assert measured.turning == ("motor_speed", "arm_angle", -5.0)
    turned = -np.cumsum(measured.column("motor_speed")) * 2e-3 / 5.0
    assert measured.shaft_angle == pytest.approx(turned, abs=5e-3)
    assert [*_anchors(measured, model, first_state(measured, model), 2e-4)] == ["arm_angle"]


def test_an_angle_that_a_spring_follows_as_well_is_simulated(tmp_path: Path) -> None:
    measured, model = replayed(tmp_path, SPRING)
    assert measured.turning is not None
    assert _anchors(measured, model, first_state(measured, model), 2e-4) == {}


def test_an_angle_is_not_known_after_its_speed_was_not_read_for_long(tmp_path: Path) -> None:
    measured, _ = replayed(tmp_path, "", dead=1.5)
    known = np.isfinite(measured.known_shaft_angle)
    assert known[measured.time < 1.49].all()
    assert not known[measured.time > 1.51].any()
