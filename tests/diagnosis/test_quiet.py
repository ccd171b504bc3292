"""Quiet stretches: where nothing moves, readings are constants and noise, whatever the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.quiet import coloured, quiet_stretches
from eha_bench.diagnosis.data.windows import cut
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
    return load_model(shipped("models/physical.yaml"))


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


def test_a_sensor_that_remembers_is_told_and_no_other(model) -> None:
    runs = [_run(model, _steps(), filtered=("pressure_a", "piston_velocity"), seed=k)
            for k in range(2)]  # fmt: skip
    found = coloured(runs)
    assert set(found[0].colours) == {"pressure_a", "piston_velocity"}
    for colour in found[0].colours.values():
        assert colour.correlations(2)[1] == pytest.approx(A, abs=0.15)


def test_noise_that_is_white_is_left_alone(model) -> None:
    runs = [_run(model, _steps(), filtered=(), seed=k) for k in range(2)]
    assert all(after is before for after, before in zip(coloured(runs), runs, strict=True))


def test_where_all_moves_nothing_is_told(model) -> None:
    time = np.arange(2500) * 1e-3
    runs = [_run(model, 8.0 + 6.0 * np.sin(2 * np.pi * 3.0 * time), filtered=tuple(SIGMA))]
    assert not [*quiet_stretches(runs[0])]
    assert coloured(runs)[0] is runs[0]


def test_the_right_model_leaves_white_noise_behind_filters(model) -> None:
    runs = [_run(model, _steps(), filtered=tuple(SIGMA), seed=k) for k in range(2)]
    noise = {name: sigma for name, sigma in SIGMA.items() if not name.startswith("piston")}

    def left(measured):
        windows = [window for item in measured for window in cut(item, noise)]
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
    square, slow, reading = left(coloured(runs))
    assert square == pytest.approx(1.0, abs=0.05)
    assert slow == pytest.approx(1.0, abs=0.25)
    # errors by channel are those of readings, not of what is new in them
    assert reading == pytest.approx(1.0, abs=0.05)
