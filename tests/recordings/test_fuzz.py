"""Damaged recordings of every format: one sentence, in time, within memory (more in fuzz.py)."""

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.fixture(scope="module")
def fuzz() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def material(fuzz: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    folder = tmp_path_factory.mktemp("fuzz")
    return folder, fuzz.seeds(folder)


@pytest.mark.slow
def test_the_seeds_are_sound(fuzz: Any, material: tuple[Path, list[Any]]) -> None:
    folder, seeds = material
    assert len(seeds) >= 14
    for seed in seeds:
        path = folder / f"sound-{seed.name}"
        path.write_bytes(seed.content)
        assert fuzz.attempt(path, seed.mapping) == "read", seed.name


def check_damaged(number: int, kind: int, fuzz: Any, material: tuple[Path, list[Any]]) -> None:
    """Damage a recording and read it."""
    folder, seeds = material
    # a process of its own takes half a second: those formats come once in fifteen
    quick = [seed for seed in seeds if Path(seed.name).suffix not in fuzz.APART]
    chosen = seeds if kind % 15 == 0 else quick
    seed = chosen[kind % len(chosen)]
    path = folder / f"case-{seed.name}"
    path.write_bytes(fuzz.damage(seed.content, random.Random(number)))
    fuzz.attempt(path, seed.mapping)


DAMAGED = given(number=st.integers(0, 2**32), kind=st.integers(0, 10**6))


@DAMAGED
@settings(max_examples=60)
def test_damage_is_an_error_of_one_sentence(
    number: int, kind: int, fuzz: Any, material: tuple[Path, list[Any]]
) -> None:
    check_damaged(number, kind, fuzz, material)


@pytest.mark.slow
@DAMAGED
@settings(max_examples=500)
def test_much_damage_is_an_error_of_one_sentence(
    number: int, kind: int, fuzz: Any, material: tuple[Path, list[Any]]
) -> None:
    check_damaged(number, kind, fuzz, material)


@given(content=st.binary(max_size=300), head=st.sampled_from([
    b"", b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"PAR1", b"MATLAB 5.0",
    b"t,p\n", b"\x89MCAP0\r\n\x06",
]))  # fmt: skip
@settings(max_examples=200)
def test_anything_may_be_given(
    content: bytes, head: bytes, fuzz: Any, material: tuple[Path, list[Any]]
) -> None:
    path = material[0] / "anything"
    path.write_bytes(head + content)
    fuzz.attempt(path, None)


@DAMAGED
@settings(max_examples=100)
def test_what_says_something_else_is_an_error_of_one_sentence(
    number: int, kind: int, fuzz: Any, material: tuple[Path, list[Any]]
) -> None:
    """Records altered and written with right checksums (structured.py)."""
    folder, seeds = material
    known = [seed for seed in seeds if Path(seed.name).suffix in fuzz.BY_SUFFIX]
    # a process of its own takes a second: those formats come once in sixty, more in the slow test
    quick = [seed for seed in known if Path(seed.name).suffix not in fuzz.APART]
    chosen = known if kind % 60 == 0 else quick
    seed = chosen[kind % len(chosen)]
    path = folder / f"altered-{seed.name}"
    path.write_bytes(fuzz.alter(seed.name, seed.content, random.Random(number)))
    fuzz.attempt(path, seed.mapping)


@pytest.mark.slow(32)
def test_2000_recordings_that_say_something_else(fuzz: Any, tmp_path: Path) -> None:
    outcomes, defects = fuzz.run(2000, 3, tmp_path, [], structured=True)
    assert defects == []
    assert outcomes["read"] > 300


@pytest.mark.slow
def test_memory_and_hanging_are_seen(
    fuzz: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "small.csv"
    path.write_text("t,p\n0,1\n")
    monkeypatch.setattr(fuzz, "read", lambda *_, **__: bytearray(b"x") * (160 << 20))
    with pytest.raises(AssertionError, match="read took"):
        fuzz.attempt(path, None)
    monkeypatch.setattr(fuzz, "SECONDS", 0.05)
    monkeypatch.setattr(fuzz, "read", lambda *_, **__: sum(range(10**8)))
    with pytest.raises(AssertionError, match="took more than"):
        fuzz.attempt(path, None)
