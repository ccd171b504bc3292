"""Dry friction that falls with speed where one level is declared."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.fit.candidates import all_starts
from eha_bench.plants.effects.stribeck_friction import falling_friction
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive

PLANT = """\
plant: slide
nodes: {{rod: {{kind: translation, mass: 10 kg}}}}
elements:
  seals:  {{kind: friction, on: rod, viscous: 100 N*s/m{dry}}}
  motor:  {{kind: linear_motor, on: rod, force_constant: 1 N/V}}
inputs:   {{command: motor.voltage}}
channels: {{position: rod.position, velocity: rod.velocity}}
"""


@pytest.mark.parametrize(
    ("form", "speed", "share"),
    [
        (0.0, 0.0, 1.0), (0.0, 0.01, math.exp(-1.0)), (0.0, -0.02, math.exp(-4.0)),
        (1.0, 0.0, 1.0), (1.0, 0.01, math.exp(-1.0)), (1.0, -0.02, math.exp(-2.0)),
    ],
)  # fmt: skip
def test_it_falls_from_its_excess_to_the_declared_level(form, speed, share) -> None:
    assert falling_friction(30.0, speed, 20.0, form, 0.01) == pytest.approx(30.0 + 20.0 * share)


def _model(folder: Path, dry: str) -> Model:
    path = folder / "plant.yaml"
    path.write_text(PLANT.format(dry=dry))
    return load_model(path)


@pytest.mark.parametrize(
    ("dry", "tried"),
    [
        ("", False),  # there `coulomb_friction` falls with speed
        (", coulomb: 30 N", True),
        (", coulomb: 30 N, static: 50 N, stribeck_speed: 10 mm/s", False),
    ],
)
def test_it_is_tried_where_one_level_is_declared(tmp_path: Path, dry: str, tried: bool) -> None:
    model = _model(tmp_path, dry)
    starts = all_starts(model.plant.layout, model.vector(), (), ())
    assert any(start.candidate == "stribeck_friction" for start in starts) is tried


def test_it_is_the_element_that_declares_its_static_level(tmp_path: Path) -> None:
    """Known answer: the element's own law with F_s = F_c + F_e."""
    time = np.arange(0.0, 2.0, 1e-3)
    drive = Drive(time, {"command": 45.0 * np.sin(2.0 * np.pi * time) + 10.0}, {})

    def run(model: Model) -> np.ndarray:
        return np.asarray(model.plant.simulate(model.vector(), drive, 1e-4))

    declared = _model(tmp_path, ", coulomb: 30 N, static: 50 N, stribeck_speed: 10 mm/s")
    expected = run(declared)
    plain = _model(tmp_path, ", coulomb: 30 N")
    values = {"excess_force": 20.0, "form": "gaussian", "stribeck_velocity": 0.01}
    vector = plain.vector()
    index = plain.plant.layout.index
    for name, value in values.items():
        parameter = plain.plant.layout.by_key[f"stribeck_friction.{name}"]
        number = parameter.choices.index(value) if parameter.choices else value
        vector[index[f"stribeck_friction.{name}"]] = float(number)
    found = np.asarray(plain.plant.simulate(vector, drive, 1e-4))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.abs(run(plain) - expected).max() > 1e-3
