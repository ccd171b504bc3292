"""Replays of whole runs from the start that fits best, where one sample decides on the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.replay.replay import replay
from eha_bench.plants.model import Model
from eha_bench.plants.plant import Drive

NOISE = {"angle": 5e-3, "velocity": 2e-2}
TIME = np.arange(4000) * 1e-3


def read(
    model: Model, drive: Drive, seed: int
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What goes on in a servo, and what its sensors read of it."""
    values = model.plant.simulate(model.vector(), drive, 5e-5)
    outputs = dict(zip(model.plant.outputs, values.T, strict=True))
    generator = np.random.default_rng(seed)
    columns = {
        name: outputs[name] + size * generator.standard_normal(TIME.size)
        for name, size in NOISE.items()
    }
    return outputs, columns


def swinging() -> tuple[Model, Recording]:
    """A pendulum on a long gear that is let go near its upper rest, and swings over for seconds."""
    model = Model(
        "geared_servo",
        {
            "gear_friction.coulomb": 0.0,
            "gear_friction.viscous": 0.005,
            "motor.torque_constant": 1e-6,
            "pendulum.mass": 3.0,
        },
    )
    start = {"angle": np.pi - 0.011, "velocity": 0.0}
    drive = Drive(TIME, {"duty": np.zeros(TIME.size)}, start)
    outputs, columns = read(model, drive, 2)
    # the first sample is off by two standard deviations: the pendulum would fall much earlier
    columns["angle"][0] = outputs["angle"][0] - 2.0 * NOISE["angle"]
    columns["velocity"][0] = outputs["velocity"][0] - 1.5 * NOISE["velocity"]
    return model, Recording(TIME, {"duty": np.zeros(TIME.size), **columns})


def test_a_pendulum_near_its_upper_rest_is_replayed_from_where_it_began() -> None:
    model, recording = swinging()
    run = Run("one", Path("one.csv"), None, False, False, Use.TRAIN, lambda: recording)
    measured, _, _, _ = gather(Dataset(model, ("duty",), (run,)))
    (item,) = replay(measured, [model], NOISE)
    (before,), (after,) = item.prediction_errors("angle"), item.errors("angle")
    assert np.sqrt(np.mean(before**2)) > 50.0 * NOISE["angle"]
    assert np.sqrt(np.mean(after**2)) < 1.5 * NOISE["angle"]


def braking(lost: str) -> tuple[Model, list[Measured]]:
    """A servo that brakes from full speed as the log begins; one's first readings are lost."""
    model = Model("geared_servo", {"pendulum.mass": 0.0, "gear_friction.viscous": 0.5})
    start = {"angle": 0.3, "velocity": 8.0}
    _, columns = read(model, Drive(TIME, {"duty": np.zeros(TIME.size)}, start), 3)
    columns[lost][:20] = np.nan
    recording = Recording(TIME, {"duty": np.zeros(TIME.size), **columns})
    run = Run("one", Path("one.csv"), None, False, False, Use.TRAIN, lambda: recording)
    measured, _, _, _ = gather(Dataset(model, ("duty",), (run,)))
    return model, measured


def test_a_channel_that_is_first_read_in_motion_began_further_back() -> None:
    model, measured = braking("velocity")
    (item,) = replay(measured, [model], NOISE)
    (before,), (after,) = item.prediction_errors("angle"), item.errors("angle")
    late, best = (float(np.sqrt(np.nanmean(error**2))) for error in (before, after))
    assert late > 3.0 * NOISE["angle"]
    assert best < 1.2 * NOISE["angle"]


@pytest.mark.parametrize(("lost", "true"), [("angle", 0.3), ("velocity", 8.0)])
def test_a_window_begins_where_what_is_first_read_in_motion_comes_from(lost, true) -> None:
    _, measured = braking(lost)
    window = window_at(measured[0], 0, 400, NOISE)
    assert abs(window.initial[lost] - true) < window.spread[lost]
