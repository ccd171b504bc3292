"""A disk without room, a folder that cannot be written: a sentence, whole files, none half."""

import json
import os
import shutil
from pathlib import Path

import pytest

from forked import Forked

from .conftest import Cli

NAMES = ("run", "score", "compare", "csv", "parquet", "mf4", "recover", "init")


@pytest.fixture(scope="module")
def ran(first_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite, two results of it, and a recording."""
    folder = tmp_path_factory.mktemp("ran")
    shutil.copy(first_run / "tiny.yaml", folder)
    for side in ("a", "b"):
        shutil.copytree(first_run / "out", folder / side)
    shutil.copy(folder / "a" / "recordings" / "hold-0.mcap", folder / "log.mcap")
    return folder


def command(name: str, ran: Path, out: Path) -> list[str]:
    """Return a command that writes into a folder."""
    log = str(ran / "log.mcap")
    return {
        "run": ["run", str(ran / "tiny.yaml"), "--out", str(out / "run")],
        "score": ["score", log, "--out", str(out / "score")],
        "compare": ["compare", str(ran / "a"), str(ran / "b"), "--out", str(out / "compare")],
        "csv": ["export", log, str(out / "log.csv")],
        "parquet": ["export", log, str(out / "log.parquet")],
        "mf4": ["export", log, str(out / "log.mf4")],
        "recover": ["recover", log, str(out / "again.mcap")],
        "init": ["init", str(out / "project")],
    }[name]


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_is_a_sentence_and_leaves_no_half_file(
    forked: Forked, ran: Path, tmp_path: Path, name: str
) -> None:
    done = forked.run(*command(name, ran, tmp_path), folder=tmp_path, room=1000)
    assert done.returncode == (3 if name == "run" else 2), done.stderr
    assert "Traceback" not in done.stderr
    told = [line for line in done.stderr.splitlines() if line.startswith("eha-bench: ")]
    assert len(told) == 1, done.stderr
    assert "File too large" in told[0]
    assert "room" in told[0]  # the way out
    if name != "run":
        assert str(tmp_path) in told[0]
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not [path for path in left if path.name.endswith(".part")]
    for path in left:
        if path.suffix == ".json":
            json.loads(path.read_text())
        assert path.stat().st_size > 0 or path.suffix == ".lock", path
    assert not [path for path in left if path.suffix in {".csv", ".parquet", ".mf4", ".mcap"}]


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_that_cannot_be_written_is_a_sentence(
    cli: Cli, ran: Path, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "read-only"
    folder.mkdir()
    folder.chmod(0o555)
    if os.access(folder, os.W_OK):  # as the superuser: there nobody makes files
        folder = Path("/proc/self/net")
    done = cli(*command(name, ran, folder), check=2)
    (told,) = [line for line in done.stderr.splitlines() if line.startswith("eha-bench: ")]
    assert str(folder) in told
    assert not list(tmp_path.rglob("*.part"))
