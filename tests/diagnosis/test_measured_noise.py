"""What is taken for noise on a real arm: an encoder's step, and no motion of the arm."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import gather

STEP = 1.534e-3
"""Of 12 bits a turn, rad."""


@pytest.mark.parametrize("joint", ["rotation", "elbow", "wrist_pitch"])
def test_the_angles_noise_is_about_that_of_its_step(
    joint: str, repository: Path, shared_data: Path, tmp_path: Path
) -> None:
    """An elbow that crept had been a sensor of 0.0115 rad that remembers, 26 times as loud."""
    folder = tmp_path / "so101"
    shutil.copytree(repository / "examples" / "so101", folder)
    path = folder / joint / "dataset.yaml"
    path.write_text(path.read_text().replace("../../../../shared/data", str(shared_data)))
    _, _, noise, _ = gather(load_dataset(path))
    assert 0.9 * STEP / 12**0.5 < noise["angle"] < 2.0 * STEP
