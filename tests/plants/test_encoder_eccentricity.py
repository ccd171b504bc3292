"""An encoder that is not centred, or oval, errs once or more often in a turn of its joint."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.plants.effects.encoder_eccentricity import behind, reading, reading_speed
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

angles = st.floats(-6.3, 6.3)
waves = st.sampled_from([0.0, 1.0, 2.0, 3.0])
"""Places of once, twice, three and four times a turn."""


@given(angle=angles, phase=angles, eccentricity=st.floats(0.0, 0.2), often=waves)
def test_the_angle_behind_a_reading_is_the_one_that_was_read(
    angle: float, phase: float, eccentricity: float, often: float
) -> None:
    read = reading(angle, eccentricity, often, phase)
    assert behind(read, eccentricity, often, phase) == pytest.approx(angle, abs=1e-9)


@given(angle=angles, phase=angles, eccentricity=st.floats(0.0, 0.2), often=waves)
def test_the_speed_of_the_same_encoder_is_the_slope_of_its_reading(
    angle: float, phase: float, eccentricity: float, often: float
) -> None:
    step = 1e-5
    later, before = (reading(angle + k * step, eccentricity, often, phase) for k in (1, -1))
    speed = 3.0 * (later - before) / (2.0 * step)
    same = reading_speed(3.0, angle, eccentricity, often, phase, 0.0)
    assert same == pytest.approx(speed, rel=1e-6)
    assert reading_speed(3.0, angle, eccentricity, often, phase, 1.0) == 3.0


def test_a_hand_worked_error() -> None:
    # a disc of 10 mm radius that is 0.1 mm off its axis
    assert reading(1.0, 0.01, 0.0, math.pi / 2 - 1.0) == pytest.approx(1.01)
    # an oval one: a quarter of a turn further it errs by as much the other way
    assert reading(math.pi / 2, 0.01, 1.0, math.pi / 2) == pytest.approx(math.pi / 2 - 0.01)


@pytest.mark.slow(15)  # compiles a kernel
def test_only_the_sensors_of_a_servo_change() -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    inputs = {"duty": 0.3 * np.sin(9.0 * time), "supply_voltage": np.full(time.size, 12.0)}
    declared = {"eccentricity": 0.02, "waves": "twice", "phase": 0.7, "speed_sensor": "same"}
    models = (
        Model("geared_servo"),
        Model("geared_servo", {}, (), (DeclaredEffect("encoder_eccentricity", declared),)),
    )
    starts = {"angle": 0.4}, {"angle": reading(0.4, 0.02, 1.0, 0.7)}
    true, read = (
        model.plant.simulate(model.vector(), Drive(time, inputs, start), 1e-4)
        for model, start in zip(models, starts, strict=True)
    )
    names = list(models[0].plant.outputs)
    angle, speed = names.index("angle"), names.index("velocity")
    off = 0.02 * np.sin(2.0 * true[:, angle] + 0.7)
    assert read[:, angle] - true[:, angle] == pytest.approx(off, abs=1e-9)
    share = 1.0 + 0.04 * np.cos(2.0 * true[:, angle] + 0.7)
    assert read[:, speed] == pytest.approx(true[:, speed] * share, abs=1e-8)
