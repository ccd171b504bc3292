"""Commands that were given more often than they were logged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.command_lead import led, led_like, period_of, share_of
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.command_leads import command_leads, lead_notes
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from spindle_plant import SPINDLE

FAST = 1e-3
"""Time from one value that the controller gives to the next, s."""
NOISE = {"motor_speed": 0.05}


@given(st.floats(0.0, 0.5), st.floats(1e-4, 1.0))
def test_a_lead_says_how_often_a_command_was_given(share: float, tick: float) -> None:
    assert share_of(period_of(share, tick), tick) == pytest.approx(share, abs=1e-9)


def test_every_second_value_leads_by_a_quarter_of_its_period() -> None:
    # what is held for half a period, and then halfway to the next value
    assert share_of(1e-3, 2e-3) == pytest.approx(0.25)
    assert share_of(2e-3, 2e-3) == share_of(5e-3, 2e-3) == 0.0
    assert share_of(0.0, 2e-3) == 0.5


def _run(command: np.ndarray, time: np.ndarray, speed: np.ndarray, name: str = "log"):
    reading = Recording(time, {"current_command": command, "motor_speed": speed})
    run = Run(name, Path("log.mcap"), None, False, False, Use.TRAIN, lambda: reading)
    return admit(run, reading, ["current_command"], ["motor_speed"])


def test_the_mean_of_the_values_that_were_given_is_what_acts() -> None:
    # of a parabola the formula is exact
    fast = np.arange(400) * FAST
    command = 3.0 + 40.0 * fast - 70.0 * fast**2
    for every in (2, 4):
        measured = _run(command[::every], fast[::every], fast[::every])
        own = led(measured, {"current_command": FAST}).inputs["current_command"]
        mean = command.reshape(-1, every).mean(axis=1)
        np.testing.assert_allclose(own[2:-3], mean[2:-3], rtol=1e-12)


def test_jumps_and_gaps_lead_nothing() -> None:
    time = np.arange(40) * 2e-3
    command = np.sin(20.0 * time)
    command[20:] += 30.0
    time[30:] += 0.1
    own = led(_run(command, time, time), {"current_command": 1e-3})
    change = own.inputs["current_command"] - command
    assert np.abs(change[:19]).max() > 0.0
    assert change[19] == change[29] == change[39] == 0.0
    assert own.given_every == {"current_command": 1e-3}
    # a run of another rate is led by its own share: of a straight line by three eighths
    slow = _run(np.arange(20.0), np.arange(20) * 4e-3, np.arange(20.0))
    other = led_like(slow, [own])
    np.testing.assert_allclose(other.inputs["current_command"][:-1], np.arange(19.0) + 0.375)


def _recorded(model, every: int, seed: int, *, delay: float = 0.0):
    """A run whose command is given every millisecond and logged every so many of them."""
    fast = np.arange(6000) * FAST
    command = 9.0 * np.sin(2.0 * np.pi * 4.0 * fast) + 6.0 * np.sin(2.0 * np.pi * 11.0 * fast)
    acting = np.interp(fast - delay, fast, command)
    speed = model.plant.simulate(
        model.vector(), Drive(fast, {"current_command": acting}, {}), 1e-4
    )[:, 0]
    noisy = speed + NOISE["motor_speed"] * np.random.default_rng(seed).standard_normal(fast.size)
    return _run(command[::every], fast[::every], noisy[::every])


def _fitted(model, measured):
    problem = Problem(model.plant, cut_windows(measured, NOISE), NOISE, 2e-4)
    vector = model.vector()
    problem.prepare(vector)
    free = free_parameters(problem.places, ["shaft.inertia", "drag.viscous"], vector)
    return problem, levenberg_marquardt(problem, vector, free)


@pytest.mark.parametrize("every", [1, 2, 4])
def test_how_often_a_command_was_given_is_told(tmp_path: Path, every: int) -> None:
    (tmp_path / "plant.yaml").write_text(SPINDLE)
    model = load_model(tmp_path / "plant.yaml")
    problem, fit = _fitted(model, _recorded(model, every, seed=every))
    periods, there, best = command_leads(problem, fit)
    if every == 1:
        assert periods == {}
        assert there is problem
        return
    assert periods["current_command"] == pytest.approx(FAST, rel=0.15)
    # only noise is left, where the log alone left many times as much
    assert np.mean(fit.residual**2) > 2.0
    assert np.mean(best.residual**2) == pytest.approx(1.0, abs=0.1)
    assert best.values()["shaft.inertia"] == pytest.approx(9e-4, rel=2e-3)
    (note,) = lead_notes([there.windows[0].measured])
    assert f"ms and logged every {every} ms: it is taken to act" in note


def test_a_delay_is_no_lead(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SPINDLE)
    model = load_model(tmp_path / "plant.yaml")
    problem, fit = _fitted(model, _recorded(model, 1, seed=7, delay=2e-3))
    assert np.mean(fit.residual**2) > 2.0
    assert command_leads(problem, fit)[0] == {}


def test_a_model_that_errs_by_much_tells_no_lead(tmp_path: Path) -> None:
    """Errors of a wrong model have some of every shape; it is asked again beside what was found."""
    (tmp_path / "plant.yaml").write_text(SPINDLE)
    model = load_model(tmp_path / "plant.yaml")
    measured = _recorded(model, 2, seed=3)
    told = _fitted(model, measured)
    assert command_leads(*told)[0]
    wrong = 0.4 * np.sin(2.0 * np.pi * 23.0 * measured.time)
    speed = measured.outputs.index("motor_speed")
    off = measured.values.copy()
    off[:, speed] += wrong
    problem, fit = _fitted(model, replace(measured, values=off))
    assert np.mean(fit.residual**2) > 8.0
    assert command_leads(problem, fit) == ({}, problem, fit)
