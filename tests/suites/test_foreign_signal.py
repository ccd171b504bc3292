"""Another package's signal works like a built-in one: a file and an entry point."""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from writing import load, refusal

from eha_bench.core import plugins
from eha_bench.suites import trial_from_source
from eha_bench.suites.schema import suite_schema

CODE = """
from typing import Literal
import numpy as np
from eha_bench.core.signal import Edge
from eha_bench.suites.signals.signal_model import Level, Seconds, SignalModel

class Square(SignalModel):
    kind: Literal["square"]
    amplitude: Level
    period: Seconds

    @property
    def duration(self):
        return 2 * self.period

    def __call__(self, time):
        turn = np.mod(np.clip(time, 0, None) / self.period, 1)
        return self.amplitude * np.where(turn < 0.5, 1, -1)

class NoSignal:
    pass
"""


@contextmanager
def installed(folder: Path, points: str) -> Iterator[None]:
    """A package with these entry points on the search path, as if installed."""
    info = folder / "foreign_square-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "foreign_square.py").write_text(CODE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-square\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[eha_bench.signals]\n{points}")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        forget()
        yield
    sys.modules.pop("foreign_square", None)
    forget()


def forget() -> None:
    """Have the installed packages looked at again."""
    plugins._entry_points.cache_clear()
    plugins._group.cache_clear()


@pytest.fixture
def square(tmp_path: Path) -> Iterator[None]:
    with installed(tmp_path / "site", "square = foreign_square:Square\n"):
        yield


@pytest.fixture
def faulty(tmp_path: Path) -> Iterator[None]:
    points = "broken = foreign_square:Absent\nhollow = foreign_square:NoSignal\n"
    with installed(tmp_path / "site", points):
        yield


SUITE = """
trials:
  - id: one
    mode: pressure
    signal: {kind: square, amplitude: 2 MPa, period: 100 ms}
"""


@pytest.mark.usefixtures("square")
def test_foreign_signal_is_read_and_kept(tmp_path: Path) -> None:
    (trial,) = load(tmp_path, SUITE).trials
    assert trial.duration == 0.2
    np.testing.assert_array_equal(trial.reference(np.array([0.01, 0.06])), [2e6, -2e6])
    assert trial_from_source(trial.source) == trial
    assert math.isfinite(trial.signal.duration)


@pytest.mark.usefixtures("square")
def test_its_units_are_checked_like_any_others(tmp_path: Path) -> None:
    error = refusal(tmp_path, SUITE.replace("2 MPa", "2 deg"))
    assert "wrong dimension" in error.what
    assert error.where.key == "trials.one.signal.amplitude"


@pytest.mark.usefixtures("faulty")
def test_broken_packages_are_told(tmp_path: Path) -> None:
    error = refusal(tmp_path, SUITE.replace("kind: square", "kind: broken"))
    assert "signal 'broken' cannot be loaded" in error.what
    assert error.where.line == 5
    error = refusal(tmp_path, SUITE.replace("kind: square", "kind: hollow"))
    assert "is not a SignalModel" in error.what


@pytest.mark.usefixtures("square")
def test_schema_offers_it() -> None:
    definitions = suite_schema()["$defs"]
    signal = definitions["TrialFile"]["properties"]["signal"]
    assert "square" in signal["properties"]["kind"]["enum"]
    assert "period" in definitions["Square"]["properties"]
