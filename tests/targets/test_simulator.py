"""The simulator as a target: repeatable, seeded, safe, interruptible."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.control.controller import Context, Controller, NoGains
from eha_bench.control.controller_file import ControllerSet, ControllerSpec
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError
from eha_bench.core.limit import Bounds, SafetyLimit
from eha_bench.core.signal import Signal
from eha_bench.core.trial import ControlMode, Piston, Setup, Trial
from eha_bench.core.yaml_file import StrictModel
from eha_bench.plants.model import Model
from eha_bench.targets.simulator import Simulator
from eha_bench.targets.target import Ending


class Constant(Signal):
    """Holds one current."""

    def __init__(self, value: float) -> None:
        self.value = value

    @property
    def duration(self) -> float:
        return 0.2

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.full_like(time, self.value)


class Misbehaving(Controller):
    """Does what its class attribute says at tick 50."""

    act = "nan"

    def __init__(self, gains: StrictModel, context: Context) -> None:
        self.tick = 0

    def step(self, reference: float, reading: Mapping[str, float]) -> float:
        self.tick += 1
        if self.tick == 50:
            if self.act == "interrupt":
                raise KeyboardInterrupt
            return math.nan
        return reference


class Interrupting(Misbehaving):
    """Behaves like a person who presses Ctrl-C."""

    act = "interrupt"


LOCKED = Setup(piston=Piston.LOCKED)
TRIAL = Trial("hold", Constant(10.0), ControlMode.CURRENT, LOCKED, 0.2, settle=0.05)


def simulator(kind: type[Controller] | None = None, **options: object) -> Simulator:
    modes = {"current": ControllerSpec(kind, NoGains())} if kind else {}
    return Simulator(Model("eha_knee"), ControllerSet(modes), **options)


def test_the_same_seed_gives_the_same_recording_and_another_does_not() -> None:
    first, second = (simulator().run(TRIAL, 0).recording for _ in range(2))
    other = simulator().run(TRIAL, 1).recording
    for name in first.values:
        assert np.array_equal(first[name], second[name])
    assert not np.array_equal(first["pressure_a"], other["pressure_a"])


def test_noise_and_counts_are_those_of_the_sensor() -> None:
    quiet = simulator(sensors={}).run(TRIAL, 0).recording
    noisy = simulator().run(TRIAL, 0).recording
    error = noisy["pressure_a"] - quiet["pressure_a"]
    assert np.std(error) == pytest.approx(math.hypot(0.03e6, 0.0146e6 / math.sqrt(12)), rel=0.15)
    counts = noisy["pressure_a"] / 0.0146e6
    assert np.allclose(counts, np.round(counts))


def test_settling_runs_before_the_signal_and_a_locked_piston_stays() -> None:
    recording = simulator(sensors={}).run(TRIAL, 0).recording
    assert recording.metadata["signal_start"] == "0.05"
    assert recording.time[0] == 0.0
    assert len(recording) == 250
    assert not np.any(recording["piston_position"])


def test_a_safety_limit_stops_the_run_and_says_why() -> None:
    limit = SafetyLimit("pressure_a", Bounds(high=2e6), "<= 2 MPa")
    outcome = simulator().run(replace(TRIAL, safety=(limit,)), 0)
    assert outcome.ending is Ending.SAFETY_STOP
    assert "pressure_a <= 2 MPa" in outcome.reason
    assert len(outcome.recording) < 250
    assert outcome.recording["current_command"][-1] == 0.0
    assert np.all(outcome.recording["pressure_a"][:-1] <= 2e6)


def test_a_controller_that_asks_for_nan_is_a_fault() -> None:
    outcome = simulator(Misbehaving).run(TRIAL, 0)
    assert outcome.ending is Ending.FAULT
    assert len(outcome.recording) == 50
    assert "asked for nan" in outcome.reason


def test_ctrl_c_keeps_what_was_recorded() -> None:
    outcome = simulator(Interrupting).run(TRIAL, 0)
    assert outcome.ending is Ending.INTERRUPTED
    assert len(outcome.recording) == 49
    assert np.all(np.isfinite(outcome.recording["current_command"]))


def test_a_start_outside_the_stroke_is_refused() -> None:
    trial = replace(TRIAL, setup=Setup(initial={"piston_position": 0.05}))
    with pytest.raises(
        InputError, match=r"piston_position of 0.05 m, outside its range.*-0\.04 and 0\.04"
    ):
        simulator().check(trial)


def test_an_input_that_no_suite_drives_is_refused_with_what_it_may_drive() -> None:
    trial = Trial("push", Constant(30.0), ControlMode("force", "N"), Setup(), 0.2)
    target = Simulator(Model("valve_cylinder"), ControllerSet({}))
    with pytest.raises(
        InputError, match=r"controls force, an input of valve_cylinder that stays"
    ) as refused:
        target.check(trial)
    assert "its command, valve_command" in str(refused.value)
