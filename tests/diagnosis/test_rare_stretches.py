"""When what is missing acts, where that is seldom."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from eha_bench.diagnosis.fit.problem import Piece
from eha_bench.diagnosis.outcome.rare_stretches import (
    RunStretch,
    note_of_rare_stretches,
    rare_stretches,
)

TICK = 0.01
VECTOR = np.zeros(0)


class Recorded:
    """A problem of two runs of 20 s, in windows of 1 s, with a residual of its own."""

    soft = 5.0

    def __init__(self, runs: dict[str, np.ndarray]) -> None:
        time = np.arange(0.0, 20.0, TICK)
        self.windows, self.pieces, parts = [], [], []
        for name, residual in runs.items():
            run = SimpleNamespace(run=SimpleNamespace(name=name), time=time, tick=TICK)
            for first in range(0, time.size, 100):
                at = 100 * len(self.windows)
                self.pieces.append(
                    Piece(
                        len(self.windows), slice(at, at + 100), np.arange(100), np.zeros(100, int)
                    )
                )
                self.windows.append(SimpleNamespace(measured=run, first=first, last=first + 100))
                parts.append(residual[first : first + 100])
        self._residual = np.concatenate(parts)

    def residual(self, _):
        return self._residual


@pytest.fixture
def noise():
    rng = np.random.default_rng(3)
    return {name: rng.standard_normal(2000) for name in ("steps", "chirp")}


def test_a_push_is_found_in_its_run_at_its_time(noise) -> None:
    noise["chirp"][1210:1240] += 30.0
    noise["steps"][410:424] += 30.0
    found, share, time = rare_stretches(Recorded(noise), VECTOR)
    assert found == [RunStretch("chirp", 12.0, 12.5), RunStretch("steps", 4.0, 4.25)]
    assert share > 0.8
    assert time == pytest.approx(0.75 / 40.0)
    (note,) = note_of_rare_stretches(Recorded(noise), VECTOR)
    assert "1.9 % of the time: chirp at 12 to 12.5 s, steps at 4 to 4.25 s" in note


def test_what_acts_all_the_time_has_no_time(noise) -> None:
    noise["chirp"] *= 3.0
    noise["steps"] *= 3.0
    assert note_of_rare_stretches(Recorded(noise), VECTOR) == []


def test_noise_has_none(noise) -> None:
    quiet = {name: 0.5 * values for name, values in noise.items()}
    assert note_of_rare_stretches(Recorded(quiet), VECTOR) == []
