"""Known answers of the sensors' effects: the machine moves on as before."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline


@pytest.fixture
def run(knee):
    time = np.arange(0.0, 0.2, 1e-3)
    command = 14.0 * np.sin(2 * np.pi * 6 * time) + 4.0

    def simulate(*effects, **options):
        return knee.run(time, command, *effects, **options)

    return simulate


def test_sensor_lag_is_a_first_order_filter_of_the_true_pressure(run, knee, effect) -> None:
    tau = 3e-3
    true, read = run(), run(effect("pressure_sensor_lag", time_constant=tau))
    np.testing.assert_array_equal(read["motor_speed"], true["motor_speed"])
    fine = knee.run(
        np.arange(0.0, 0.1, 5e-5), np.repeat(14.0 * np.sin(2 * np.pi * 6 * np.arange(0, 0.1, 1e-3))
        + 4.0, 20),
    )["pressure_a"]  # fmt: skip
    lagging, filtered = fine[0], [fine[0]]
    for left, right in itertools.pairwise(fine):
        middle = 0.5 * (left + right)
        lagging = middle + (lagging - middle) * np.exp(-5e-5 / tau)
        filtered.append(lagging)
    np.testing.assert_allclose(
        read["pressure_a"][:100], np.array(filtered)[::20], atol=2e-4 * np.ptp(fine)
    )


def test_sensor_lag_reaches_63_percent_of_a_step(knee, effect) -> None:
    """A pressure that jumps (as imposed by a measured channel) is read with the lag."""
    time = np.arange(0.0, 0.02, 1e-3)
    pressure = np.where(time > 0.5e-3, 5e6, 0.6e6)
    inputs = {"motor_speed": np.zeros(time.size), "pressure_a": pressure}
    out = knee.run(time, inputs, effect("pressure_sensor_lag", time_constant=4e-3), step=1e-6)
    # the imposed pressure runs up within the first millisecond
    read = (out["pressure_a"] - 0.6e6) / 4.4e6
    np.testing.assert_allclose(
        1 - read[1:], (1 - read[1]) * np.exp(-(time[1:] - 1e-3) / 4e-3), rtol=1e-3
    )


def test_one_slow_pressure_sensor_leaves_the_other_as_it_is(run, effect) -> None:
    true, read = run(), run(effect("pressure_sensor_lag", time_constant=3e-3, at="pressure_b"))
    both = run(effect("pressure_sensor_lag", time_constant=3e-3))
    np.testing.assert_array_equal(read["pressure_a"], true["pressure_a"])
    np.testing.assert_array_equal(read["pressure_b"], both["pressure_b"])
    assert np.max(np.abs(both["pressure_a"] - true["pressure_a"])) > 1e4


def test_a_filtered_position_follows_its_first_order_law(knee, effect) -> None:
    """By SciPy's solution of tau dx_read/dt = x - x_read along the true position."""
    tau = 6e-3
    time = np.arange(0.0, 0.4, 1e-3)
    current = 10.0 * np.sin(2 * np.pi * 5 * time) * np.exp(-2.0 * time)
    slow = effect("position_sensor_lag", time_constant=tau)
    true = knee.run(time, current, locked=False)["piston_position"]
    read = knee.run(time, current, slow, locked=False)["piston_position"]
    path = CubicSpline(time, true)
    expected = solve_ivp(
        lambda t, x: (path(t) - x) / tau, (0.0, time[-1]), [true[0]], t_eval=time, rtol=1e-9,
        atol=1e-12, max_step=1e-3,
    ).y[0]  # fmt: skip
    assert np.max(np.abs(true - read)) > 50.0 * np.max(np.abs(expected - read))


def test_a_filtered_position_is_behind_a_steady_motion_from_the_first_sample_on(
    knee, effect
) -> None:
    time = np.arange(0.0, 0.02, 1e-3)
    speed = 0.05
    inputs = {"piston_velocity": np.full(time.size, speed), "current_command": np.zeros(time.size)}
    slow = effect("position_sensor_lag", time_constant=4e-3)
    true = knee.run(time, inputs, locked=False)["piston_position"]
    read = knee.run(time, inputs, slow, locked=False)["piston_position"]
    np.testing.assert_allclose(true - read, speed * 4e-3, rtol=1e-3)


@pytest.mark.parametrize(
    ("sensor", "a", "b"), [("pressure_a", 1, 0), ("pressure_b", 0, 1), ("all", 1, 1)]
)
def test_offset_is_added_to_the_reading_alone(run, effect, sensor, a, b) -> None:
    true = run()
    read = run(effect("pressure_sensor_offset", offset=0.3e6, at=sensor))
    np.testing.assert_array_equal(read["motor_speed"], true["motor_speed"])
    np.testing.assert_allclose(read["pressure_a"] - true["pressure_a"], a * 0.3e6, rtol=1e-9)
    np.testing.assert_allclose(read["pressure_b"] - true["pressure_b"], b * 0.3e6, rtol=1e-9)


def test_first_reading_with_an_offset_starts_the_true_pressure(run, effect) -> None:
    offset = effect("pressure_sensor_offset", offset=0.3e6, at="pressure_a")
    read = run(offset, initial={"pressure_a": 3.3e6, "pressure_b": 1e6})
    true = run(initial={"pressure_a": 3.0e6, "pressure_b": 1e6})
    assert read["pressure_a"][0] == pytest.approx(3.3e6)
    np.testing.assert_allclose(read["motor_speed"], true["motor_speed"], rtol=1e-9)


def test_offset_comes_after_the_lag(run, effect) -> None:
    lag, offset = effect("pressure_sensor_lag"), effect("pressure_sensor_offset", offset=0.3e6)
    both, lagging = run(lag, offset), run(lag)
    np.testing.assert_allclose(both["pressure_a"] - lagging["pressure_a"], 0.3e6, rtol=1e-9)
