"""Measured inputs: their noise drives a simulation, and is not taken for something missing."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import toeplitz

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.noise import noise_of_input
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.evidence import refined_noise
from eha_bench.diagnosis.fit.input_noise import input_noise_of
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from imposed_plants import SEAL

SIGMA = {"current": 0.05, "motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}
STEP = 2e-4
LOUD = 3.0
"""An input's noise over that of the same sensor where it is compared."""


def by(response):
    """Return the residuals of a linear machine under several drives."""
    return lambda drives: [response @ drive.inputs["current"] for drive in drives]


@pytest.mark.parametrize("memory", [0.0, 0.02])
def test_the_cosines_make_what_white_noise_makes_of_an_integrator(memory) -> None:
    n, gain, sigma = 400, 0.3, 0.25
    index = np.arange(n)
    # what one sample's noise makes of all later ones
    response = gain * np.where(index[:, None] >= index, 1.0, 0.0)
    if memory:
        response *= np.exp(-np.abs(index[:, None] - index) * 1e-3 / memory)
    drive = Drive(index * 1e-3, {"current": np.zeros(n)})
    found = input_noise_of(drive, {"current": sigma}, {}, np.ones(1), by(response))
    exact = sigma**2 * response @ response.T
    made = found.columns @ found.columns.T
    # directions in which noise adds up are all there; what is missing is little beside 1
    assert np.linalg.norm(exact, 2) > 2.0
    assert np.linalg.norm(exact - made, 2) < 0.6
    assert np.trace(exact - made) < 0.05 * n
    assert found.simulations < 0.3 * n


def test_noise_that_remembers_is_made_as_it_is() -> None:
    n, a = 200, 0.7
    index = np.arange(n)
    response = 0.1 * np.where(index[:, None] >= index, 1.0, 0.0)
    drive = Drive(index * 1e-3, {"current": np.zeros(n)})
    found = input_noise_of(
        drive,
        {"current": 1.0},
        {"current": Colour((a,))},
        np.ones(1),
        by(response),
    )
    exact = response @ toeplitz(a**index) @ response.T
    made = found.columns @ found.columns.T
    assert np.linalg.norm(exact - made, 2) < 0.05 * np.linalg.norm(exact, 2)


def test_responses_hold_for_parameters_nearby() -> None:
    drive = Drive(np.arange(40) * 1e-3, {"current": np.zeros(40)})
    found = input_noise_of(drive, {"current": 1.0}, {}, np.array([2.0, 0.0]), by(np.eye(40)))
    assert found.is_near(np.array([2.05, 0.0]))
    assert not found.is_near(np.array([2.1, 0.0]))
    assert not found.is_near(np.array([2.0, 1e-6]))


def test_an_input_that_jumps_all_the_time_is_no_noisier() -> None:
    generator = np.random.default_rng(1)
    values = np.repeat(generator.choice([2.0, 14.0], 80), 50) + 0.05 * generator.normal(size=4000)
    assert noise_of_input(values) == pytest.approx(0.05, rel=0.12)


@pytest.fixture(scope="module")
def model():
    return load_model(shipped_file("models/physical.yaml"))


def _measured(model, driven_by: str, seed: int, *, locked: bool):
    """A run of which only the measured current, or the measured speed, drives the model."""
    time = np.arange(2000) * 1e-3
    command = 10.0 + 6.0 * np.sin(2 * np.pi * 3.0 * time)
    start = {"pressure_a": 6e5, "pressure_b": 6e5}
    out = model.plant.simulate(
        model.vector(), Drive(time, {"current_command": command}, start, locked=locked), STEP
    )
    generator = np.random.default_rng(seed)
    values = {
        name: out[:, at]
        + sigma * (LOUD if name == driven_by else 1.0) * generator.standard_normal(time.size)
        for at, (name, sigma) in enumerate(SIGMA.items())
    }
    reading = Recording(time, values)
    run = Run("log", Path("log.mcap"), None, locked, False, Use.TRAIN, lambda: reading)
    return admit(run, reading, [driven_by], model.plant.determined([driven_by]))


@pytest.mark.slow
@pytest.mark.parametrize("driven_by", ["current", "motor_speed"])
def test_the_right_model_leaves_noise_though_its_input_is_noisy(model, driven_by) -> None:
    noise = {name: sigma for name, sigma in SIGMA.items() if name != driven_by}
    squares = []
    for seed in range(2):
        measured = _measured(model, driven_by, seed, locked=True)
        assert measured.input_noise[driven_by] == pytest.approx(LOUD * SIGMA[driven_by], rel=0.1)
        windows = cut_windows(measured, noise)
        assert len(windows) > 2
        problem = Problem(model.plant, windows, noise, STEP)
        problem.prepare(model.vector())
        residual = problem.residual(model.vector())
        squares.append(np.mean(residual**2))
        # short windows of one run say together how noisy a channel is
        for name, level in refined_noise(problem, residual, noise).items():
            assert level == pytest.approx(noise[name], rel=0.06)
        # and without knowing of it
        exact = replace(measured, input_noise={})
        unaware = [replace(window, measured=exact) for window in windows]
        blind = Problem(model.plant, unaware, noise, STEP)
        blind.prepare(model.vector())
        assert np.mean(blind.residual(model.vector()) ** 2) > 1.08
    # of 4000 readings or more a mean square is known to 0.02
    assert np.mean(squares) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_is_too_fast_for_cosines_counts_as_white(tmp_path: Path, seed: int) -> None:
    # a load cell feels the noise of the carriage's position, and most what is fastest of it
    (tmp_path / "plant.yaml").write_text(SEAL)
    seal = load_model(tmp_path / "plant.yaml")
    time = np.arange(2000) * 2e-3
    carriage = 0.01 * np.sin(2.0 * np.pi * 0.5 * time)
    out = seal.plant.simulate(seal.vector(), Drive(time, {"carriage_position": carriage}, {}), STEP)
    generator = np.random.default_rng(seed)
    white = generator.standard_normal((2, time.size))
    noise = {"cell_force": 0.05}
    force = out[:, seal.plant.outputs.index("cell_force")] + noise["cell_force"] * white[0]
    reading = Recording(
        time, {"carriage_position": carriage + 2e-6 * white[1], "cell_force": force}
    )
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    measured = admit(run, reading, ["carriage_position"], ["cell_force"], roles=seal.plant.roles)
    assert measured.input_noise["carriage_position"] == pytest.approx(2e-6, rel=0.1)
    windows = cut_windows(measured, noise)
    problem = Problem(seal.plant, windows, noise, STEP)
    problem.prepare(seal.vector())
    assert np.mean(problem.residual(seal.vector()) ** 2) == pytest.approx(1.0, abs=0.15)
    # what is left of readings is more than that by the noise of which nothing was known
    unaware = [replace(item, measured=replace(measured, input_noise={})) for item in windows]
    blind = Problem(seal.plant, unaware, noise, STEP)
    blind.prepare(seal.vector())
    assert np.mean(blind.residual(seal.vector()) ** 2) > 4.0


def test_what_was_asked_for_is_exact(model) -> None:
    time = np.arange(500) * 1e-3
    values = {"current_command": np.random.default_rng(0).normal(size=500)}
    values["motor_speed"] = np.sin(time)
    reading = Recording(time, values)
    run = Run("log", Path("log.mcap"), None, True, False, Use.TRAIN, lambda: reading)
    measured = admit(run, reading, ["current_command"], model.plant.outputs)
    assert not measured.input_noise
    assert len(cut_windows(measured, {"motor_speed": 0.1})) == 1


@pytest.mark.slow
def test_other_noise_only_weighs_the_responses_anew(model) -> None:
    measured = _measured(model, "current", 0, locked=True)
    noise = {name: sigma for name, sigma in SIGMA.items() if name != "current"}
    problem = Problem(model.plant, cut_windows(measured, noise), noise, STEP)
    problem.prepare(model.vector())
    other = {name: 1.7 * sigma for name, sigma in noise.items()}
    kept = problem.with_noise(other)
    kept.prepare(model.vector())
    afresh = Problem(model.plant, problem.windows, other, STEP)
    afresh.prepare(model.vector())
    one, two = kept.residual(model.vector()), afresh.residual(model.vector())
    assert np.sum((one - two) ** 2) < 0.01 * one.size


def _locked(inputs: dict[str, np.ndarray]):
    """A locked run of ten seconds in which nothing moves."""
    time = np.arange(10000) * 1e-3
    pressure = 6e5 + 3e4 * np.random.default_rng(0).standard_normal(time.size)
    reading = Recording(time, {**inputs, "pressure_a": pressure})
    run = Run("log", Path("log.mcap"), None, True, False, Use.TRAIN, lambda: reading)
    return admit(run, reading, [*inputs], ["pressure_a"])


def test_a_run_that_stands_still_is_cut_where_its_input_is_noisy() -> None:
    noise = np.random.default_rng(1).standard_normal(10000)
    measured = _locked({"motor_speed": noise})
    speeds = replace(measured, valid=np.zeros_like(measured.valid))
    # nowhere may a window begin by itself, and none is long all the same
    windows = cut_windows(speeds, {"pressure_a": 3e4})
    assert len(windows) == 10
    assert windows[0].first == 0
    assert windows[-1].last == 10000
    assert all(one.last == two.first for one, two in pairwise(windows))


@pytest.mark.parametrize("name", ["oil_temperature", "force"])
def test_what_no_balance_adds_up_leaves_a_locked_run_whole(name) -> None:
    noise = np.random.default_rng(1).standard_normal(10000)
    measured = _locked({"current_command": np.zeros(10000), name: noise})
    assert measured.input_noise[name] > 0.0
    assert len(cut_windows(measured, {"pressure_a": 3e4})) == 1


@pytest.mark.parametrize("levels", [(-200.0, 0.0, 200.0), (0.0, 50.0, 100.0, 150.0)])
def test_levels_that_a_load_was_set_to_are_no_resolution(levels) -> None:
    values = np.repeat(np.random.default_rng(2).choice(levels, 40), 100)
    assert noise_of_input(values) == 0.0


def test_readings_that_flicker_between_few_steps_have_the_noise_of_a_step() -> None:
    values = np.round(0.4 * np.random.default_rng(3).standard_normal(4000))
    assert np.unique(values).size < 6
    assert noise_of_input(values) >= 1.0 / np.sqrt(12.0)
