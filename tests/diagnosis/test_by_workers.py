"""A diagnosis whose candidates are fitted by workers is that of one process, to the last bit."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

import eha_bench
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive"), seconds=1.5)


def assert_same(one: Diagnosis, two: Diagnosis) -> None:
    assert one.to_dict() | {"seconds": 0} == two.to_dict() | {"seconds": 0}
    assert one.revised.to_yaml() == two.revised.to_yaml()
    np.testing.assert_array_equal(one.revised.vector(), two.revised.vector())


def test_processes_find_the_same(dataset: Path) -> None:
    assert_same(eha_bench.diagnose(dataset), eha_bench.diagnose(dataset, workers=2))
