"""A drive that filters the speed it reports: the sensor's lag, not the machine's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

FILTER = 8e-3
"""Time constant of the filter, s."""

PLANT = """\
plant: fan
nodes:
  rotor: {kind: rotation, inertia: 2e-3 kg*m^2}
elements:
  motor: {kind: motor, on: rotor, torque_constant: 0.29 N*m/A, voltage_constant: 0.29 V*s/rad,
          resistance: 4 ohm, supply_voltage: 12 V}
  drag:  {kind: friction, on: rotor, viscous: 1.1e-3 N*m*s/rad}
inputs: {duty: motor.duty}
channels: {motor_speed: rotor.speed}
calibrate:
  - {parameter: rotor.inertia, within: 20 %}
  - {parameter: motor.torque_constant, within: 10 %}
  - {parameter: motor.voltage_constant, within: 10 %}
  - {parameter: drag.viscous, within: 30 %}
"""


def recorded(folder: Path, number: int, coulomb: float) -> str:
    """Drive the fan by steps and a sine, and read its filtered speed at 200 Hz; name the log."""
    generator = np.random.default_rng(number)
    step, every = 1e-4, 50
    time = np.arange(0.0, 4.0, step)
    levels = np.repeat(generator.uniform(-0.6, 0.6, 16), time.size // 16)
    duty = levels + 0.25 * np.sin(2.0 * np.pi * (1.5 + 0.5 * number) * time)
    duty = np.repeat(duty[::every], every)
    speed = filtered = 0.0
    read = []
    for k, value in enumerate(duty):
        if k % every == 0:
            read.append(filtered)
        torque = 0.3 * (12.0 * value - 0.3 * speed) / 4.0
        speed += step * (torque - 1e-3 * speed - coulomb * np.tanh(speed / 0.3)) / 1.8e-3
        filtered += step * (speed - filtered) / FILTER
    noise = 0.05 * generator.standard_normal(len(read))
    values = {"duty": duty[::every], "motor_speed": np.array(read) + noise}
    write(folder / f"run{number}.mcap", Recording(time[::every], values))
    return f"run{number}.mcap"


def dataset(folder: Path, coulomb: float) -> Path:
    """Declare the fan, with the dry friction that it has, if any, and record four runs of it."""
    plant = PLANT
    if coulomb:
        plant = plant.replace("viscous: 1.1e-3 N*m*s/rad}", "viscous: 1.1e-3 N*m*s/rad, "
                              "coulomb: 0.025 N*m}") + (
            "  - {parameter: drag.coulomb, within: 30 %}\n"
        )  # fmt: skip
    (folder / "plant.yaml").write_text(plant, encoding="utf-8")
    runs = "".join(
        f"  - {{log: {recorded(folder, k, coulomb)}, use: {'holdout' if k == 3 else 'train'}}}\n"
        for k in range(4)
    )
    path = folder / "dataset.yaml"
    path.write_text(f"model: plant.yaml\ninputs: [duty]\nruns:\n{runs}", encoding="utf-8")
    return path


def test_a_filtered_ramp_is_behind_by_the_filters_time(tmp_path: Path) -> None:
    """Of a speed that grows by a rad/s in each second, a reading is a tau behind: y = a (t - tau).

    A motor of a current that holds makes such a ramp.
    """
    text = PLANT.replace(", voltage_constant: 0.29 V*s/rad", "")
    text = text.replace("          resistance: 4 ohm, supply_voltage: 12 V}", "}").replace(
        "torque_constant: 0.29 N*m/A,\n", "torque_constant: 0.29 N*m/A"
    )
    text = text.replace("viscous: 1.1e-3", "viscous: 0").replace(
        "duty: motor.duty", "current_command: motor.current"
    )
    text += f"effects:\n  - {{effect: sensor_lag, time_constant: {FILTER} s, at: motor_speed}}\n"
    (tmp_path / "plant.yaml").write_text(text.split("calibrate:")[0], encoding="utf-8")
    effects = text[text.index("effects:") :]
    (tmp_path / "model.yaml").write_text(f"model: plant.yaml\n{effects}", encoding="utf-8")
    model = load_model(tmp_path / "model.yaml")
    time = np.arange(0.0, 0.1, 1e-3)
    drive = Drive(time, {"current_command": np.full(time.size, 2.0)}, {"motor_speed": 0.0})
    read = model.plant.simulate(model.vector(), drive, 1e-4)[:, 0]
    slope = 2.0 * 0.29 / 2e-3
    assert time[80:] - read[80:] / slope == pytest.approx(FILTER, rel=1e-3)


@pytest.mark.slow(5)
def test_the_filter_of_a_speed_is_named(tmp_path: Path) -> None:
    """Dry friction tells it from a lag of the current, though the speed alone is read."""
    found = diagnose(dataset(tmp_path, 0.03))
    assert [item.id for item in found.effects] == ["sensor_lag"]
    size = found.effects[0].parameters["time_constant"]
    assert size.value == pytest.approx(FILTER, rel=0.1)
    speed = found.holdout["motor_speed"]
    assert speed.after < 1.2 * speed.noise_floor


@pytest.mark.slow(30)
def test_of_a_linear_machine_either_lag_is_said_to_look_like_the_other(tmp_path: Path) -> None:
    found = diagnose(dataset(tmp_path, 0.0))
    assert found.verdict is Verdict.EFFECT
    (named,) = (item.id for item in found.effects)
    assert named in ("sensor_lag", "current_lag")
    (note,) = (note for note in found.notes if f"would look much like {named}" in note)
    assert note.startswith("'motor_speed' alone is read")
