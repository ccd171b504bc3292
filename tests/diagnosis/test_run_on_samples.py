"""The loop closes on the sample rig (slow): verdicts, equations, errors, determinism."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.plants.model import load_model

ANSWERS = {
    "A": "entrained_air",
    "B": "pressure_dependent_friction",
    "C": "current_lag",
    "E": "pressure_sensor_lag",
}


@pytest.mark.slow(24)
@pytest.mark.parametrize("case", ANSWERS)
def test_the_missing_effect_is_named_and_the_holdout_error_falls_to_the_noise(
    shared_data: Path, tmp_path: Path, case: str
):
    found = diagnose(shared_data / "rig_samples" / case / "dataset.yaml", tmp_path)
    assert found.verdict.value == "effect"
    assert [item.id for item in found.effects] == [ANSWERS[case]]
    for name, error in found.holdout.items():
        assert error.after <= 1.3 * error.noise_floor, name
    assert load_model(tmp_path / "revised.yaml").effects[-1].id == ANSWERS[case]


@pytest.mark.slow
def test_nothing_is_accused_where_nothing_is_missing(shared_data: Path, tmp_path: Path):
    diagnose(shared_data / "rig_samples" / "D" / "dataset.yaml", tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "none"
    assert written["effects"] == []


@pytest.mark.slow(74)
def test_what_no_effect_explains_is_localised(shared_data: Path, tmp_path: Path):
    diagnose(shared_data / "rig_samples" / "F" / "dataset.yaml", tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "unknown"
    assert written["unknown"]["equation"] == "actuation"
    assert written["unknown"]["variables"] == ["time"]
    assert written["unknown"]["period"] == pytest.approx(1 / 1.3, rel=0.05)


@pytest.mark.slow(25)
@pytest.mark.parametrize(("case", "effects"), [("M", []), ("N", ["entrained_air"])])
def test_a_plain_log_is_read_as_it_is(
    shared_data: Path, tmp_path: Path, case: str, effects: list[str]
):
    found = diagnose(shared_data / "rig_samples" / case / "dataset.yaml", tmp_path)
    assert [item.id for item in found.effects] == effects
    assert found.verdict.value == ("effect" if effects else "none")
    for name, error in found.holdout.items():
        assert error.after <= 1.1 * error.noise_floor, name
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert {*written["lateness"]} == {"pressure_a", "pressure_b"}
    for late in written["lateness"].values():
        assert late["low"] < 0.25e-3 < late["high"]
        assert late["high"] - late["low"] < 0.05e-3
    for size in written["effects"][0]["parameters"].values() if effects else ():
        assert size["low"] <= 0.01 <= size["high"]
    notes = " ".join(written["notes"])
    assert "messages lost" in notes
    assert "the stamps of 'pressure_a' are" in notes
