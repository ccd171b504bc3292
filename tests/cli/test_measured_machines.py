"""Plants declared from data sheets, compared with measurements of real machines."""

import json
from pathlib import Path

import pytest

JOINTS = ("rotation", "elbow", "wrist_pitch")
SEALS = ("KDN", "NAPN", "O-ring257")


@pytest.mark.parametrize(
    "folder", [*(f"so101/{name}" for name in JOINTS), *(f"seal_friction/{name}" for name in SEALS)]
)
def test_an_example_is_valid_and_short(cli, repository: Path, shared_data: Path, folder) -> None:
    assert (shared_data / folder.partition("/")[0]).is_dir()
    example = repository / "examples" / folder
    cli("validate", example / "dataset.yaml", example / "plant.yaml", check=0)
    assert len((example / "plant.yaml").read_text().splitlines()) <= 60


def _part(repository: Path, shared_data: Path, tmp_path: Path) -> Path:
    """Write a part of the rotation's dataset: three motions to fit, one of another kind."""
    example, logs = repository / "examples" / "so101" / "rotation", shared_data / "so101"
    path = tmp_path / "dataset.yaml"
    fitted = "".join(
        f"  - {{log: '{logs / name}.csv', to: 12 s, use: train}}\n"
        for name in ("multisine", "step_response", "prbs_excitation")
    )
    path.write_text(
        f"model: '{example / 'plant.yaml'}'\nchannels: '{example / 'channels.yaml'}'\n"
        f"inputs: [command]\nruns:\n{fitted}"
        f"  - {{log: '{logs / 'friction_gravity'}.csv', use: unseen}}\n"
    )
    return path


@pytest.mark.slow(77)
def test_a_real_servo_is_diagnosed_and_predicts_another_kind_of_motion(
    cli, repository: Path, shared_data: Path, tmp_path: Path
) -> None:
    cli("diagnose", _part(repository, shared_data, tmp_path), "--out", "out", check=0)
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["complete"]
    assert found["verdict"] == "effect"
    assert "coulomb_friction" in {item["id"] for item in found["effects"]}
    error = found["error"]["unseen"]["angle"]
    assert error["after"] <= 0.5 * error["before"]
