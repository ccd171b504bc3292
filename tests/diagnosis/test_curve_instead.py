"""An effect that one unknown law stands for better, alone, is no cause."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome import curve_instead as module
from eha_bench.diagnosis.outcome.curve_instead import curve_instead
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.plants.registry import get_plant
from eha_bench.recordings import write

SERVO = """\
plant: servo
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.12 N*m/A, current_limit: 41 A}
  drag:  {kind: friction, on: shaft, coulomb: 0.13 N*m, viscous: 0.005 N*m*s/rad}
inputs:   {current_command: motor.current}
channels: {motor_speed: shaft.speed}
calibrate: [shaft.inertia, drag.viscous, drag.coulomb]
"""
INERTIA, CONSTANT, COULOMB, VISCOUS, CUBIC = 8.5e-4, 0.12, 0.14, 4.5e-3, 2e-7
SIZE = 1000


def driven(amplitude: float, frequency: float, seed: int) -> Recording:
    """Turn a shaft that a drag with the cube of its speed slows, always one way, and read it."""
    time = np.arange(0.0, 3.0, 2e-3)
    command = 6.0 + amplitude * np.sin(2.0 * np.pi * frequency * time)
    step, speed, read = 1e-4, 0.0, np.empty(time.size)
    for tick, current in enumerate(command):
        read[tick] = speed
        for _ in range(20):
            torque = CONSTANT * current - VISCOUS * speed - CUBIC * speed**3
            moved = speed + step * torque / INERTIA
            held = step * COULOMB / INERTIA
            speed = math.copysign(max(abs(moved) - held, 0.0), moved)
    read += 0.3 * np.random.default_rng(seed).standard_normal(time.size)
    return Recording(time, {"current_command": command, "motor_speed": read})


@pytest.mark.slow(10)
def test_a_drag_with_the_cube_of_the_speed_is_no_torque_that_saturates(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SERVO)
    write(tmp_path / "a.mcap", driven(4.0, 0.6, 1))
    write(tmp_path / "b.mcap", driven(3.0, 0.4, 2))
    (tmp_path / "dataset.yaml").write_text(
        "model: plant.yaml\ninputs: [current_command]\n"
        "runs: [{log: a.mcap, use: train}, {log: b.mcap, use: holdout}]\n"
    )
    found = diagnose(tmp_path / "dataset.yaml")
    assert found.verdict is Verdict.UNKNOWN
    assert found.unknown is not None
    assert found.unknown.equation == "torque"
    assert found.unknown.variables == ("motor_speed",)
    refused = [note for note in found.notes if note.startswith("torque_saturation is not accepted")]
    assert "and a curve of motor_speed at 'shaft' explains" in refused[0]
    error = found.holdout["motor_speed"]
    assert error.after < 1.2 * error.noise_floor < 0.2 * error.before


@pytest.fixture
def costs(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """Costs above the noise's: without anything, with the effects, and with the curve alone."""
    above = {"missing": 1000.0, "effects": 300.0, "curve": 10.0}
    floor = SOFT_MEAN * SIZE
    monkeypatch.setattr(module, "cost_of", lambda _, vector: floor + above[vector])
    monkeypatch.setattr(
        module, "_with_curve", lambda *_: SimpleNamespace(cost=floor + above["curve"])
    )
    return above


def finished(*names: str, left: float = 300.0) -> Any:
    """A search whose effects leave something."""
    gain = SimpleNamespace(gain=700.0)
    effects = [SimpleNamespace(start=SimpleNamespace(candidate=n), comparison=gain) for n in names]
    long = SimpleNamespace(size=SIZE, soft=1.0)
    return SimpleNamespace(
        thresholds=DEFAULT, effects=effects, accepted=effects, is_all_but_a_form=left < 20.0,
        problem=SimpleNamespace(at_step=lambda _: long, plant=get_plant("eha_knee")),
        base=SimpleNamespace(vector="missing"), fit=SimpleNamespace(vector="effects"),
    )  # fmt: skip


CURVE: Any = SimpleNamespace(
    position="",
)
THERE = ("torque_saturation",)
LEFT = Remainder(0.3, "torque", "shaft", "motor_speed", 0.99, curve=CURVE)


def test_a_curve_that_leaves_less_alone_speaks_against_the_effect(costs: dict[str, float]) -> None:
    refused = curve_instead(finished("torque_saturation"), LEFT, 1e-3)
    assert refused is not None
    assert refused.note == (
        "torque_saturation is not accepted: with it 70 % of what is missing is explained, and a "
        "curve of motor_speed at 'shaft' explains 99 % without it"
    )
    costs["curve"] = 160.0  # of 300: little less than the effect leaves
    assert curve_instead(finished("torque_saturation"), LEFT, 1e-3) is None


def test_a_law_that_leaves_more_than_a_form_at_its_own_place_is_another_one(
    costs: dict[str, float],
) -> None:
    """A valve that opens with the square of its command is smooth near nothing, as a dead band."""
    left = Remainder(0.3, "torque", "shaft", "motor_speed", 0.6, (), THERE, CURVE)
    assert curve_instead(finished("torque_saturation"), left, 1e-3) is not None
    costs["curve"] = 160.0
    assert curve_instead(finished("torque_saturation"), left, 1e-3) is None


def test_a_curve_of_the_pressure_that_an_effect_follows_is_its_own_law(
    costs: dict[str, float],
) -> None:
    there = ("seal_friction",)
    left = Remainder(0.4, "force", "rod", "pressure_a", 0.9, (), there, CURVE)
    assert curve_instead(finished("seal_friction"), left, 1e-3) is None
    speed = Remainder(0.4, "force", "rod", "piston_velocity", 0.9, (), there, CURVE)
    assert curve_instead(finished("seal_friction"), speed, 1e-3) is not None


def test_a_small_cause_beside_a_large_one_stands(
    costs: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without it the curve leaves what it explains, which is less than half of what remains."""
    costs |= {"missing": 10_000.0, "effects": 4000.0, "without": 5000.0, "curve": 1000.0}
    monkeypatch.setattr(module, "without", lambda *_: SimpleNamespace(vector="without"))
    both = finished("torque_saturation", "current_lag", left=4000.0)
    assert curve_instead(both, LEFT, 1e-3) is None
    costs["curve"] = 400.0  # it stands for the cause as well
    assert curve_instead(both, LEFT, 1e-3) is not None


@pytest.mark.parametrize(
    ("left", "remains"),
    [
        (Remainder(0.3, "torque", "shaft", "motor_speed", 0.7, curve=CURVE), 300.0),
        (Remainder(0.3, "torque", "shaft"), 300.0),  # no curve explains any of it
        # the law of the effect itself
        (Remainder(0.15, "torque", "shaft", "motor_speed", 0.99, (), THERE, CURVE), 300.0),
        # which the curve does not follow
        (Remainder(0.4, "torque", "shaft", "motor_speed", 0.3, (), THERE, CURVE), 300.0),
        (LEFT, 10.0),  # as little as another form leaves
    ],
)  # fmt: skip
def test_what_else_remains_says_nothing_against_it(
    costs: dict[str, float], left: Remainder, remains: float
) -> None:
    assert curve_instead(finished("torque_saturation", left=remains), left, 1e-3) is None
