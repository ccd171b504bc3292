"""`eb.write` writes what the name of the file says."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.core.recording import Recording

RECORDING = Recording(np.arange(100) / 1e3, {"current": np.arange(100) / 7})


@pytest.mark.parametrize(
    ("name", "format_"), [("a.mcap", "mcap"), ("a.csv", "csv"), ("a.PARQUET", "parquet")]
)
def test_the_ending_is_the_format(tmp_path: Path, name: str, format_: str) -> None:
    path = eb.write(tmp_path / name, RECORDING)
    assert eb.recordings.info(path).format == format_
    back = eb.read(path)
    assert np.array_equal(back["current"], RECORDING["current"])
    assert np.array_equal(back.time, RECORDING.time)


@pytest.mark.parametrize("name", ["a", "run.2024-01-01", "a.mcap.part", "a.csv.mcap"])
def test_a_name_that_says_no_other_format_is_an_mcap(tmp_path: Path, name: str) -> None:
    path = eb.write(tmp_path / name, RECORDING)
    assert path == tmp_path / name
    assert eb.recordings.info(path).format == "mcap"
    assert np.array_equal(eb.read(path)["current"], RECORDING["current"])


@pytest.mark.parametrize("name", ["a.json", "a.MAT", "a.db3", "a.mcap.gz"])
def test_formats_that_are_only_read_are_refused(tmp_path: Path, name: str) -> None:
    known = r"end it in \.mcap, \.csv, \.parquet, \.mf4"
    with pytest.raises(InputError, match=rf"'{name}' names a format that is not written; {known}"):
        eb.write(tmp_path / name, RECORDING)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.mcap", "a.csv"])
def test_what_was_read_is_not_written_over(tmp_path: Path, name: str) -> None:
    path = eb.write(tmp_path / name, RECORDING)
    before = path.read_bytes()
    with pytest.raises(InputError, match="is read here and would be overwritten; name another"):
        eb.write(path, eb.read(path).between(0.01, 0.02))
    assert path.read_bytes() == before
    with pytest.raises(InputError, match="is read here"):
        eb.recordings.export(tmp_path / "b.csv", eb.read(eb.write(tmp_path / "b.csv", RECORDING)))


@pytest.mark.parametrize("write", [eb.write, eb.recordings.export])
def test_what_was_read_is_known_from_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[..., Path]
) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write(tmp_path / name / "run.csv", RECORDING)
    monkeypatch.chdir(tmp_path / "one")
    read = eb.read("run.csv")
    assert read.source == "run.csv"
    # another file of that name is not the one that was read
    monkeypatch.chdir(tmp_path / "two")
    write("run.csv", read.between(0.01, 0.02))
    assert len(eb.read("run.csv")) == 10
    # and that one is under any name
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is read here"):
        write("one/run.csv", read.between(0.01, 0.02))
    assert len(eb.read("one/run.csv")) == 100


def test_an_mcap_that_was_read_is_known_from_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "one").mkdir()
    eb.write(tmp_path / "one" / "run.mcap", RECORDING)
    monkeypatch.chdir(tmp_path / "one")
    read = eb.read("run.mcap")
    monkeypatch.chdir(tmp_path)
    eb.write("run.mcap", read)
    with pytest.raises(InputError, match="is read here"):
        eb.write("one/run.mcap", read)


@pytest.mark.parametrize("name", ["a.csv", "a.mcap"])
def test_what_was_read_is_looked_for_once(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[object] = []
    for room in ("saving", "exporting"):
        monkeypatch.setattr(
            f"eha_bench.recordings.{room}.spare_inputs", lambda *own: looked.append(own)
        )
    eb.write(tmp_path / name, RECORDING)
    assert len(looked) == 1
