"""Target files for the tests, made from the shipped one."""

from collections.abc import Callable
from pathlib import Path

import pytest

from eha_bench.core.shipped import shipped_rig
from eha_bench.targets.can.drive import CanDrive
from eha_bench.targets.can.load import load_drive

Writer = Callable[..., Path]


@pytest.fixture(autouse=True)
def _own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EHA_BENCH_STATE", str(tmp_path / "state"))


@pytest.fixture
def target(tmp_path: Path) -> Writer:
    """Write a target.yaml based on the shipped drive, with more lines; return its path."""

    def write(more: str = "", base: str = "eha_drive.yaml", name: str = "target.yaml") -> Path:
        path = tmp_path / name
        path.write_text(f"target: can\nbase: {shipped_rig(base)}\n{more}", encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def eha_drive() -> CanDrive:
    """The shipped drive like the paper's."""
    return load_drive(shipped_rig("eha_drive.yaml"))


@pytest.fixture(scope="session")
def cia402() -> CanDrive:
    """The shipped CiA 402 drive."""
    return load_drive(shipped_rig("cia402_drive.yaml"))
