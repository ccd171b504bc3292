"""What remains beside the effects that were found: where it acts, and what it follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import COARSE, calibrated_baseline, no_progress
from eha_bench.diagnosis.outcome.remainder import Remainder, acting_at, remainder
from eha_bench.diagnosis.outcome.whereabouts import element_of
from eha_bench.diagnosis.search.state import begin
from eha_bench.plants.model import load_model
from eha_bench.recordings import write

PLANT = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag: {kind: friction, on: shaft, viscous: 0.004 N*m*s/rad}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed}
calibrate: [shaft.inertia, drag.viscous]
"""
TICK, STEPS = 2e-3, 20


def with_drag(current: np.ndarray) -> np.ndarray:
    """Return the speed of a spindle that turns against air, k w |w|, by its own equation."""
    speed, out = 0.0, np.empty(current.size)
    for at, asked in enumerate(current):
        out[at] = speed
        for _ in range(STEPS):
            torque = 0.13 * asked - 0.004 * speed - 4e-5 * speed * abs(speed)
            speed += TICK / STEPS * torque / 9e-4
    return out


def test_a_drag_is_placed_in_the_torque_and_follows_the_speed(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(PLANT, encoding="utf-8")
    generator = np.random.default_rng(3)
    text = "model: plant.yaml\ninputs: [current_command]\nruns:\n"
    for number in range(2):
        current = np.repeat(generator.uniform(-8.0, 8.0, 30), 20)
        speed = with_drag(current) + 0.05 * generator.standard_normal(current.size)
        columns = {"current_command": current, "motor_speed": speed}
        write(tmp_path / f"{number}.mcap", Recording(TICK * np.arange(current.size), columns))
        text += f"  - {{log: {number}.mcap}}\n"
    (tmp_path / "dataset.yaml").write_text(text, encoding="utf-8")
    search = begin(calibrated_baseline(load_dataset(tmp_path / "dataset.yaml")))
    places = [("current_lag", "actuation", "motor")]
    found = remainder(search, places, COARSE, no_progress)
    assert found is not None
    assert (found.share, found.equation, found.variable) == (1.0, "torque", "motor_speed")
    assert found.explained > 0.9
    assert found.found_there == ()
    assert found.note.startswith("what remains (100 % of what was missing) acts in the torque")
    assert "a curve of motor_speed explains" in found.note
    places.append(("coulomb_friction", "torque", found.at))
    again = remainder(search, places, COARSE, no_progress)
    assert again is not None
    assert again.found_there == ("coulomb_friction",)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((), "the force balance nearly as well"),
        (("pressure_sensor_offset",), "its law may be another one, so its size has no interval"),
        (("a", "b"), "their laws may be other ones, so their sizes have no intervals"),
    ],
)
def test_an_effect_of_the_same_place_may_have_another_law(
    effects: tuple[str, ...], said: str
) -> None:
    left = Remainder(
        0.07, "measurement", "pressure_a.sensor", "pressure_a", 1.0, ("force",), effects
    )
    assert left.note.startswith(
        "what remains (7 % of what was missing) acts in the measurement of pressure_a; a curve of "
        "pressure_a explains 100 % of it; it could be in the force balance nearly as well"
    )
    assert left.note.endswith(said)
    assert left.to_dict()["variables"] == ["pressure_a"]


@pytest.mark.parametrize(
    ("place", "element"),
    [("valve.drive", "valve"), ("pressure_a.sensor", "pressure_a"), ("rod", "rod"), ("", "")],
)
def test_a_sensor_and_a_drive_are_at_their_channel_and_element(place: str, element: str) -> None:
    assert element_of(place) == element


def test_what_remains_in_both_pressures_is_at_either_sensor() -> None:
    """An offset of one of two sensors that are off had an interval without its true size."""
    plant = load_model(shipped_file("models/paper.yaml")).plant
    assert acting_at(plant, "pressures") == {"pressures", "pressure_a", "pressure_b"}
    assert acting_at(plant, "pressure_a.sensor") == {"pressure_a"}


def test_what_no_curve_explains_follows_nothing() -> None:
    left = Remainder(0.3, "torque")
    assert left.note.endswith(
        "acts in the torque balance; no curve of one variable explains any of it"
    )
    assert (left.to_dict()["at"], left.to_dict()["variables"]) == (None, [])


@pytest.mark.parametrize(
    ("left", "said"),
    [
        (Remainder(0.002, "flow"), "less than 1 % of what was missing) is too little to tell"),
        (Remainder(0.012, "flow", "a", "pressure_a", 0.3), "1 % of what was missing) is too"),
        (Remainder(0.012, "flow", "a", "pressure_a", 0.9), "1 % of what was missing) acts in the"),
        (Remainder(0.05, "flow"), "5 % of what was missing) acts in the"),
    ],
)
def test_a_remainder_that_may_be_a_form_has_a_place_only_where_a_curve_tells_it(
    left: Remainder, said: str
) -> None:
    assert left.note.startswith(f"what remains ({said}")


def test_a_form_that_is_off_is_not_said_to_follow_the_time() -> None:
    # a leak of another form changes with the pressure, and so all the time
    form = Remainder(0.05, "flow", "chamber_b", "time", 1.0, (), ("external_leakage",))
    assert "a curve of time" not in form.note
    assert "it follows no channel alone. external_leakage acts there, too" in form.note
    elsewhere = Remainder(0.05, "measurement", "pressure_a", "time", 0.9)
    assert "a curve of time explains 90 % of it" in elsewhere.note
