"""Friction at rest in a calibration: said where it was estimated, as declared where it is open."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.calibrate import Calibration, calibrate
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

EFFECTS = (DeclaredEffect("coulomb_friction", {"friction_force": 20.0}),)
DECLARED = {"mass": 95.0, "viscous_friction": 210.0}


def dataset(
    creep: float, calibrated: tuple[str, ...], mass: float = 95.0, **more: float
) -> Dataset:
    """Return a drive with dry friction that rests and reverses, as it is and as declared."""
    truth = Model("linear_drive", {**DECLARED, "mass": mass, "creep_speed": creep}, (), EFFECTS)
    time = np.arange(0.0, 2.0, 2e-3)
    voltage = np.clip(1.2 * np.sin(2 * np.pi * 0.7 * time), -0.9, 0.9)
    voltage *= np.sin(2 * np.pi * 0.2 * time)
    drive = Drive(time, {"voltage": voltage}, {"piston_position": 0.0})
    position = truth.plant.simulate(truth.vector(), drive, 1e-4)[:, 1]
    position = position + 2e-6 * np.random.default_rng(5).standard_normal(time.size)
    recording = Recording(time, {"voltage": voltage, "piston_position": position})
    run = Run("one", Path("one.csv"), None, False, False, Use.TRAIN, lambda: recording)
    model = Model("linear_drive", {**DECLARED, **more}, calibrated, EFFECTS)
    return Dataset(model, ("voltage",), (run,), "dataset.yaml")


def told(found: Calibration) -> list[str]:
    return [note for note in found.notes if "friction at rest" in note]


@pytest.mark.slow
def test_what_the_data_determine_is_estimated_and_said(tmp_path) -> None:
    found = calibrate(dataset(1e-3, ("mass",)), tmp_path)
    (note,) = told(found)
    assert "though not listed under `calibrate`: creep_speed = 0.001 (" in note
    item = found.parameters["creep_speed"]
    assert 0.0 < item.low < item.value < item.high
    assert found.model.parameters["creep_speed"] == pytest.approx(1e-3, rel=0.05)
    assert note in json.loads((tmp_path / "calibration.json").read_text())["notes"]


def test_what_is_declared_of_it_is_fitted_as_well() -> None:
    """None of the speeds that are tried is better than the declared one, and another one is."""
    found = calibrate(dataset(3e-3, ("mass",), creep_speed=2e-3))
    assert found.model.parameters["creep_speed"] == pytest.approx(3e-3, rel=0.1)


@pytest.mark.parametrize("declared", [0.0, 2e-5])
def test_what_the_data_leave_open_stays_as_declared(declared) -> None:
    """A mass that is wrong and may not move bends friction at rest, by no clear amount."""
    found = calibrate(dataset(0.0, (), 93.0, creep_speed=declared))
    if declared == 0.0:
        (note,) = told(found)
        assert "do not determine creep_speed (0 to" in note
        assert "keeps its declared value, 0 m/s" in note
    assert "creep_speed" not in found.parameters
    assert found.model.parameters == {**DECLARED, "creep_speed": declared}
    assert found.notes[0].startswith("nothing is calibrated: the model has no parameter under")


def test_what_was_not_touched_is_not_said() -> None:
    found = calibrate(dataset(0.0, ("mass",)))
    assert not told(found)
    assert not any("nothing is calibrated" in note for note in found.notes)
    # nor written into the model
    assert set(found.model.parameters) == set(DECLARED)
    assert found.parameters.keys() == {"mass"}


def test_what_is_under_calibrate_needs_no_note() -> None:
    found = calibrate(dataset(1e-3, ("mass", "creep_speed")))
    assert not told(found)
    assert found.parameters["creep_speed"].value == pytest.approx(1e-3, rel=0.05)
