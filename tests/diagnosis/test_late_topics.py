"""A topic stamped late by many ticks is the log's; a lag of a sensor as long is the sensor's."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from eha_bench.diagnosis.calibrate import calibrate
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.late_topics import with_late_topics
from eha_bench.diagnosis.outcome.diagnosis import Verdict

PLANT = """\
plant: fan
nodes:
  rotor: {kind: rotation, inertia: 2e-3 kg*m^2}
elements:
  motor: {kind: motor, on: rotor, torque_constant: 0.29 N*m/A, voltage_constant: 0.29 V*s/rad,
          resistance: 4 ohm, supply_voltage: 12 V}
  drag:  {kind: friction, on: rotor, viscous: 1.1e-3 N*m*s/rad, coulomb: 0.025 N*m}
inputs: {duty: motor.duty}
channels: {motor_speed: rotor.speed, motor_angle: rotor.angle}
calibrate:
  - {parameter: rotor.inertia, within: 20 %}
  - {parameter: motor.torque_constant, within: 10 %}
  - {parameter: motor.voltage_constant, within: 10 %}
  - {parameter: drag.viscous, within: 30 %}
  - {parameter: drag.coulomb, within: 30 %}
"""
CHANNELS = """\
clock: log
channels:
  duty:        {topic: /command, field: value, unit: ""}
  motor_speed: {topic: /drive, field: value, unit: rad/s}
  motor_angle: {topic: /encoder, field: value, unit: rad}
"""
WITHOUT_FRICTION = PLANT.replace(", coulomb: 0.025 N*m}", "}").replace(
    "  - {parameter: drag.coulomb, within: 30 %}\n", ""
)
LATE = 12e-3
LAG = 8e-3
STEP, EVERY = 1e-4, 50
_TORQUES = ("rotor.inertia", "motor.torque_constant")


def _messages(number: int, lag: float, seconds: float) -> dict[str, np.ndarray]:
    """Drive the fan by steps and a sine, and read it at 200 Hz, its speed with a lag."""
    generator = np.random.default_rng(number)
    time = np.arange(0.0, seconds, STEP)
    levels = np.repeat(generator.uniform(-0.6, 0.6, 16), time.size // 16)
    duty = levels + 0.25 * np.sin(2.0 * np.pi * (1.5 + 0.5 * number) * time)
    duty = np.repeat(duty[::EVERY], EVERY)
    speed = filtered = angle = 0.0
    read = []
    for k, value in enumerate(duty):
        if k % EVERY == 0:
            read.append((value, filtered, angle))
        torque = 0.3 * (12.0 * value - 0.3 * speed) / 4.0
        friction = 1e-3 * speed + 0.03 * np.tanh(speed / 0.3)
        angle += STEP * speed
        speed += STEP * (torque - friction) / 1.8e-3
        filtered = filtered + STEP * (speed - filtered) / lag if lag else speed
    command, speeds, angles = np.array(read).T
    noise = generator.standard_normal((2, command.size))
    return {
        "/command": command,
        "/drive": speeds + 0.05 * noise[0],
        "/encoder": angles + 2e-3 * noise[1],
    }


def _write(path: Path, messages: dict[str, np.ndarray], late: dict[str, float]) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("number", "jsonschema", b'{"type": "object"}')
        rows = []
        for topic, values in messages.items():
            channel = writer.register_channel(topic, "json", schema)
            by = round(1e9 * late.get(topic, 0.0))
            rows += [(10**12 + by + 5_000_000 * k, channel, v) for k, v in enumerate(values)]
        for stamp, channel, value in sorted(rows):
            data = json.dumps({"value": float(value)}).encode()
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()


def _dataset(
    folder: Path,
    *,
    late: dict[str, float],
    lag: float = 0.0,
    plant: str = PLANT,
    seconds: float = 2.0,
) -> Path:
    """Record four runs of the fan, in a topic for each channel."""
    (folder / "plant.yaml").write_text(plant, encoding="utf-8")
    (folder / "channels.yaml").write_text(CHANNELS, encoding="utf-8")
    runs = ""
    for number in range(4):
        _write(folder / f"run{number}.mcap", _messages(number, lag, seconds), late)
        runs += f"  - {{log: run{number}.mcap, use: {'holdout' if number == 3 else 'train'}}}\n"
    path = folder / "dataset.yaml"
    path.write_text(
        f"model: plant.yaml\nchannels: channels.yaml\ninputs: [duty]\nruns:\n{runs}",
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize("late", [LATE, -LATE, 10e-3])
def test_stamps_late_by_many_ticks_are_found(tmp_path: Path, late: float) -> None:
    """Two ticks sharp as well, of which no fit has a number: it ticks with the commands."""
    found = calibrate(_dataset(tmp_path, late={"/drive": late}))
    item = found.lateness["motor_speed"]
    assert item.value == pytest.approx(late, abs=0.2e-3)
    assert item.low < late < item.high
    assert item.high - item.low < 0.5e-3
    # readings of motion tell each size over the torque constant
    inertia, constant = (found.parameters[name].value for name in _TORQUES)
    assert inertia / constant == pytest.approx(1.8e-3 / 0.3, rel=0.01)
    how = "late" if late > 0.0 else "early"
    (note,) = (note for note in found.notes if "a property of the log" in note)
    assert re.match(
        rf"the stamps of 'motor_speed' are [\d.]+ ms {how} \([\d.]+ to [\d.]+ ms\)", note
    )
    speed = found.holdout["motor_speed"]
    assert speed.after_windows < 1.1 * speed.noise_floor


@pytest.mark.slow(5)
def test_a_late_topic_is_no_effect(tmp_path: Path) -> None:
    found = diagnose(_dataset(tmp_path, late={"/drive": LATE}))
    assert found.verdict is Verdict.NONE
    assert not found.effects
    assert found.lateness["motor_speed"].value == pytest.approx(LATE, abs=0.2e-3)


@pytest.mark.slow(26)
def test_a_late_topic_beside_another_cause_is_no_lag(tmp_path: Path) -> None:
    """Of an undeclared friction more remains than of the clock: only beside it does that show."""
    dataset = _dataset(tmp_path, late={"/drive": LATE}, plant=WITHOUT_FRICTION, seconds=4.0)
    found = diagnose(dataset)
    assert [item.id for item in found.effects] == ["coulomb_friction"]
    assert found.lateness["motor_speed"].value == pytest.approx(LATE, abs=0.2e-3)


@pytest.mark.slow(8)
@pytest.mark.parametrize("late", [0.0, 0.7e-3])
def test_a_sensors_lag_is_no_late_topic(tmp_path: Path, late: float) -> None:
    found = diagnose(_dataset(tmp_path, late={"/drive": late}, lag=LAG))
    assert [item.id for item in found.effects] == ["sensor_lag"]
    assert found.effects[0].parameters["time_constant"].value == pytest.approx(LAG, rel=0.1)
    if late:
        assert found.lateness["motor_speed"].value == pytest.approx(late, abs=0.3e-3)


def test_where_all_readings_are_late_their_clock_is_not_blamed(tmp_path: Path) -> None:
    """It may be the machine that acts late."""
    dataset = load_dataset(_dataset(tmp_path, late={"/drive": LATE, "/encoder": LATE}))
    base = calibrated_baseline(dataset)
    assert with_late_topics(base, lambda *_: None, loud=True) is base
