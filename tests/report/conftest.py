"""The made-up run and the browser that the report's tests share."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from sample_run import SampleRun, sample_run


@pytest.fixture(scope="session")
def sample() -> SampleRun:
    return sample_run()
