"""A file appears under its name whole or not at all."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from eha_bench.core.atomic_file import replacing, write_text


@pytest.mark.parametrize("durable", [False, True])
def test_takes_the_name_when_all_went_well(tmp_path: Path, durable: bool) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with replacing(target, durable=durable) as part:
        part.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_leaves_what_was_there_when_something_goes_wrong(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def break_off() -> None:
        with replacing(target) as part:
            part.write_text("ne")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_file_that_was_never_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), replacing(tmp_path / "a.txt"):
        pass


def test_several_may_write_the_same_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"

    def write(text: str) -> None:
        with replacing(target) as part:
            part.write_text(text * 1000)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, "abcdefgh"))
    assert target.read_text() in {letter * 1000 for letter in "abcdefgh"}
    assert len(list(tmp_path.iterdir())) == 1


def test_a_name_of_the_longest_length(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 255)
    with replacing(target) as part:
        part.write_text("x")
    assert target.read_text() == "x"


def test_an_error_names_the_file_and_not_the_one_beside_it(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(OSError, match="taken") as error:
        write_text(tmp_path / "taken", "text")
    assert ".part" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_long_name_of_wide_letters_can_be_written(tmp_path):
    name = "\N{SNOWMAN}" * 80  # 240 bytes: a name may have 255
    write_text(tmp_path / name, "text")
    assert (tmp_path / name).read_text() == "text"
