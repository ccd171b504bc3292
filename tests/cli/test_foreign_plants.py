"""Plants declared from their data sheets, and their recordings, by the command line."""

import json
from pathlib import Path

import pytest

# what the recordings hide, as their maker says it
HIDDEN = {"H": [], "K": ["coulomb_friction"]}


@pytest.mark.slow(17)
@pytest.mark.parametrize("letter", HIDDEN)
def test_foreign_plant_is_diagnosed_right(
    cli, repository: Path, shared_data: Path, tmp_path: Path, letter: str
) -> None:
    assert (shared_data / "foreign_samples" / letter).is_dir()
    dataset = repository / "examples" / "foreign_plants" / letter / "dataset.yaml"
    cli("diagnose", dataset, "--out", "out", check=0)
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [item["id"] for item in found["effects"]] == HIDDEN[letter]
    assert found["verdict"] == ("effect" if HIDDEN[letter] else "none")
    for error in found["error"]["holdout"].values():
        if HIDDEN[letter]:
            assert error["after"] <= 1.3 * error["noise_floor"]
