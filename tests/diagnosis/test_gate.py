"""The data gate: noise from the data themselves, dead and stuck channels, gaps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eha_bench.core.errors import InputError, MissingChannelError
from eha_bench.core.note import Note, of_run
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured, notes_of_runs, pooled_noise
from eha_bench.diagnosis.data.noise import noise_of, quantum_of
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.windows import window_at
from eha_bench.diagnosis.fit.baseline import _notes_of_constant_inputs, _notes_of_time

OUTPUTS = ("current", "motor_speed", "pressure_a", "pressure_b", "piston_position")


def recording(n: int = 2000, **changes: np.ndarray) -> Recording:
    rng = np.random.default_rng(0)
    t = np.arange(n) * 1e-3
    values = {
        "current_command": np.sin(t),
        "current": np.sin(t) + 0.05 * rng.standard_normal(n),
        "motor_speed": 10 * np.sin(3 * t) + 0.1 * rng.standard_normal(n),
    }
    values.update(changes)
    return Recording(t, values)


def run(reading: Recording, *, locked: bool = False) -> Run:
    return Run("log", Path("log.mcap"), None, locked, False, Use.TRAIN, lambda: reading)


@settings(max_examples=20, deadline=None)
@given(sigma=st.floats(1e-3, 10.0), seed=st.integers(0, 100))
def test_white_noise_on_a_smooth_signal_is_found_within_five_percent(sigma, seed):
    t = np.arange(6000) * 1e-3
    rng = np.random.default_rng(seed)
    values = 100 * sigma * np.sin(2 * np.pi * t) + sigma * rng.standard_normal(t.size)
    assert noise_of(values) == pytest.approx(sigma, rel=0.05)


def test_jumps_of_the_signal_do_not_count_as_noise():
    rng = np.random.default_rng(1)
    values = 50.0 * (np.arange(8000) // 1000) + 0.1 * rng.standard_normal(8000)
    assert noise_of(values) == pytest.approx(0.1, rel=0.05)


def test_noise_is_never_below_the_quantisation():
    t = np.arange(4000) * 1e-3
    values = np.round(0.5 * np.sin(2 * np.pi * 0.2 * t) / 0.01) * 0.01
    assert quantum_of(values) == pytest.approx(0.01)
    assert noise_of(values) >= 0.01 / np.sqrt(12) * 0.999


@pytest.mark.parametrize("count", [120, 250, 499])
@pytest.mark.parametrize("centre", [0.0, 0.4])
def test_noise_of_readings_that_flicker_between_two_steps(count: int, centre: float) -> None:
    """Less what a model says, no step shows; most differences are still nothing."""
    found, right = [], []
    for seed in range(40):
        noise = 0.33 * np.random.default_rng(seed).standard_normal(count)
        left = np.round(centre + noise) + 1e-4 * np.sin(np.arange(count) / 300.0)
        found.append(noise_of(left, 1.0))
        right.append(np.std(left))
    assert np.mean(found) == pytest.approx(np.mean(right), rel=0.12)


def test_a_dead_sensor_is_said_and_left_out():
    found = admit(
        run(recording(pressure_a=np.full(2000, 3.0))),
        recording(pressure_a=np.full(2000, 3.0)),
        ["current_command"],
        OUTPUTS,
    )
    assert "pressure_a" not in found.outputs
    assert any("dead sensor" in note for note in found.notes)


def test_a_stuck_stretch_is_masked_and_the_rest_kept():
    reading = recording()
    speed = np.array(reading["motor_speed"])
    speed[500:700] = speed[500]
    found = admit(
        run(reading), reading.with_values({"motor_speed": speed}), ["current_command"], OUTPUTS
    )
    column = found.column("motor_speed")
    assert column is not None
    assert np.isnan(column[510:690]).all()
    assert np.isfinite(column[:490]).all()


@pytest.mark.parametrize("step", [0.0, 0.05], ids=["continuous", "quantised"])
def test_what_is_latched_or_clipped_for_some_samples_is_masked_and_nothing_else(step):
    tick = np.arange(2000)
    speed = 10.0 * np.sin(0.02 * tick) + 0.1 * np.random.default_rng(0).standard_normal(2000)
    speed = np.round(speed / step) * step if step else speed
    reading = recording(motor_speed=speed)
    for spoilt in (speed, np.minimum(speed, 9.0)):
        wrong = spoilt != speed
        latched = spoilt.copy()
        for k in range(942, 2000, 314):
            latched[k : k + 25] = latched[k - 1]
            wrong[k : k + 25] = True
        found = admit(
            run(reading),
            reading.with_values({"motor_speed": latched}),
            ["current_command"],
            OUTPUTS,
        )
        valid = found.valid[:, found.outputs.index("motor_speed")]
        assert not valid[wrong].any()
        assert (~valid & ~wrong).sum() < 25


def test_an_encoder_that_turns_round_between_two_counts_is_not_stuck():
    position = np.round(1e-3 * np.sin(np.arange(2000) * 1e-2) / 2e-6) * 2e-6
    reading = recording(piston_position=position)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert found.valid[:, found.outputs.index("piston_position")].all()


def test_nan_outputs_are_masked_and_inputs_bridged():
    command = np.sin(np.arange(2000) * 1e-3)
    command[100:110] = np.nan
    current = np.array(recording()["current"])
    current[50:60] = np.nan
    reading = recording(current_command=command, current=current)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert np.isfinite(found.inputs["current_command"]).all()
    assert found.inputs["current_command"][105] == pytest.approx(np.sin(0.105), abs=1e-6)
    assert not found.valid[50:60, found.outputs.index("current")].any()


def _with_gaps(**values: np.ndarray) -> Recording:
    """A recording that loses 15 samples of every hundred, whole rows at a time."""
    whole = recording(**values)
    kept = np.arange(whole.time.size) % 100 < 85
    return Recording(whole.time[kept], {name: own[kept] for name, own in whole.values.items()})


def test_what_a_signal_does_in_a_gap_is_no_noise():
    rng = np.random.default_rng(3)
    fast = 1e3 * np.sin(0.05 * np.arange(2000)) + 0.1 * rng.standard_normal(2000)
    reading = _with_gaps(motor_speed=fast)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert pooled_noise([found], ["motor_speed"])["motor_speed"] == pytest.approx(0.1, rel=0.2)


def test_a_run_breaks_at_gaps_through_which_an_input_took_an_unknown_way():
    stairs = np.repeat([1.0, 2.0], 1000)
    for command, breaks in ((stairs, 1), (np.sin(0.01 * np.arange(2000)), 19)):
        reading = _with_gaps(current_command=command)
        found = admit(run(reading), reading, ["current_command"], OUTPUTS)
        # the stairs go up inside the tenth gap, or right after it
        assert len(found.breaks) == breaks


def _held_up(every: int, gap: int) -> Recording:
    """A log at 500 Hz whose controller is held up again and again while its command moves."""
    whole = recording(current_command=np.sin(0.01 * np.arange(2000)))
    kept = np.arange(2000) % every < every - gap
    return Recording(
        2.0 * whole.time[kept], {name: own[kept] for name, own in whole.values.items()}
    )


def test_gaps_that_come_too_often_cut_no_windows():
    """Seven rows and a pause: windows of 14 ms show nothing that is slow."""
    reading = _held_up(every=13, gap=6)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert found.breaks == ()
    assert any("gaps come every 0.026 s, so windows go on" in str(note) for note in found.notes)


@pytest.mark.parametrize(("period", "breaks"), [(0.002, 0), (0.05, 39)])
def test_lost_rows_cut_windows_where_they_last(period: float, breaks: int):
    """Five rows lost again and again: 12 ms of a log at 500 Hz, 0.3 s of one at 20 Hz."""
    time = period * np.arange(800)
    kept = np.arange(800) % 20 < 15
    reading = Recording(
        time[kept],
        {"current_command": np.sin(0.3 * np.arange(800))[kept],
         "motor_speed": np.cos(0.3 * np.arange(800))[kept]},
    )  # fmt: skip
    sampled = on_ticks((reading,), ["current_command"], ["motor_speed"])
    found = admit(run(reading), sampled, ["current_command"], OUTPUTS)
    assert len(found.breaks) == breaks


def test_a_burst_of_gaps_cuts_a_run_that_is_whole_elsewhere():
    whole = recording(current_command=np.sin(0.01 * np.arange(2000)))
    kept = (np.arange(2000) % 13 < 7) | (np.arange(2000) > 100)
    values = {name: own[kept] for name, own in whole.values.items()}
    reading = Recording(2.0 * whole.time[kept], values)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert len(found.breaks) == 7


def test_long_gaps_cut_windows_however_often_they_come():
    reading = _held_up(every=40, gap=30)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert len(found.breaks) == 49


def test_a_start_after_a_gap_knows_nothing_of_before():
    speed = np.where(np.arange(2000) < 1000, 0.0, 50.0)
    reading = _with_gaps(current_command=np.repeat([1.0, 2.0], 1000), motor_speed=speed)
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    (first,) = found.breaks
    window = window_at(found, first, first + 50, {"motor_speed": 0.1, "current": 0.05})
    assert window.initial["motor_speed"] == pytest.approx(50.0)
    assert window.initial["current"] == found.values[first, found.outputs.index("current")]


@pytest.mark.parametrize("first", [1000, 1001])
def test_a_start_at_a_jump_of_an_input_stays_on_its_own_side(first: int):
    """The speed bends where the current steps: a polynomial across it is off by its curvature."""
    tick = np.arange(2000)
    reading = recording(
        current_command=np.where(tick < 1000, 1.0, 30.0),
        current=np.where(tick <= 1000, 1.0, 30.0),
        motor_speed=4.0 * np.maximum(tick - 1000, 0) + 0.1 * np.sin(tick / 200.0),
    )
    found = admit(run(reading), reading, ["current_command"], OUTPUTS)
    window = window_at(found, first, first + 50, {"motor_speed": 0.1, "current": 0.05})
    expected = found.values[first]
    for name in ("motor_speed", "current"):
        value = expected[found.outputs.index(name)]
        assert window.initial[name] == pytest.approx(value, abs=0.01)


def test_a_missing_input_names_the_channel():
    reading = recording()
    with pytest.raises(MissingChannelError, match="voltage"):
        admit(run(reading), reading, ["voltage"], OUTPUTS)


def test_nothing_to_compare_is_an_error():
    reading = Recording(np.arange(20.0), {"current_command": np.arange(20.0)})
    with pytest.raises(InputError, match="no channel"):
        admit(run(reading), reading, ["current_command"], OUTPUTS)


def test_channels_that_never_change_are_not_said_to_be_absent():
    still = {name: np.full(20, 2.0) for name in OUTPUTS[:2]}
    reading = Recording(np.arange(20.0), {"current_command": np.arange(20.0), **still})
    with pytest.raises(InputError, match="no channel of the plant changes: ") as told:
        admit(run(reading), reading, ["current_command"], OUTPUTS)
    assert all(name in str(told.value) for name in still)


def test_what_several_runs_say_alike_is_said_once():
    one = admit(run(recording()), recording(), ["current_command"], OUTPUTS)
    runs = [
        replace(
            one,
            run=replace(one.run, name=name),
            notes=(Note("{run}: 'current' has {gaps:d} gaps", run=name, gaps=gaps),),
        )
        for name, gaps in (("ramp", 3), ("steps", 12))
    ]
    alone = replace(
        one, run=replace(one.run, name="sine"), notes=(of_run("sine", "the clock jumps"),)
    )
    assert notes_of_runs([*runs, alone]) == (
        "ramp, steps: 'current' has 3 to 12 gaps",
        "sine: the clock jumps",
    )


def test_rounding_to_single_precision_hides_no_step():
    rng = np.random.default_rng(0)
    steps = np.rint(40.0 * np.sin(np.arange(3000) / 50.0) + rng.standard_normal(3000))
    read = (steps * 0.0767).astype(np.float32).astype(np.float64)
    read += rng.choice([0.0, 3e-8], read.size)
    assert quantum_of(read) == pytest.approx(0.0767, rel=1e-3)
    assert noise_of(read) >= 0.0767 / np.sqrt(12) * 0.999


def test_a_fine_step_shows_where_hardly_a_level_comes_twice():
    rng = np.random.default_rng(0)
    position = np.cumsum(rng.integers(3, 40, 500)) * 1.534e-3
    assert quantum_of(position) == pytest.approx(1.534e-3, rel=1e-6)
    assert quantum_of(rng.standard_normal(500)) == 0.0
    assert quantum_of(np.round(rng.standard_normal(500), 12)) == 0.0


def test_what_stands_still_all_through_a_run_is_told_by_the_others():
    from eha_bench.diagnosis.data.gate import restful_channels

    time = np.arange(0.0, 2.0, 1e-3)
    moving = np.rint(np.maximum(np.sin(4.0 * time), 0.0) / 1e-3) * 1e-3
    noisy = moving + 5e-3 * np.random.default_rng(0).standard_normal(time.size)
    assert restful_channels([("piston_position", moving)]) == {"piston_position"}
    assert restful_channels([("piston_position", np.rint(noisy / 1e-3) * 1e-3)]) == set()
    assert restful_channels([("piston_position", np.ones(50))]) == set()


def test_a_stall_is_compared_where_other_runs_show_that_the_sensor_lives():
    time = np.arange(0.0, 1.0, 1e-3)
    command = np.full(time.size, 3.0)
    still = Recording(time, {"voltage": command, "piston_position": np.full(time.size, 0.02)})
    run = Run("stall", Path("stall"), None, False, False, Use.TRAIN, lambda: still)
    alone = admit(run, still, ["voltage"], ["piston_position"], strict=False)
    assert alone.outputs == ()
    assert "dead sensor" in alone.notes[0]
    told = admit(run, still, ["voltage"], ["piston_position"], restful={"piston_position"})
    assert told.valid.all()
    assert "at rest or stalled" in told.notes[0]


@pytest.mark.parametrize(("period", "said"), [(1e-3, 0), (1e-6, 1), (10.0, 1), (2e-2, 0)])
def test_a_time_in_another_unit_is_said(period: float, said: int) -> None:
    runs = [SimpleNamespace(time=period * np.arange(50))]
    notes = [*_notes_of_time(cast("list[Measured]", runs))]
    assert len(notes) == said
    assert all("check the unit of their time" in note for note in notes)


def test_inputs_that_never_change_are_said() -> None:
    """A column beside the right one reads zero from end to end."""
    still, moving = np.zeros(5), np.arange(5.0)
    runs = [SimpleNamespace(inputs={"voltage": still, "load": still + 2.0}) for _ in range(2)]
    (note,) = _notes_of_constant_inputs(cast("list[Measured]", runs), {"voltage": "V", "load": "N"})
    assert "('voltage' is 0 V, 'load' is 2 N)" in note
    runs[1].inputs["load"] = still + 3.0
    (note,) = _notes_of_constant_inputs(cast("list[Measured]", runs), {"voltage": "V", "load": "N"})
    assert "'load' is 2 or 3 N" in note
    runs[1].inputs["voltage"] = moving
    assert not [*_notes_of_constant_inputs(cast("list[Measured]", runs), {})]
    assert not [*_notes_of_constant_inputs([], {})]
