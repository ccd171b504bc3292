"""A pressure sensor of another gain: no effect of the library, and named with its factor."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Verdict
from eha_bench.diagnosis.outcome.followed_doubt import promised
from eha_bench.diagnosis.outcome.scaled_sensor import ScaledSensor
from eha_bench.recordings import write
from eha_bench.report.diagnosis_text import headline

PLANT = """\
plant: press
nodes:
  tank:    {kind: reservoir, pressure: 0 bar}
  ambient: {kind: reservoir, pressure: 0 bar}
  cap:     {kind: volume, bulk_modulus: 0.93 GPa, pressure: 100 bar}
  shaft:   {kind: rotation}
  rod:     {kind: translation, mass: 47 kg}
elements:
  pump:     {kind: pump, on: shaft, from: tank, to: cap, displacement: 2.03e-6 m^3/rad}
  slip:     {kind: laminar_leakage, between: [cap, tank], conductance: 1.8e-12 m^3/(s*Pa)}
  cylinder: {kind: cylinder, on: rod, a: cap, b: ambient, area_a: 5 cm^2, area_b: 5 cm^2,
             volume_a: 100 cm^3}
  coil:     {kind: spring, on: rod, stiffness: 50 kN/m}
  seals:    {kind: friction, on: rod, coulomb: 90 N, viscous: 900 N*s/m}
channels: {motor_speed: shaft.speed, pressure_cap: cap.pressure, rod_position: rod.position}
calibrate:
  - {parameter: pump.displacement, within: 3 %}
  - {parameter: slip.conductance, within: 30 %}
  - {parameter: cap.bulk_modulus, within: 15 %}
  - {parameter: rod.mass, within: 10 %}
  - {parameter: seals.coulomb, within: 25 %}
  - {parameter: seals.viscous, within: 20 %}
"""
AREA, STIFFNESS, MASS, COULOMB, VISCOUS = 5e-4, 5e4, 50.0, 100.0, 1e3
DISPLACEMENT, LEAK, BULK, DEAD = 2e-6, 2e-12, 1e9, 1e-4


def recorded(folder: Path, number: int, gain: float, drift: float) -> str:
    """Move the press about 0.1 m, read it at 250 Hz, and return the log's name."""
    generator = np.random.default_rng(number)
    step, every = 1e-4, 40
    time = np.arange(0.0, 1.5, step)
    phases = generator.uniform(0.0, 2.0 * np.pi, 3)
    speeds = sum(
        size * np.sin(2.0 * np.pi * rate * (1.0 + 0.2 * number) * time + phase)
        for size, rate, phase in zip((20.0, 25.0, 15.0), (0.4, 1.1, 2.3), phases, strict=True)
    )
    speeds = np.asarray(speeds + LEAK * 1e7 / DISPLACEMENT)
    position, velocity, pressure = 0.1, 0.0, STIFFNESS * 0.1 / AREA
    read = []
    for k, speed in enumerate(speeds.tolist()):
        if k % every == 0:
            read.append((pressure, position))
        flow = DISPLACEMENT * speed - LEAK * pressure - AREA * velocity
        pressure += step * BULK / (DEAD + AREA * position) * flow
        friction = COULOMB * np.tanh(velocity / 1e-3) + VISCOUS * velocity
        velocity += step * (AREA * pressure - friction - STIFFNESS * position) / MASS
        position += step * velocity
    pressures, positions = np.array(read).T
    values = {
        "motor_speed": speeds[::every],
        "pressure_cap": (gain + drift * time[::every]) * pressures
        + 1e4 * generator.standard_normal(pressures.size),
        "rod_position": positions + 2e-5 * generator.standard_normal(positions.size),
    }
    write(folder / f"run{number}.mcap", Recording(time[::every], values))
    return f"run{number}.mcap"


def diagnosed(folder: Path, gain: float, drift: float = 0.0) -> Diagnosis:
    """Record three runs of the press with its sensor's gain, and diagnose them."""
    (folder / "plant.yaml").write_text(PLANT, encoding="utf-8")
    runs = "".join(
        f"  - {{log: {recorded(folder, k, gain, drift)}, "
        f"use: {'holdout' if k == 2 else 'train'}}}\n"
        for k in range(3)
    )
    path = folder / "dataset.yaml"
    path.write_text(f"model: plant.yaml\ninputs: [motor_speed]\nruns:\n{runs}", encoding="utf-8")
    return diagnose(path)


@pytest.mark.slow(20)
def test_a_gain_is_named_and_the_model_is_that_of_right_readings(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.88)
    assert found.verdict is Verdict.UNKNOWN
    assert found.unknown is not None
    assert (found.unknown.equation, found.unknown.at) == ("measurement", "pressure_cap.sensor")
    (note,) = (note for note in found.notes if note.startswith("CAUTION: 'pressure_cap' reads"))
    said = re.search(r"reads ([\d.]+) times", note)
    assert said is not None
    assert float(said[1]) == pytest.approx(0.88, rel=0.01)
    assert not found.effects
    for item in found.holdout.values():
        if np.isfinite(item.noise_floor):
            assert item.after < 1.5 * item.noise_floor
    # the sentence says what the note does
    words = f"'pressure_cap' reads {said[1]} times"
    assert found.unknown.sensor.startswith(words)
    assert headline(found)[1].startswith(f"A sensor reads wrongly: {words}")


@pytest.mark.slow(12)
def test_a_gain_that_changes_is_no_constant_factor(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.9, 0.1)
    assert found.verdict is not Verdict.NONE
    assert not found.misread


@pytest.mark.slow
def test_a_right_sensor_is_left_alone(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 1.0)
    assert found.verdict is Verdict.NONE
    assert not found.misread


def test_a_sensor_that_is_read_right_is_no_pass_and_hides_no_effect() -> None:
    base = cast(Baseline, SimpleNamespace(notes=("CAUTION: it reads 0.9 times what there is",)))
    sensor = ScaledSensor("pressure_a", 0.9, 0.99, base)
    fit = cast(Fit, None)
    told = sensor.decided(Decision(Verdict.NONE, fit, (), None))
    assert told.verdict is Verdict.UNKNOWN
    assert told.unknown is not None
    assert told.unknown.sensor == "'pressure_a' reads 0.9 times what there is"
    effect = Decision(Verdict.EFFECT, fit, (), None)
    assert sensor.decided(effect) is effect


def test_what_nothing_is_calibrated_beside_promises_by_itself() -> None:
    """By hand: y = f x with x twice too small asks for a factor of e, as a slope sees it: x - y."""
    problem = _Scaled()
    fit = Fit(np.zeros(0), (), problem.residual(np.zeros(0)), np.zeros((3, 0)), 1.0)
    (found,) = promised(cast(Problem, problem), fit, [_Factor()]).values()
    assert found.factor == pytest.approx(np.exp(1.0), rel=1e-3)
    assert found.fall == pytest.approx(14.0, rel=1e-3)


class _Scaled:
    """Readings 2, 4, 6 of what is simulated as a factor times 1, 2, 3, in a noise of 1."""

    soft = 1e6

    def __init__(self, factor: float = 1.0) -> None:
        self.factor = factor

    def residual(self, _vector: FloatArray) -> FloatArray:
        return np.array([1.0, 2.0, 3.0]) * (self.factor - 2.0)


class _Factor:
    """The factor of what is simulated."""

    def times(
        self, _problem: Problem, vector: FloatArray, factor: float
    ) -> tuple[Problem, FloatArray]:
        return cast(Problem, _Scaled(factor)), vector

    def is_material(self, _problem: Problem, factor: float, least: float) -> bool:
        return abs(np.log(factor)) >= least

    def said(self, factor: float) -> str:
        return f"{factor} times"
