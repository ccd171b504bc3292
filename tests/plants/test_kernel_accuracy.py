"""The knee's kernel against an independent event-driven solution and against itself."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

STATES = ("motor_speed", "pressure_a", "pressure_b", "piston_position", "piston_velocity")


def _held(time, amplitude, frequency):
    return amplitude * np.sin(2 * np.pi * frequency * time)


def _compare(knee, hybrid, time, commands, *, locked, tolerance=1e-4, **parameters):
    reference = hybrid(knee, **parameters)
    rest = knee.model(**parameters).value("initial_pressure")
    start = np.array([0.0, rest, rest, 0.0, 0.0])
    truth = reference.simulate(time, commands, start, locked=locked)
    got = knee.run(time, commands, locked=locked, **parameters)
    for column, name in enumerate(STATES):
        span = np.ptp(truth[:, column])
        if span > 0:
            worst = np.max(np.abs(got[name] - truth[:, column])) / span
            assert worst < tolerance, f"{name}: {worst:.2e} of its range"


@pytest.mark.parametrize("amplitude", [11.0, 15.8, 24.0, 60.0])
@pytest.mark.parametrize("which", ["printed_knee", "knee"])
def test_locked_step_agrees_with_event_driven_radau(request, hybrid, which, amplitude) -> None:
    knee = request.getfixturevalue(which)
    time = np.arange(0.0, 0.1, 1e-3)
    limit = knee.model().value("current_limit")
    _compare(knee, hybrid, time, np.full(time.size, min(amplitude, limit)), locked=True)


@pytest.mark.parametrize("which", ["printed_knee", "knee"])
def test_locked_sine_agrees_with_event_driven_radau(request, hybrid, which) -> None:
    knee = request.getfixturevalue(which)
    time = np.arange(0.0, 0.2, 2e-3)
    _compare(knee, hybrid, time, _held(time, 24.0, 6.7), locked=True)


@pytest.mark.parametrize("which", ["printed_knee", "knee"])
def test_free_motion_with_stick_slip_agrees_with_event_driven_radau(request, hybrid, which) -> None:
    knee = request.getfixturevalue(which)
    time = np.arange(0.0, 0.3, 4e-3)
    commands = _held(time, 4.0, 5.0)
    _compare(knee, hybrid, time, commands, locked=False, external_force=100.0)


def test_open_bypass_agrees_with_event_driven_radau(knee, hybrid) -> None:
    time = np.arange(0.0, 0.3, 5e-3)
    commands = _held(time, 6.0, 4.0)
    truth = hybrid(knee).simulate(
        time, commands, np.array([0.0, 0.6e6, 0.6e6, 0.0, 0.0]), locked=True,
        bypass=knee.model().value("bypass_conductance"),
    )  # fmt: skip
    got = knee.run(time, commands, bypass=True)
    for column, name in enumerate(STATES[:3]):
        worst = np.max(np.abs(got[name] - truth[:, column])) / np.ptp(truth[:, column])
        assert worst < 1e-4, name


@pytest.mark.parametrize("locked", [True, False])
def test_error_falls_with_the_square_of_the_step(knee, locked) -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    commands = 8.0 * np.sign(np.sin(2 * np.pi * 11 * time)) + 3.0 * np.sin(2 * np.pi * 5 * time)

    def run(step):
        out = knee.run(time, commands, locked=locked, step=step, external_force=150.0)
        return np.stack([out[name] for name in STATES], axis=1)

    truth = run(1e-3 / 1280)
    span = np.where(np.ptp(truth, axis=0) > 0, np.ptp(truth, axis=0), 1.0)
    errors = [np.sqrt(np.mean(((run(1e-3 / parts) - truth) / span) ** 2)) for parts in (20, 40, 80)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 1.7), (errors, orders)


def test_result_does_not_depend_on_where_a_run_is_cut(knee) -> None:
    """Ticks before `first` are history only, and a state handed on continues the run."""
    time = np.arange(0.0, 0.1, 1e-3)
    commands = _held(time, 15.0, 7.0)
    whole = knee.run(time, commands)
    cut = 40
    initial = {name: whole[name][cut] for name in (*STATES, "current")}
    rest = knee.run(time, commands, initial=initial, first=cut)
    assert np.all(np.isnan(rest["motor_speed"][:cut]))
    np.testing.assert_allclose(rest["pressure_a"][cut:], whole["pressure_a"][cut:], rtol=1e-12)


def test_a_long_step_crosses_a_check_valve_as_well_as_a_short_one() -> None:
    """What a valve that opens within a step lets in must not flow for the whole step."""
    values = {"valve_conductance": 6e-10, "charge_pressure": 0.6e6}
    model = Model("eha_knee", effects=(DeclaredEffect("anti_cavitation", values),))
    time = np.arange(0.0, 0.4, 1e-3)
    commands = _held(time, 20.0, 5.0)
    start = {"pressure_a": 0.6e6, "pressure_b": 0.6e6}
    drive = Drive(time, {"current_command": commands}, start, locked=True)
    truth = model.plant.simulate(model.vector(), drive, 5e-6)
    span = np.ptp(truth[:, 2])
    assert (truth[:, 2:4].min(axis=0) < 0.6e6).all()
    for step in (1e-4, 2e-4, 1e-3 / 3):
        errors = model.plant.simulate(model.vector(), drive, step) - truth
        assert np.abs(errors[:, 2:4]).max() < 1e-4 * span, step
