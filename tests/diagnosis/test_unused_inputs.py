"""A channel that drives the machine, and is logged, but is not under `inputs`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.unused_inputs import unused_inputs

PLANT: Any = SimpleNamespace(
    id="stand",
    layout=SimpleNamespace(plant="stand", size=1, index={"supply.pressure": 0}),
    resting_values=lambda vector: {
        "supply_pressure": float(vector[0]), "load_force": 0.0, "oil_temperature": float("nan"),
    },
    units={"supply_pressure": "Pa", "load_force": "N"},
)  # fmt: skip
MODEL: Any = SimpleNamespace(plant=PLANT, vector=lambda: np.array([16e6]))
TIME = np.arange(0.0, 1.0, 0.01)


def _notes(
    inputs: tuple[str, ...] = (), own: float | None = None, **values: float | np.ndarray
) -> list[str]:
    channels = {name: np.zeros(TIME.size) + value for name, value in values.items()}
    recording = Recording(TIME, {"position": np.sin(TIME), **channels})
    run = Run("steps", Path("s.csv"), None, False, False, Use.TRAIN, lambda: recording)
    if own is not None:
        run = replace(run, parameters={"supply.pressure": own})
    return [str(note) for note in unused_inputs(run, [recording], inputs, MODEL)]


def test_a_supply_that_is_not_the_declared_one_is_said() -> None:
    assert _notes(supply_pressure=14e6) == [
        "steps: 'supply_pressure' is in the log and drives stand, but it is not under `inputs`: it "
        "is taken to stand at the declared 1.6e+07 Pa"
    ]
    assert len(_notes(load_force=3.0)) == 1


def test_what_a_run_declares_of_its_own_counts() -> None:
    assert _notes(own=14e6, supply_pressure=14e6) == []
    assert "at the declared 1.4e+07 Pa" in _notes(own=14e6, supply_pressure=16e6)[0]


@pytest.mark.parametrize(
    ("inputs", "values"),
    [
        (("supply_pressure",), {"supply_pressure": 14e6}),
        ((), {"supply_pressure": 16.1e6}),  # as declared
        ((), {"load_force": 0.0}),
        ((), {"load_force": np.random.default_rng(0).normal(0.0, 0.3, TIME.size)}),
        ((), {"supply_pressure": np.where(TIME == 0.5, 30e6, 16e6)}),  # one outlier
        ((), {"oil_temperature": 310.0}),  # nothing is declared of it
        ((), {"supply_pressure": float("nan")}),
    ],
)
def test_nothing_is_said_of_what_changes_nothing(
    inputs: tuple[str, ...], values: dict[str, float | np.ndarray]
) -> None:
    assert _notes(inputs, **values) == []
