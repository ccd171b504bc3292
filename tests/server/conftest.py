"""The folder that most tests of the pages ask for."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from asking import Served, asking, nights


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    """Twelve nights of one metric, looked at once."""
    watched = tmp_path / "results"
    nights(watched)
    found = asking(watched)
    yield found
    found.watch.__exit__(None, None, None)
