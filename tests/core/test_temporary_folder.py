"""Temporary folders go with their process, also with one that is killed."""

import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from eha_bench.core.temporary_folder import TemporaryFolder, remove_if_left

OWNER = """
import sys, time
from eha_bench.core.temporary_folder import TemporaryFolder
folder = TemporaryFolder("eha-bench-test-")
(folder.path / "inside").write_text("x")
print(folder.path, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def owner() -> tuple[subprocess.Popen[str], Path]:
    process = subprocess.Popen(
        [sys.executable, "-c", OWNER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def test_it_goes_with_its_owner(place: Path) -> None:
    folder = TemporaryFolder("eha-bench-test-")
    assert folder.path.parent == place
    (folder.path / "inside").write_text("x")
    del folder
    assert list(place.iterdir()) == []


def test_what_a_killed_process_left_goes_with_the_next_and_what_is_held_stays(place: Path) -> None:
    killed, left = owner()
    living, held = owner()
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    assert (left / "inside").is_file()
    (place / "eha-bench-other").mkdir()
    folder = TemporaryFolder("eha-bench-test-")
    assert not left.exists()
    assert (held / "inside").is_file()
    assert (place / "eha-bench-other").is_dir()
    living.communicate("")
    assert not held.exists()
    folder.remove()
    assert not folder.path.exists()


def test_a_link_is_not_followed(place: Path) -> None:
    (place / "mine").mkdir()
    (place / "mine" / "kept").write_text("x")
    (place / "eha-bench-test-link").symlink_to(place / "mine")
    remove_if_left(place / "eha-bench-test-link")
    assert (place / "mine" / "kept").is_file()


def test_one_that_was_removed_before_it_was_locked_is_made_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = tempfile.mkdtemp
    taken: list[str] = []

    def first_is_taken(**arguments: str) -> str:
        folder = made(**arguments)
        if not taken:
            Path(folder).rmdir()
            taken.append(folder)
        return folder

    monkeypatch.setattr(tempfile, "mkdtemp", first_is_taken)
    folder = TemporaryFolder("eha-bench-test-")
    assert folder.path.is_dir()
    assert str(folder.path) not in taken
