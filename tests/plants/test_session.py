"""A session: moment by moment what a whole simulation computes, for as long as one likes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eha_bench.core.errors import InputError
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.session import Session

STEP = 1e-4
DELAY = DeclaredEffect("command_delay", {"delay": 7.3e-3})


def session(model: Model, initial: dict[str, float] | None = None, **setup: bool) -> Session:
    return Session(model.plant, model.vector(), initial or {}, step=STEP, **setup)


@pytest.mark.parametrize("name", ["eha_knee", "linear_drive"])
@pytest.mark.parametrize("effects", [(), (DELAY,)])
@settings(max_examples=5, deadline=None)
@given(
    spans=st.lists(st.floats(1e-4, 5e-3), min_size=2, max_size=40),
    seed=st.integers(0, 99),
    x=st.floats(-0.01, 0.01),
)
def test_moment_by_moment_is_the_whole_simulation(
    name: str, effects: tuple[DeclaredEffect, ...], spans: list[float], seed: int, x: float
) -> None:
    model = Model(name, effects=effects)
    time = np.concatenate(([0.0], np.cumsum(spans)))
    commands = np.random.default_rng(seed).uniform(-10.0, 10.0, time.size)
    initial = {"piston_position": x}
    drive = Drive(time, {model.plant.command: commands}, initial)
    whole = model.plant.simulate(model.vector(), drive, STEP)
    going = session(model, initial)
    column = [k for k, output in enumerate(model.plant.outputs) if output != model.plant.command]
    for k, command in enumerate(commands[:-1].tolist()):
        np.testing.assert_array_equal(going.reading[column], whole[k, column])
        going.advance(time[k + 1], command)
    np.testing.assert_array_equal(going.reading[column], whole[-1, column])


def test_a_long_session_keeps_what_a_delay_looks_back_on_and_no_more() -> None:
    model = Model("linear_drive", effects=(DELAY,))
    time = np.arange(6000) * 1e-3
    commands = np.where(np.arange(6000) // 500 % 2, 0.5, -0.5)
    whole = model.plant.simulate(model.vector(), Drive(time, {"voltage": commands}), STEP)
    going = session(model)
    for k, command in enumerate(commands[:-1].tolist()):
        going.advance(time[k + 1], command)
    np.testing.assert_array_equal(going.reading[1:], whole[-1, 1:])
    assert len(going._time) == 1024


def test_a_delay_of_more_moments_than_are_kept_at_first_still_finds_them() -> None:
    model = Model("linear_drive", effects=(DeclaredEffect("command_delay", {"delay": 0.5}),))
    time = np.arange(3000) * 3e-4
    commands = np.sin(20.0 * time)
    whole = model.plant.simulate(model.vector(), Drive(time, {"voltage": commands}), STEP)
    going = session(model)
    for k, command in enumerate(commands[:-1].tolist()):
        going.advance(time[k + 1], command)
    np.testing.assert_array_equal(going.reading[1:], whole[-1, 1:])


def test_disturbances_are_held_until_others_are_given() -> None:
    model = Model("eha_knee")
    time, force = np.arange(60) * 1e-3, np.full(60, 900.0)
    drive = Drive(time, {"current_command": np.zeros(60), "force": force})
    whole = model.plant.simulate(model.vector(), drive, STEP)
    going = session(model)
    going.give({"force": 900.0})
    for then in time[1:].tolist():
        going.advance(then, 0.0)
    np.testing.assert_array_equal(going.reading, whole[-1])


def test_truth_holds_what_follows_from_the_outputs() -> None:
    model = Model("eha_knee")
    going = session(model, {"piston_position": 0.01})
    angle = model.plant.linkage(model.vector()).angle_at(0.01)
    assert going.channels == (*model.plant.outputs, "joint_angle")
    assert going.truth.tolist() == [*going.reading.tolist(), angle]


def test_a_state_can_be_shifted_at_once() -> None:
    going = session(Model("eha_knee"), locked=True)
    going.shift("pressure_a", 2e6)
    going.advance(1e-6, 0.0)
    place = going.channels.index("pressure_a")
    assert going.truth[place] == pytest.approx(2e6, rel=1e-3)


def test_what_a_plant_cannot_do_is_refused() -> None:
    drive = Model("linear_drive")
    with pytest.raises(InputError, match="nothing to lock"):
        session(drive, locked=True)
    with pytest.raises(InputError, match="no bypass"):
        session(drive, bypass_open=True)
    with pytest.raises(InputError, match="'pressure_a' is not a state of linear_drive"):
        session(drive, {"pressure_a": 1.0})
    with pytest.raises(InputError, match="'force' cannot be an input of linear_drive"):
        session(drive).give({"force": 1.0})
    with pytest.raises(InputError, match="'pressure_a' is not a state of linear_drive"):
        session(drive).shift("pressure_a", 1.0)
    with pytest.raises(InputError, match="no input that a controller commands"):
        session(Model("pump_hold"))
