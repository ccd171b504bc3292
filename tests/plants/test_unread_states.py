"""A supply that has fallen before a window begins."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive, Drives

RESISTANCE, RECOVERY = 1e10, 0.3
NAME = "supply_sag.sag@supply"
STEP = 1e-4


def model(**settings) -> Model:
    return Model("valve_cylinder", {}, (), (DeclaredEffect("supply_sag", settings),))


SAGGING = model(resistance=RESISTANCE, recovery_time=RECOVERY)


@pytest.fixture(scope="module")
def run():
    """A whole run, and the states in the midst of it."""
    plant = SAGGING.plant
    time = np.arange(0.0, 1.2, 1e-3)
    command = 6.0 * np.sin(2.0 * np.pi * 1.5 * time)
    out = plant.simulate(SAGGING.vector(), Drive(time, {"valve_command": command}), STEP)
    first = 600
    start = {
        name: float(out[first, k]) for k, name in enumerate(plant.outputs) if name in plant.states
    }
    rows = slice(first - 200, first + 300)
    drive = Drive(time[rows], {"valve_command": command[rows]}, first=200)
    return out[first : first + 300], drive, start


def pressure_of(out):
    return out[:, SAGGING.plant.outputs.index("pressure_a")]


def test_nothing_is_unread_where_the_effect_is_off_or_others_draw() -> None:
    assert Model("valve_cylinder").plant.at(Model("valve_cylinder").vector()).hidden == {}
    others = model(drawn_by="swinging")
    assert others.plant.at(others.vector()).hidden == {}
    reach = SAGGING.plant.at(SAGGING.vector()).hidden[NAME]
    assert 1e5 < reach < 1e7


def test_a_window_goes_on_as_the_run_where_the_sag_is_known(run) -> None:
    whole, drive, start = run
    at = SAGGING.plant.at(SAGGING.vector())
    without = at.simulate(drive, start, STEP)[drive.first :]
    assert np.abs(pressure_of(without) - pressure_of(whole)).max() > 1e5
    errors = []
    sizes = np.linspace(0.0, at.hidden[NAME], 41)
    each = at.simulate_each(
        Drives((drive,)), [0] * sizes.size, [{**start, NAME: size} for size in sizes], STEP
    )
    for size, out in zip(sizes, each, strict=True):
        errors.append(np.abs(pressure_of(out[drive.first :]) - pressure_of(whole)).max())
        alone = at.simulate(drive, {**start, NAME: float(size)}, STEP)
        assert alone[drive.first :] == pytest.approx(out[drive.first :], rel=1e-12, abs=1e-15)
    assert min(errors) < 0.1 * errors[0]
