"""What every test shares: the data beside the repository, and how Hypothesis and plots behave."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import pytest
from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent))

from forked import Forked
from locked import in_ci

REPOSITORY = Path(__file__).resolve().parents[1]

# Figures are drawn to files only: no test may need a display.
mpl.use("Agg")

# Deadlines measure the machine, not the code: compilation alone breaks them.
settings.register_profile("default", deadline=None)
settings.register_profile(
    "ci",
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)


settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci" if in_ci() else "default"))


def _seconds(item: pytest.Item) -> float:
    """About how long a test takes by itself, where its mark says so."""
    return max((float(mark.args[0]) for mark in item.iter_markers("slow") if mark.args), default=0)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests: all workers wait for one that is begun last."""
    items.sort(key=_seconds, reverse=True)


def find_shared_data() -> Path:
    """The folder of measured and reference data, whether or not it exists."""
    shared = os.environ.get("EHA_BENCH_SHARED")
    return (Path(shared) if shared else REPOSITORY.parent / "shared") / "data"


@pytest.fixture(scope="session")
def forked() -> Iterator[Forked]:
    """Runs commands in processes of their own, without the start of Python for each."""
    commands = Forked()
    yield commands
    commands.close()


@pytest.fixture(scope="session")
def repository() -> Path:
    """The top folder of the repository."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured and reference data; skips without it, but fails in CI."""
    data = find_shared_data()
    if not data.is_dir():
        reason = (
            f"no reference data at {data}: put the folder 'shared' beside the repository, "
            "or name it in EHA_BENCH_SHARED"
        )
        if in_ci():
            pytest.fail(reason)
        pytest.skip(reason)
    return data
