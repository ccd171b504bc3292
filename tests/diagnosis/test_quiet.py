"""Quiet stretches: where nothing moves, readings are constants and noise, whatever the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.quiet import (
    _forgets,
    _swings,
    coloured_like,
    quiet_stretches,
    with_colours,
    with_noise_colour,
)
from eha_bench.diagnosis.data.windows import cut_windows, window_at
from eha_bench.diagnosis.fit.baseline import _noise_notes
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

SIGMA = {
    "current": 0.05,
    "motor_speed": 0.1,
    "pressure_a": 3e4,
    "pressure_b": 3e4,
    "piston_position": 4e-6,
    "piston_velocity": 1e-3,
}
A = 0.7
STEP = 2e-4


@pytest.fixture(scope="module")
def model():
    return load_model(shipped_file("models/physical.yaml"))


def _run(model, command, *, filtered: tuple[str, ...], seed: int = 0):
    """A locked run with noise, that of some sensors behind a low-pass filter."""
    time = np.arange(command.size) * 1e-3
    start = {"pressure_a": 6e5, "pressure_b": 6e5}
    drive = Drive(time, {"current_command": command}, start, locked=True)
    out = model.plant.simulate(model.vector(), drive, STEP)
    generator = np.random.default_rng(seed)
    values = {}
    for at, (name, sigma) in enumerate(SIGMA.items()):
        noise = generator.standard_normal(time.size)
        if name in filtered:
            noise[1:] *= np.sqrt(1.0 - A * A)
            noise = lfilter([1.0], [1.0, -A], noise)
        values[name] = out[:, at] + sigma * noise
    reading = Recording(time, {"current_command": command, **values})
    run = Run(f"log{seed}", Path("log.mcap"), None, True, False, Use.TRAIN, lambda: reading)
    return admit(run, reading, ["current_command"], model.plant.outputs)


def _steps() -> np.ndarray:
    """A while of nothing, two steps, and nothing again for long."""
    command = np.zeros(2500)
    command[700:900] = 12.0
    command[900:1100] = 6.0
    return command


def test_quiet_is_before_anything_was_asked_for(model) -> None:
    measured = _run(model, _steps(), filtered=())
    before = [*quiet_stretches(measured)]
    assert len(before) >= 3
    # what the lock holds is noise as well
    assert set(before[0]) == set(SIGMA)
    assert before[0]["motor_speed"] == pytest.approx(measured.values[:128, 1])


@pytest.mark.slow
def test_a_sensor_that_remembers_is_told_and_no_other(model) -> None:
    runs = [_run(model, _steps(), filtered=("pressure_a", "piston_velocity"), seed=k)
            for k in range(2)]  # fmt: skip
    found = with_noise_colour(runs)
    assert set(found[0].colours) == {"pressure_a", "piston_velocity"}
    for colour in found[0].colours.values():
        assert colour.correlations(2)[1] == pytest.approx(A, abs=0.15)


def test_noise_that_is_white_is_left_alone(model) -> None:
    runs = [_run(model, _steps(), filtered=(), seed=k) for k in range(2)]
    assert all(after is before for after, before in zip(with_noise_colour(runs), runs, strict=True))


def test_where_all_moves_nothing_is_told(model) -> None:
    time = np.arange(2500) * 1e-3
    runs = [_run(model, 8.0 + 6.0 * np.sin(2 * np.pi * 3.0 * time), filtered=tuple(SIGMA))]
    assert not [*quiet_stretches(runs[0])]
    assert with_noise_colour(runs)[0] is runs[0]


@pytest.mark.slow
def test_the_right_model_leaves_white_noise_behind_filters(model) -> None:
    runs = [_run(model, _steps(), filtered=tuple(SIGMA), seed=k) for k in range(2)]
    noise = {name: sigma for name, sigma in SIGMA.items() if not name.startswith("piston")}

    def left(measured):
        windows = [window for item in measured for window in cut_windows(item, noise)]
        problem = Problem(model.plant, windows, noise, STEP)
        problem.prepare(model.vector())
        residual = problem.residual(model.vector())
        blocks = [
            residual[piece.rows][piece.channels == channel][:2496].reshape(-1, 32).mean(axis=1)
            for piece in problem.pieces
            for channel in range(4)
        ]
        reading = problem.with_best_start(model.vector())
        return np.mean(residual**2), 32.0 * np.mean(np.square(blocks)), np.mean(reading**2)

    square, slow, reading = left(runs)
    assert square == pytest.approx(1.0, abs=0.05)
    # without its colour noise that is slow is five times what white noise makes
    assert slow > 3.0
    square, slow, reading = left(with_noise_colour(runs))
    assert square == pytest.approx(1.0, abs=0.05)
    assert slow == pytest.approx(1.0, abs=0.25)
    # errors by channel are those of readings, not of what is new in them
    assert reading == pytest.approx(1.0, abs=0.05)


def _readings(inputs: dict, outputs: dict, *, seconds_a_sample: float = 1e-3, name: str = "log"):
    """A run of a bypassed plant from nothing but its readings."""
    count = next(iter(inputs.values())).size
    reading = Recording(np.arange(count) * seconds_a_sample, {**inputs, **outputs})
    run = Run(name, Path("log.mcap"), None, False, True, Use.TRAIN, lambda: reading)
    return admit(run, reading, [*inputs], [*outputs])


def _remembering(generator, count: int, a: float = A) -> np.ndarray:
    white = generator.standard_normal(count)
    white[1:] *= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], white)


def test_steady_rotation_is_no_rest() -> None:
    time = np.arange(1500) * 1e-3
    generator = np.random.default_rng(0)
    ripple = np.sin(50.0 * 9.0 * time) + 0.1 * generator.standard_normal(time.size)
    pressure = 6e5 + 3e4 * ripple
    command = {"current_command": np.full(time.size, 5.0)}
    turning = _readings(command, {"motor_speed": 50.0 + ripple, "pressure_a": pressure})
    assert not [*quiet_stretches(turning)]
    noise = generator.standard_normal((2, time.size))
    resting = _readings(command, {"motor_speed": noise[0], "pressure_a": 6e5 + 3e4 * noise[1]})
    assert len([*quiet_stretches(resting)]) == 11
    # the measured speed may be what drives the model
    driving = _readings({"motor_speed": 50.0 + ripple}, {"pressure_a": pressure})
    assert driving.input_noise
    assert not [*quiet_stretches(driving)]


def test_where_no_speed_is_read_only_what_is_not_driven_rests() -> None:
    pressure = 6e5 + 3e4 * np.random.default_rng(0).standard_normal(1500)
    command = np.zeros(1500)
    command[700:] = 5.0
    measured = _readings({"current_command": command}, {"pressure_a": pressure})
    assert len([*quiet_stretches(measured)]) == 5


@pytest.mark.parametrize("kept", [0.0, 0.9])
def test_a_motion_that_ends_within_a_stretch_is_no_rest(kept: float) -> None:
    generator = np.random.default_rng(3)
    pressure = 6e5 + 3e4 * _remembering(generator, 1500, kept)
    measured = _readings({"current_command": np.zeros(1500)}, {"pressure_a": pressure})
    rests = len([*quiet_stretches(measured)])
    assert rests >= 10
    # a chamber that was empty fills up within ten samples: far off a parabola, and no noise
    pressure[:10] -= 2e7 * np.exp(-0.5 * np.arange(10))
    filling = _readings({"current_command": np.zeros(1500)}, {"pressure_a": pressure})
    assert len([*quiet_stretches(filling)]) == rests - 1


@pytest.mark.parametrize("value", [0.1, 293.15, 6e5, -0.0123])
def test_a_reading_that_never_changes_stands(value) -> None:
    command = np.zeros(1500)
    command[1490:] = 1.0
    speed = 0.1 * np.random.default_rng(0).standard_normal(1500)
    pressure = np.full(1500, value)
    pressure[1490:] += 1.0
    measured = _readings(
        {"current_command": command}, {"motor_speed": speed, "pressure_a": pressure}
    )
    assert len([*quiet_stretches(replace(measured, valid=np.ones_like(measured.valid)))]) == 11


def test_each_sampling_period_has_its_own_colour() -> None:
    generator = np.random.default_rng(5)

    def run(period: float, a: float):
        # a clock's median step is never quite the same
        return _readings(
            {"current_command": np.zeros(1500)},
            {"motor_speed": 0.1 * _remembering(generator, 1500, a)},
            seconds_a_sample=period * generator.uniform(0.999, 1.001),
        )

    slow, fast, still = run(2e-3, 0.0), run(1e-3, A), run(2e-3, 0.0)
    found = with_noise_colour([slow, fast, still])
    assert found[0] is slow
    assert found[2] is still
    assert found[1].colours["motor_speed"].correlations(2)[1] == pytest.approx(A, abs=0.1)
    assert set(coloured_like(run(1e-3, A), found).colours) == {"motor_speed"}
    assert not coloured_like(run(2e-3, 0.0), found).colours


def test_a_run_too_short_for_its_colour_keeps_its_level() -> None:
    measured = _readings(
        {"motor_speed": np.random.default_rng(0).standard_normal(12)},
        {"pressure_a": np.random.default_rng(1).standard_normal(12)},
    )
    after = with_colours(measured, {"motor_speed": Colour((0.5, 0.1, 0.1))})
    assert after.input_noise == measured.input_noise
    assert after.input_noise["motor_speed"] > 0.0


def test_every_run_says_its_input_noise() -> None:
    pressure = np.random.default_rng(1).standard_normal(300)
    quiet = _readings({"motor_speed": np.zeros(300)}, {"pressure_a": pressure})
    noisy = _readings({"motor_speed": np.sin(pressure)}, {"pressure_a": pressure})
    assert not quiet.input_noise
    level = f"{noisy.input_noise['motor_speed']:.2g} rad/s"
    assert [level in note for note in _noise_notes([quiet, noisy], {})] == [True]
    # a plant's own input has the unit that the plant gives it
    assert "rpm" in next(iter(_noise_notes([noisy], {"motor_speed": "rpm"})))


@pytest.mark.parametrize(("a", "factor"), [(0.0, 1.0), (A, np.sqrt((1 + A) / (1 - A)))])
def test_what_noise_adds_up_to_at_a_start_is_that_of_its_colour(a, factor) -> None:
    generator = np.random.default_rng(2)
    measured = _readings(
        {"current_command": np.zeros(1500)},
        {"motor_speed": 0.1 * _remembering(generator, 1500), "pressure_a": pressure_of(generator)},
    )
    if a:
        colours = {"motor_speed": Colour((a,)), "pressure_a": Colour((a,))}
        measured = with_colours(measured, colours)
    noise = {"motor_speed": 0.1, "pressure_a": 1.0}
    later = window_at(measured, 1000, 1400, noise)
    assert later.spread["shaft_angle"] == pytest.approx(factor * 0.1 * np.sqrt(1e-3), rel=0.01)
    first = window_at(measured, 0, 400, noise)
    assert first.spread["pressure_a"] == pytest.approx(3.0 * factor / np.sqrt(200), rel=0.01)


def pressure_of(generator) -> np.ndarray:
    return generator.uniform(-1.0, 1.0, 1500)


def test_an_oscillation_is_no_rest() -> None:
    """A chirp about a standing mean: each reading is a constant, and what is beside a parabola."""
    generator = np.random.default_rng(0)
    time = np.arange(128) * 1e-3
    swing = np.sin(2.0 * np.pi * 12.0 * time)
    late = np.sin(2.0 * np.pi * 12.0 * (time - 0.02))
    pressure = 4e6 + 6e5 * late + 1e4 * generator.standard_normal(128)
    assert _swings({"motor_speed": 30.0 * swing, "pressure_b": pressure})


@pytest.mark.parametrize("kept", [0.0, 0.7, 0.95, 0.99])
def test_noise_that_remembers_is_no_oscillation(kept: float) -> None:
    """Of forty stretches of three sensors, hardly one is lost, however slow their noise."""
    generator = np.random.default_rng(1)
    found = 0
    for _ in range(40):
        noise = lfilter([1.0], [1.0, -kept], generator.standard_normal((3, 1128)))[:, 1000:]
        found += _swings({str(k): own for k, own in enumerate(noise)})
    assert found <= 4


def test_a_smooth_sensor_alone_does_not_swing() -> None:
    """Behind a filter of second order noise is smooth; another sensor's does not follow it."""
    generator = np.random.default_rng(2)
    found = 0
    for _ in range(40):
        smooth = lfilter([1.0], [1.0, -1.9, 0.905], generator.standard_normal(1128))[1000:]
        other = lfilter([1.0], [1.0, -0.9], generator.standard_normal(1128))[1000:]
        found += _swings({"pressure_a": smooth, "pressure_b": other})
    assert found <= 10


@pytest.mark.parametrize(("partial", "forgets"), [(0.9, True), (0.97, False), (0.99, False)])
def test_what_is_not_forgotten_within_half_a_stretch_is_a_motion(
    partial: float, forgets: bool
) -> None:
    """An arm that creeps by a step of its encoder now and then is not a sensor that remembers."""
    assert _forgets(Colour((partial,)), 32) is forgets
