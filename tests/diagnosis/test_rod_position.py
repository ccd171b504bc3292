"""A joint's angle tells where the rod is that turns it."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.rod_position import with_rod_positions
from eha_bench.plants.model import Model

TIME = np.arange(20) * 1e-3
POSITION = np.linspace(-0.01, 0.02, 20)


@pytest.fixture
def knee() -> Model:
    return Model("eha_knee")


def test_the_rod_is_where_the_angle_says(knee: Model) -> None:
    linkage = knee.plant.linkage(knee.vector())
    assert linkage is not None
    leg = Recording(TIME, {"joint_angle": linkage.angle(POSITION)})
    drive = Recording(TIME, {"motor_speed": np.zeros(20)})
    same, found = with_rod_positions((drive, leg), knee)
    assert same is drive
    assert found["piston_position"] == pytest.approx(POSITION, abs=1e-12)
    assert found.units["piston_position"] == "m"
    assert "worked out from 'joint_angle'" in found.notes[-1]


def test_a_position_that_is_logged_stands(knee: Model) -> None:
    leg = Recording(TIME, {"joint_angle": np.full(20, 1.5)})
    rod = Recording(TIME, {"piston_position": POSITION})
    assert with_rod_positions((leg, rod), knee) == (leg, rod)


def test_a_plant_without_a_linkage_has_none() -> None:
    leg = Recording(TIME, {"joint_angle": np.full(20, 1.5)})
    assert with_rod_positions((leg,), Model("valve_cylinder")) == (leg,)
