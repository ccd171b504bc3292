"""Mistakes in what is declared or logged: none of them becomes an effect that the machine lacks."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks import trap_cases
from benchmarks.trap_cases import TRAPS, Trap
from benchmarks.traps import seen

from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.diagnose import diagnose

NAMES = [trap.name for trap in TRAPS]
SHORT = [
    trap
    for trap in TRAPS
    if trap.name in {"no_leak", "gear_ratio", "all_free", "long_pendulum", "no_friction", "stall"}
]
"""Of the others a diagnosis takes longer: `python -m benchmarks.traps` has all of them."""


def test_there_are_twenty() -> None:
    assert len(set(NAMES)) == len(TRAPS) == 20


@pytest.mark.parametrize("trap", TRAPS, ids=NAMES)
def test_no_mistake_is_one_that_the_files_show(trap: Trap, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(trap_cases, "SECONDS", 0.2)
    found = load_dataset(trap.record(tmp_path / trap.name, seed=1))
    assert len(found.runs) == trap_cases.RUNS + 1
    assert [run.use.value for run in found.runs].count("holdout") == 1


@pytest.mark.parametrize("trap", TRAPS[::8], ids=NAMES[::8])
def test_a_machine_is_the_same_for_a_seed(trap: Trap, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(trap_cases, "SECONDS", 0.2)
    first, second = (trap.record(tmp_path / name, seed=1).parent for name in ("a", "b"))
    for file in sorted(first.iterdir()):
        assert file.read_bytes() == (second / file.name).read_bytes()


@pytest.mark.slow(150)
@pytest.mark.parametrize("trap", SHORT, ids=[trap.name for trap in SHORT])
def test_no_mistake_becomes_an_effect(trap: Trap, tmp_path) -> None:
    found = diagnose(trap.record(tmp_path / trap.name, seed=18), tmp_path / "out")
    outcome = seen(trap, found, np.nan)
    assert not outcome.false, outcome
    assert outcome.avoids(trap), outcome
