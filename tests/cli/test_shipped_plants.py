"""Every shipped plant has a suite that runs on it and keeps its limits, by the command line."""

import json
from pathlib import Path

import pytest


# each compiles a kernel of its own on a new machine
@pytest.mark.parametrize(
    "name",
    [
        "position_servo",
        pytest.param("valve_cylinder", marks=pytest.mark.slow),
        pytest.param("single_rod_eha", marks=pytest.mark.slow),
        pytest.param("geared_servo", marks=pytest.mark.slow),
    ],
)
def test_suite_of_a_shipped_plant_keeps_its_limits(
    cli, repository: Path, tmp_path: Path, name: str
) -> None:
    cli("run", repository / "suites" / f"{name}.yaml", "--out", "out", check=0)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "passed"
    limited = [
        score for trial in result["trials"] for score in trial["scores"] if score.get("limit")
    ]
    assert len(limited) >= 4
    assert all(score["status"] == "passed" and score["value"] is not None for score in limited)
    channel = result["trials"][0]["scores"][0]["channel"]
    assert channel in (tmp_path / "out" / "report.html").read_text()
