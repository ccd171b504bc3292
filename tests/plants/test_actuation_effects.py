"""Known answers of the effects between command and torque."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eha_bench.plants.dead_zone import dead_zone
from eha_bench.plants.effects import command_delay, current_deadband, torque_saturation


def test_lag_reaches_63_percent_after_its_time_constant(knee, effect) -> None:
    time = np.arange(0.0, 0.02, 1e-3)
    out = knee.run(time, 10.0, effect("current_lag", time_constant=4e-3))
    assert out["current"][4] == pytest.approx(10.0 * (1 - np.exp(-1)), rel=1e-9)
    np.testing.assert_allclose(out["current"], 10.0 * (1 - np.exp(-time / 4e-3)), rtol=1e-9)


def test_lag_starts_from_the_current_that_flows(knee, effect) -> None:
    time = np.arange(0.0, 0.02, 1e-3)
    out = knee.run(time, 10.0, effect("current_lag"), initial={"current": 10.0})
    np.testing.assert_allclose(out["current"], 10.0)


def test_short_lag_is_none(knee, effect) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    command = 12.0 * np.sign(np.sin(2 * np.pi * 20 * time + 0.1))
    with_lag = knee.run(time, command, effect("current_lag", time_constant=1e-7))
    without = knee.run(time, command)
    for name, values in without.items():
        np.testing.assert_allclose(
            with_lag[name], values, rtol=1e-6, atol=1e-6 * np.ptp(values) + 1e-12
        )


def test_torque_sees_the_lag_as_the_sensor_does(knee, effect) -> None:
    """A drive with a lag makes the motion of a drive that is told the lagging current."""
    time = np.arange(0.0, 0.1, 1e-3)
    fine = np.arange(0.0, 0.1, 25e-6)
    got = knee.run(time, 10.0, effect("current_lag", time_constant=5e-3))
    middle = fine + 12.5e-6
    told = knee.run(fine, 10.0 * (1 - np.exp(-middle / 5e-3)))
    np.testing.assert_allclose(
        got["motor_speed"], told["motor_speed"][::40], atol=1e-3 * np.ptp(got["motor_speed"])
    )


@pytest.mark.parametrize("delay", [1e-3, 3e-3])
def test_delay_of_whole_samples_shifts_everything(knee, effect, delay) -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    command = 14.0 * np.sin(2 * np.pi * 6 * time)
    shift = round(delay / 1e-3)
    late = knee.run(time, command, effect("command_delay", delay=delay))
    shifted = np.concatenate((np.zeros(shift), command[:-shift]))
    expected = knee.run(time, shifted)
    for name, values in expected.items():
        np.testing.assert_allclose(late[name], values, rtol=1e-6, atol=1e-6 * np.ptp(values))


def test_delay_starts_from_the_current_that_flows(knee, effect) -> None:
    time = np.arange(0.0, 0.01, 1e-3)
    out = knee.run(time, 10.0, effect("command_delay", delay=3e-3), initial={"current": -4.0})
    np.testing.assert_allclose(out["current"][:4], -4.0)
    np.testing.assert_allclose(out["current"][4:], 10.0)


def test_delay_looks_back_before_the_window(knee, effect) -> None:
    time = np.arange(0.0, 0.1, 1e-3)
    command = 14.0 * np.sin(2 * np.pi * 20 * time)
    delay = effect("command_delay", delay=2.5e-3)
    whole = knee.run(time, command, delay)
    initial = {name: whole[name][50] for name in whole}
    window = knee.run(time, command, delay, initial=initial, first=50)
    np.testing.assert_allclose(window["motor_speed"][50:], whole["motor_speed"][50:], rtol=1e-9)


@given(delay=st.floats(1e-5, 9e-3), start=st.integers(10, 19), part=st.floats(0.0, 0.9))
def test_delayed_command_is_the_mean_of_the_shifted_staircase(delay, start, part) -> None:
    times = np.arange(20.0) * 1e-3
    commands = np.sin(np.arange(20.0)) * 5
    t, h = times[start] + part * 1e-3, 1e-4
    got = command_delay.delayed_command(commands[start], start, t, h, times, commands, delay, 0.0)
    samples = t - delay + (np.arange(20000) + 0.5) / 20000 * h
    held = commands[np.clip(np.searchsorted(times, samples, side="right") - 1, 0, 19)]
    assert got == pytest.approx(float(np.mean(held)), abs=2e-3)


@given(
    spans=st.lists(st.floats(1e-5, 3e-3), min_size=1, max_size=40),
    delay=st.floats(0.0, 0.08),
    share=st.floats(0.0, 1.0),
    h=st.floats(1e-5, 2e-3),
    data=st.data(),
)
def test_delayed_command_is_that_of_looking_back_tick_by_tick(spans, delay, share, h, data) -> None:
    times = np.cumsum(spans)
    commands = np.cos(np.arange(times.size))
    k = data.draw(st.integers(0, times.size - 1))
    t = float(times[k]) + share * 1e-3
    upper, expected, j = t - delay + h, 0.0, k
    while j >= 0 and times[j] >= upper:
        j -= 1
    while upper > t - delay:
        lower = t - delay if j < 0 else max(t - delay, float(times[j]))
        expected += (upper - lower) * (3.0 if j < 0 else commands[j])
        upper, j = lower, j - 1
    assert command_delay.delayed_command(0.0, k, t, h, times, commands, delay, 3.0) == expected / h


def test_delay_is_continuous(knee, effect) -> None:
    """Across a whole number of steps nothing jumps: small changes of the delay are small."""
    time = np.arange(0.0, 0.05, 1e-3)
    command = 14.0 * np.sign(np.sin(2 * np.pi * 40 * time + 0.1))
    runs = [
        knee.run(time, command, effect("command_delay", delay=d))["pressure_a"]
        for d in (1.9999e-3, 2.0e-3, 2.0001e-3)
    ]
    left, right = np.max(np.abs(runs[1] - runs[0])), np.max(np.abs(runs[2] - runs[1]))
    assert 0.3 < left / right < 3.0


@given(
    current=st.floats(-40, 40),
    deadband=st.floats(0.01, 5),
    asymmetry=st.floats(-0.9, 0.9),
    edges=st.sampled_from([0.0, 1.0]),
    place=st.sampled_from([0.0, 1.0]),
)
def test_dead_zone_takes_its_width_on_either_side(
    current, deadband, asymmetry, edges, place
) -> None:
    own = current_deadband.DeadZone(deadband, asymmetry, 0.0, edges, place)
    edge = deadband * (1.0 + np.sign(current) * asymmetry * edges)
    expected = np.sign(current) * max(0.0, abs(current) - edge)
    drive = current_deadband.drive(current, own)
    torque = current_deadband.motor(0.13 * current, current, own)
    if place == 0.0:
        assert drive == pytest.approx(expected, abs=1e-12)
        assert torque == 0.13 * current
    else:
        assert drive == current
        assert torque == pytest.approx(0.13 * expected, abs=1e-12)


@given(
    u=st.floats(-20, 20),
    size=st.floats(0.01, 5),
    asymmetry=st.floats(-0.9, 0.9),
    step=st.floats(0.0, 1.0),
)
def test_rounded_dead_zone_rises_and_is_the_sharp_one_away_from_its_corners(
    u, size, asymmetry, step
) -> None:
    sharp, smooth = (dead_zone(u, size, asymmetry, form) for form in (0.0, 1.0))
    assert dead_zone(u + step, size, asymmetry, 1.0) >= smooth - 1e-12
    up, down = size * (1 + asymmetry), -size * (1 - asymmetry)
    # ln(1 + e^-x) < e^-x, of each corner
    width = size / 3.0
    most = width * (np.exp(-abs(u - up) / width) + np.exp(-abs(u - down) / width))
    assert smooth == pytest.approx(sharp, abs=most + 1e-12)


def test_dead_zone_in_the_drive_is_seen_by_the_current_sensor(knee, effect) -> None:
    time = np.arange(0.0, 0.01, 1e-3)
    for place, expected in (("drive", 4.5), ("motor", 5.0)):
        out = knee.run(time, 5.0, effect("current_deadband", deadband=0.5, place=place))
        assert out["current"][-1] == pytest.approx(expected)


@given(current=st.floats(-1e4, 1e4), sharpness=st.floats(1, 20))
@settings(max_examples=200)
def test_saturated_torque_stays_below_its_asymptote_and_rises(current, sharpness) -> None:
    def torque(i):
        return torque_saturation.saturated_torque(0.13 * i, i, 1 / 60.0, sharpness)

    assert abs(torque(current)) <= 0.13 * 60.0 * (1 + 1e-9)
    assert abs(torque(current)) <= 0.13 * abs(current) * (1 + 1e-9)
    assert torque(-current) == -torque(current)
    assert torque(current + 0.1) >= torque(current) - 1e-9


@pytest.mark.parametrize("sharpness", [1.0, 2.0, 5.0])
def test_saturated_torque_has_its_limits(sharpness) -> None:
    small = torque_saturation.saturated_torque(0.13e-6, 1e-6, 0.02, sharpness)
    large = torque_saturation.saturated_torque(0.13e9, 1e9, 0.02, sharpness)
    assert small == pytest.approx(0.13e-6, rel=1e-6)
    assert large == pytest.approx(0.13 / 0.02, rel=1e-6)


def test_saturated_motor_holds_less_pressure(knee, effect) -> None:
    """At holding, K_T i of the saturated motor lies within static friction of D dp."""
    time = np.arange(0.0, 1.0, 1e-3)
    saturated = effect("torque_saturation", saturation=0.02, sharpness=2.0)
    out = knee.run(time, 30.0, saturated, leakage=2e-15)
    torque = 0.13 * 30.0 / np.sqrt(1 + 0.6**2)
    load = knee.model().value("pump_displacement") * (out["pressure_a"] - out["pressure_b"])
    held = (out["motor_speed"][1:] == 0) & (out["motor_speed"][:-1] == 0)
    assert held.any()
    assert np.all(np.abs(torque - load[1:][held]) <= 0.2537 * (1 + 1e-9))
