"""What continuous integration says where it cannot go on."""

import os
import subprocess
from pathlib import Path


def test_without_the_data_it_ends_at_once_with_a_sentence(repository: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        ["bash", str(repository / ".ci" / "run")],
        env=os.environ | {"CI": "true", "EHA_BENCH_SHARED": str(tmp_path)},
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"There is no reference data at {tmp_path}/data" in done.stderr
    assert "name it in EHA_BENCH_SHARED" in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("CI failed: machine ")
    assert "== environment" not in done.stdout
    assert "s  in all" in done.stdout
