"""A valve whose opening depends on where its command comes from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.plants.effects.valve_hysteresis import held_back, narrow, whole, wide
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

WIDTH, FULL = 0.06, 10.0
PLAY, JUMP = 0.0, 2.0


def valve(form: str, effect: str = "valve_hysteresis") -> Model:
    own = {"hysteresis": WIDTH} if effect == "valve_hysteresis" else {"time_constant": 0.03}
    declared = DeclaredEffect(effect, {**own, "form": form})
    return Model("valve_cylinder", {}, (), (declared,))


def spool(model: Model, drive: Drive) -> np.ndarray:
    out = model.plant.simulate(model.vector(), drive, 1e-4)
    return np.asarray(out[:, model.plant.outputs.index("spool_position")])


@pytest.mark.parametrize(
    ("form", "held", "asked", "found"),
    [(PLAY, 0.0, 0.2, 0.0), (PLAY, 0.0, 0.4, 0.1), (PLAY, 0.0, -1.0, -0.7), (PLAY, 2.0, 2.0, 2.0),
     (JUMP, 0.0, 0.2, 0.0), (JUMP, 0.0, 0.4, 0.4), (JUMP, 0.0, -1.0, -1.0), (JUMP, 2.0, 2.25, 2.0)]
)  # fmt: skip
def test_half_the_width_is_held_then_a_play_carries_and_a_jump_follows(
    form, held, asked, found
) -> None:
    assert whole(held, asked, FULL, WIDTH, form) == pytest.approx(found)


def test_a_rounded_loop_is_as_wide_as_a_play() -> None:
    up = np.linspace(-5.0, 5.0, 2001)
    inner, held, outer = -5.0, -5.0, -5.0
    read = {}
    for asked in (*up, *up[::-1]):
        for form in (0.0, 1.0):
            followed = held_back(asked, inner, held, outer, FULL, WIDTH, form)
            read.setdefault(form, []).append(followed)
        inner = narrow(inner, asked, FULL, WIDTH)
        held, outer = whole(held, asked, FULL, WIDTH, 0.0), wide(outer, asked, FULL, WIDTH)
    for values in read.values():
        rising, falling = np.array(values[:2001]), np.array(values[2001:][::-1])
        assert (falling - rising)[1000] == pytest.approx(WIDTH * FULL, rel=1e-6)


def test_the_spool_lags_a_slow_triangle_by_half_the_loop() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    command = 5.0 * (1.0 - np.abs(2.0 * ((0.5 * time + 0.25) % 1.0) - 1.0) * 2.0)
    drive = Drive(time, {"valve_command": command})
    none, shift = spool(Model("valve_cylinder"), drive), spool(valve("play"), drive)
    scale = np.ptp(none) / np.ptp(command)
    rising = np.gradient(command) > 0.0
    steady = (np.abs(command) < 3.0) & (time > 1.6)
    half = 0.5 * WIDTH * FULL * scale
    assert np.mean((none - shift)[steady & rising]) == pytest.approx(half, rel=0.02)
    assert np.mean((none - shift)[steady & ~rising]) == pytest.approx(-half, rel=0.02)


def test_a_lag_behind_it_leaves_the_loop_as_it_is() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    drive = Drive(time, {"valve_command": 3.0 * np.sin(2.0 * time)})
    lag = DeclaredEffect("valve_lag", {"time_constant": 5e-3})
    play = valve("play").effects
    alone = spool(Model("valve_cylinder", {}, (), (lag,)), drive)
    both = spool(Model("valve_cylinder", {}, (), (lag, *play)), drive)
    assert np.ptp(alone - both) == pytest.approx(0.1 * np.ptp(alone), rel=0.15)


@pytest.mark.parametrize("form", ["play", "rounded"])
@pytest.mark.parametrize("size", [2.0, 0.25])
def test_a_window_begins_where_the_commands_before_it_have_brought_the_valve(form, size) -> None:
    """A tenth of a second of history says little of a slow command; its turns say all.

    Of 0.25 V the command stays within the loop: where it began says all.
    """
    model = valve(form)
    time = np.arange(0.0, 6.0, 2e-3)
    command = 0.1 + size * np.sin(1.1 * time) + 0.1 * size * np.sin(2.9 * time)
    noise = 1e-9 * np.random.default_rng(0).standard_normal(time.size)
    whole_run = spool(model, Drive(time, {"valve_command": command}))
    reading = Recording(time, {"valve_command": command, "spool_position": whole_run + noise})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    roles = model.plant.roles
    measured = admit(run, reading, ["valve_command"], model.plant.outputs, roles=roles)
    for first in (60, 800, 1500, 2600):
        drive = measured.drive(first, first + 60, {"spool_position": whole_run[first]}, history=50)
        window = spool(model, drive)[drive.first :]
        apart = np.abs(window - whole_run[first : first + 60]).max()
        assert apart < 1e-6


@pytest.mark.parametrize("form", ["first_order", "second_order"])
def test_a_window_begins_with_the_lag_that_the_commands_before_it_leave(form) -> None:
    model = Model(
        "valve_cylinder", {}, (),
        (DeclaredEffect("valve_lag", {"time_constant": 6e-3, "form": form}),),
    )  # fmt: skip
    time = np.arange(0.0, 1.0, 1e-3)
    inputs = {"valve_command": 3.0 * np.sin(40.0 * time)}
    whole_run = spool(model, Drive(time, inputs))
    first = 500
    cut = slice(first - 100, first + 60)
    own = {"valve_command": inputs["valve_command"][cut]}
    window = spool(model, Drive(time[cut], own, first=100))[100:]
    # 100 ms before it are 17 time constants; a step of 0.1 ms leaves a thousandth
    assert np.abs(window - whole_run[first : first + 60]).max() < 3e-4


def test_a_window_begins_as_exactly_beside_an_effect_that_remembers_nothing() -> None:
    band = DeclaredEffect("valve_deadband", {"deadband": 0.02})
    model = Model("valve_cylinder", {}, (), (band,))
    time = 2.5e-3 * np.arange(200)
    command = 3.0 * np.sin(40.0 * time)
    whole_run = spool(model, Drive(time, {"valve_command": command}))
    window = spool(model, Drive(time, {"valve_command": command}, first=100))[100:]
    assert np.abs(window - whole_run[100:]).max() < 1e-9 * np.ptp(whole_run)


def test_a_look_at_a_microsecond_takes_no_finer_steps_of_what_was_before_it() -> None:
    """Where a joint gives way every window begins with such looks: they took all of the time."""
    lag = DeclaredEffect("valve_lag", {"time_constant": 6e-3})
    model = Model("valve_cylinder", {}, (), (lag,))
    time = 1e-3 * np.arange(101)
    drive = Drive(time, {"valve_command": 3.0 * np.sin(40.0 * time)}, first=100)
    place = model.plant.outputs.index("spool_position")
    at_first = {
        step: model.plant.simulate(model.vector(), drive, step)[100, place]
        for step in (1e-6, 25e-6, 1e-4)
    }
    assert at_first[1e-6] == at_first[25e-6] != at_first[1e-4]
