"""Many simulations in one call are those of single calls, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from eha_bench.core.errors import InputError
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive, Drives
from eha_bench.plants.registry import get_plant

TIME = np.arange(300) * 1e-3
STEP = 1e-3


def drives_of(channel: str, size: float, *, locked: bool = False) -> Drives:
    """Four windows of unlike length and phase, two of them with inputs before their start."""
    items = []
    for number, length in enumerate((300, 180, 240, 300)):
        time = TIME[:length]
        values = size * np.sin(2 * np.pi * 5.0 * time + number)
        items.append(Drive(time, {channel: values}, locked=locked, first=40 * (number % 2)))
    return Drives(tuple(items))


def same(model: Model, drives: Drives, which: Sequence[int], state: str) -> None:
    at = get_plant(model.plant_id).at(model.vector())
    starts = [{state: 0.01 * n} for n, _ in enumerate(which)]
    found = at.simulate_each(drives, which, starts, STEP)
    for number, start, values in zip(which, starts, found, strict=True):
        alone = at.simulate(drives.items[number], start, STEP)
        np.testing.assert_array_equal(values, alone)


@pytest.mark.parametrize("locked", [False, True])
def test_a_knee_without_effects(locked: bool) -> None:
    drives = drives_of("current_command", 5.0, locked=locked)
    same(Model("eha_knee"), drives, [0, 1, 2, 3, 1, 1], "pressure_a")


def test_effects_that_look_back_and_remember() -> None:
    effects = (
        DeclaredEffect("command_delay", {"delay": 7.3e-3}),
        DeclaredEffect("presliding_friction", {"distance": 1e-4}),
    )
    model = Model("linear_drive", effects=effects)
    same(model, drives_of("voltage", 3.0), [3, 2, 1, 0], "piston_velocity")


def test_a_closed_circuit_of_oil() -> None:
    drives = drives_of("current_command", 5.0)
    same(Model("single_rod_eha"), drives, [0, 1, 2, 3], "piston_position")


def test_a_controller_inside_the_plant_starts_each_time_afresh() -> None:
    """It writes its command over the inputs, which a second simulation of the window reads."""
    drives = drives_of("goal_position", 0.3)
    same(Model("position_servo"), drives, [0, 0, 1, 0, 3], "angle")


def test_the_command_of_the_same_plant_in_open_loop_is_laid_out_anew() -> None:
    model = Model("position_servo")
    same(model, drives_of("duty", 0.3), [0, 1], "angle")
    same(model, drives_of("goal_position", 0.3), [0, 1], "angle")


def test_nothing_to_simulate() -> None:
    at = get_plant("eha_knee").at(Model("eha_knee").vector())
    assert at.simulate_each(drives_of("current_command", 1.0), [], [], STEP) == []


def test_a_state_that_the_plant_does_not_have() -> None:
    at = get_plant("eha_knee").at(Model("eha_knee").vector())
    with pytest.raises(InputError, match="'pressure' is not a state of eha_knee"):
        at.simulate_each(drives_of("current_command", 1.0), [0], [{"pressure": 1.0}], STEP)
