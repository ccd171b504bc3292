"""Commands whose message was lost: what is guessed, how far it may be off, and what that does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.lost_inputs import LostValues, guess_lost
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.lost_inputs import at_their_best, lost_input_noise, with_held
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.replay.replay import replay
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

TIME = np.arange(2000) * 1e-3
SIGMA = {"motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}


def _without(values: np.ndarray, ticks: list[int]) -> tuple[np.ndarray, np.ndarray]:
    gone = np.zeros(values.size, dtype=bool)
    gone[ticks] = True
    return np.where(gone, np.nan, values), gone


def test_a_smooth_command_is_guessed_and_its_spread_holds_the_error() -> None:
    values = 10.0 * np.sin(2 * np.pi * 10.0 * TIME)
    ticks = [*range(10, 1990, 37)]
    found, unsure = guess_lost(TIME, *_without(values, ticks))
    error = np.abs(found - values)[ticks]
    assert error.max() < 1e-3
    assert unsure.ticks.tolist() == ticks
    assert (unsure.stops == unsure.ticks + 1).all()
    assert np.mean(error <= unsure.spread) > 0.9
    assert unsure.spread.max() < 5e-3


def test_a_command_lost_at_a_jump_may_be_of_either_side() -> None:
    values = np.where(TIME < 1.0, 2.0, 14.0)
    found, unsure = guess_lost(TIME, *_without(values, [1000]))
    assert unsure.ticks.tolist() == [1000]
    assert 2.0 < found[1000] < 14.0
    assert abs(found[1000] - 8.0) + 6.0 <= 1.1 * unsure.spread[0] <= 8.0


def test_no_guess_swings_beyond_a_command_that_is_held() -> None:
    """A cubic through a jump and two messages that are the same goes far beyond them."""
    values = np.where(TIME < 1.0, -2.5, 2.5)
    for lost in (998, 1001):
        found, _ = guess_lost(TIME, *_without(values, [lost]))
        assert found[lost] == values[lost]
    found, _ = guess_lost(TIME, *_without(values + np.where(TIME == 1.001, -0.5, 0.0), [1000]))
    assert -2.5 <= found[1000] <= 2.5


def test_a_command_that_rests_is_known_and_long_holes_are_not_guessed() -> None:
    found, unsure = guess_lost(TIME, *_without(np.full(TIME.size, 3.0), [500, 501]))
    assert found[[500, 501]].tolist() == [3.0, 3.0]
    assert not unsure.ticks.size
    moves = np.sin(20.0 * TIME)
    found, unsure = guess_lost(TIME, *_without(moves, [*range(100, 111)]))
    assert np.isnan(found[100:111]).all()
    assert not unsure.ticks.size


@pytest.mark.parametrize("count", [2, 3, 5, 10])
def test_a_smooth_command_of_which_some_in_a_row_are_lost_is_guessed(count: int) -> None:
    values = 10.0 * np.sin(2 * np.pi * 4.0 * TIME) + 2.0 * np.sin(2 * np.pi * 11.0 * TIME)
    starts = [*range(60, 1900, 97)]
    ticks = [start + k for start in starts for k in range(count)]
    found, unsure = guess_lost(TIME, *_without(values, ticks))
    error = np.abs(found - values)
    # beyond three in a row they are unknown together
    spans = zip(unsure.ticks, unsure.stops, unsure.spread, strict=True)
    held = [np.sqrt(np.mean(error[a:b] ** 2)) <= s for a, b, s in spans]
    assert len(held) == len(starts) * (1 if count > 3 else count)
    assert np.mean(held) > 0.9
    assert error.max() < 0.05 * np.ptp(values)


def test_a_jump_among_many_lost_ones_is_unknown_by_half_of_it() -> None:
    values = np.where(TIME < 1.0, 2.0, 14.0)
    _, unsure = guess_lost(TIME, *_without(values, [*range(997, 1004)]))
    assert (unsure.ticks.tolist(), unsure.stops.tolist()) == ([997], [1004])
    assert unsure.anew.tolist() == [1004]
    assert 6.0 <= unsure.spread[0] <= 9.0


def test_a_command_on_a_slower_clock_is_lost_until_the_next_one() -> None:
    values = np.full(TIME.size, np.nan)
    values[::10] = np.sin(9.0 * TIME[::10])
    gone = np.zeros(TIME.size, dtype=bool)
    gone[500], values[500] = True, np.nan
    _, unsure = guess_lost(TIME, values, gone)
    assert (unsure.ticks.tolist(), unsure.stops.tolist()) == ([500], [510])


def test_what_lost_messages_do_is_what_each_alone_does() -> None:
    decay = np.exp(-np.arange(TIME.size) / 30.0)

    def residuals(drives: Sequence[Drive]) -> list[np.ndarray]:
        return [np.convolve(d.inputs["current_command"], decay)[: TIME.size] for d in drives]

    unsure = LostValues(
        np.array([100, 900, 905]), np.array([101, 901, 908]), np.array([2.0, 1.0, 3.0])
    )
    drive = Drive(TIME, {"current_command": np.zeros(TIME.size)})
    found = lost_input_noise(drive, {"current_command": unsure}, 0, TIME, np.ones(1), residuals)
    expected = np.zeros((3, TIME.size))
    for row, tick, stop, spread in zip(
        expected, unsure.ticks, unsure.stops, unsure.spread, strict=True
    ):
        pulse = np.zeros(TIME.size)
        pulse[tick:stop] = spread
        row[:] = np.convolve(pulse, decay)[: TIME.size]
    assert np.linalg.norm(found.columns @ found.columns.T - expected.T @ expected) < 1e-3
    # the first and the second die away before one another: simulated together
    assert found.simulations < 1 + 3 + 3


def test_what_does_next_to_nothing_is_left_out() -> None:
    unsure = LostValues(np.arange(10, 1990, 10), np.arange(11, 1991, 10), np.full(198, 1e-4))
    drive = Drive(TIME, {"current_command": np.zeros(TIME.size)})

    def residuals(drives: Sequence[Drive]) -> list[np.ndarray]:
        assert drives
        return [drive.inputs["current_command"] for drive in drives]

    found = lost_input_noise(drive, {"current_command": unsure}, 0, TIME, np.ones(1), residuals)
    assert found.columns.shape == (TIME.size, 0)
    assert found.simulations == 2


def test_the_right_model_leaves_noise_though_commands_at_jumps_are_lost() -> None:
    model = load_model(shipped_file("models/physical.yaml"))
    rng = np.random.default_rng(0)
    command = np.repeat(rng.choice([4.0, 9.0, 14.0], 100), 20)
    ticks = [k for k in range(60, 1990, 20) if command[k] != command[k - 1]][:30]
    start = {"pressure_a": 6e5, "pressure_b": 6e5}
    drive = Drive(TIME, {"current_command": command}, start, locked=True)
    out = model.plant.simulate(model.vector(), drive, 2e-4)
    place = {name: at for at, name in enumerate(model.plant.outputs)}
    values = {
        name: out[:, place[name]] + sigma * rng.standard_normal(TIME.size)
        for name, sigma in SIGMA.items()
    }
    values["current_command"] = _without(command, ticks)[0]
    reading = Recording(TIME, values)
    run = Run("log", Path("log.mcap"), None, True, False, Use.TRAIN, lambda: reading)
    measured = admit(run, reading, ["current_command"], model.plant.outputs)
    assert measured.unsure["current_command"].ticks.size == len(ticks)
    assert "of which unknown: 30" in " ".join(measured.notes)

    def left(*, known: bool) -> float:
        own = measured if known else replace(measured, unsure={})
        problem = Problem(model.plant, cut_windows(own, SIGMA), SIGMA, 2e-4)
        problem.prepare(model.vector())
        return float(np.mean(problem.residual(model.vector()) ** 2))

    # a pulse of some amperes makes friction stick elsewhere, which no slope foresees
    assert left(known=False) > 2.0
    assert left(known=True) < 1.0 + 0.1 * (left(known=False) - 1.0)


def test_lost_values_are_found_where_readings_tell_and_stay_where_they_do_not() -> None:
    decay = np.exp(-np.arange(TIME.size) / 30.0)
    truth = np.zeros(TIME.size)
    truth[[100, 900]] = 2.0, -1.0
    measured = np.convolve(truth, decay)[: TIME.size] * 50.0

    def residuals(drives: Sequence[Drive]) -> list[np.ndarray]:
        asked = [drive.inputs["current_command"] for drive in drives]
        return [measured - 50.0 * np.convolve(own, decay)[: TIME.size] for own in asked]

    unsure = LostValues(
        np.array([100, 900, 1995]), np.array([101, 901, 1996]), np.array([2.0, 1.5, 4])
    )
    drive = Drive(TIME, {"current_command": np.zeros(TIME.size)})
    found = at_their_best(drive, {"current_command": unsure}, TIME, residuals)
    assert found.inputs["current_command"] == pytest.approx(truth, abs=1e-3)
    # never further than three spreads, whatever is missing
    near = LostValues(unsure.ticks, unsure.stops, np.full(3, 0.1))
    found = at_their_best(drive, {"current_command": near}, TIME, residuals)
    assert np.abs(found.inputs["current_command"]).max() == pytest.approx(0.3)


def test_a_row_that_was_lost_may_have_asked_for_nothing() -> None:
    """Of a smooth command the guess is sure; whether it was ever sent nobody knows."""
    values = 10.0 * np.sin(2 * np.pi * 10.0 * TIME)
    lost = _without(values, [*range(10, 1990, 37)])
    _, sent = guess_lost(TIME, *lost)
    assert sent.held is None
    found, unsure = guess_lost(TIME, *lost, may_be_held=True)
    assert unsure.held is not None
    assert unsure.held == pytest.approx(values[unsure.ticks - 1])
    assert (np.abs(found[unsure.ticks] - unsure.held) <= unsure.spread).all()
    assert unsure.spread.max() > 10.0 * sent.spread.max()
    drive = Drive(TIME, {"current_command": found})
    assert with_held(drive, {"current_command": sent}) is None
    held = with_held(drive, {"current_command": unsure})
    assert held is not None
    there = held.inputs["current_command"]
    assert there[unsure.ticks] == pytest.approx(unsure.held)
    others = np.delete(np.arange(TIME.size), unsure.ticks)
    assert (there[others] == found[others]).all()


@pytest.mark.parametrize("sent", [True, False])
def test_a_replay_takes_lost_rows_as_they_fit(sent: bool) -> None:
    """A logger that misses a row, or a bus that fails and leaves the last command on."""
    model = load_model(shipped_file("models/physical.yaml"))
    rng = np.random.default_rng(5)
    time = np.arange(1200) * 1e-3
    rows = rng.random(1200) > 0.05
    rows[[0, -1]] = True
    rows[1:] |= ~rows[:-1]
    asked = 6.0 * np.sin(2 * np.pi * 12.0 * time)
    acted = asked if sent else np.where(rows, asked, np.roll(asked, 1))
    out = model.plant.simulate(model.vector(), Drive(time, {"current_command": acted}, {}), 2e-4)
    speed = out[:, model.plant.outputs.index("motor_speed")] + 0.02 * rng.standard_normal(1200)
    table = Recording(time[rows], {"current_command": asked[rows], "motor_speed": speed[rows]})
    run = Run("log", Path("log.mcap"), None, False, False, Use.TRAIN, lambda: table)
    sampled = on_ticks([table], ["current_command"], ["motor_speed"])
    measured = admit(run, sampled, ["current_command"], model.plant.outputs)
    (found,) = replay([measured], [model], {"motor_speed": 0.02})
    assert np.nanstd(found.errors("motor_speed")[0]) < 1.15 * 0.02
