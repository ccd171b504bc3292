"""The period of a swing in time is read off how much is missing in each short window."""

from __future__ import annotations

import math
from copy import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.api import diagnose
from eha_bench.diagnosis.fit.candidates import effect_starts
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Piece
from eha_bench.diagnosis.search.swing import best_periods, is_swing, with_periods
from eha_bench.plants.effects.supply_sag import Others, sagging_pressure
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from fed_rod_plant import FED_ROD

WINDOW, TICKS, TICK = 0.1, 20, 5e-3
FIELDS = Others._fields


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("fed") / "plant.yaml"
    path.write_text(FED_ROD)
    return load_model(path)


class Gauge:
    """A gauge at the supply, read during short windows; what noise makes is one.

    Args:
        model: of the plant. truth: of the effect. seconds: of the run. level: of the noise.
    """

    def __init__(self, model: Any, truth: Others, seconds: float, level: float = 1.0) -> None:
        self.plant, self.truth = model.plant, truth
        self.soft, self.beliefs, self.step = 5.0, (), 1e-3
        starts = np.arange(0.0, seconds, WINDOW)
        self.time = (starts[:, None] + TICK * np.arange(TICKS)).ravel()
        self.windows = [
            SimpleNamespace(measured=SimpleNamespace(time=self.time), first=k * TICKS,
                            last=(k + 1) * TICKS) for k in range(starts.size)
        ]  # fmt: skip
        self.pieces = [
            Piece(k, slice(k * TICKS, (k + 1) * TICKS), np.arange(TICKS), np.zeros(TICKS, int))
            for k in range(starts.size)
        ]
        self.noise = level * np.random.default_rng(5).standard_normal(self.time.size)

    @property
    def size(self) -> int:
        return self.time.size

    def at_step(self, step: float) -> Gauge:
        return copy(self)

    def pressure(self, own: Others) -> np.ndarray:
        return np.array([sagging_pressure(0.0, 0.0, t, own) for t in self.time])

    def residual(self, vector: np.ndarray) -> np.ndarray:
        index = self.plant.layout.index
        own = Others(*(float(vector[index[f"supply_sag.{name}"]]) for name in FIELDS))
        level = float(vector[index["supply.pressure"]]) - 2e6
        return (level + self.pressure(own) - self.pressure(self.truth)) / 2e4 + self.noise


def _swing(model: Any) -> Any:
    layout = model.plant.layout
    starts = effect_starts(layout, layout.effect("supply_sag"))
    return next(start for start in starts if is_swing(start))


def _found(model: Any, truth: Others, seconds: float) -> Any:
    gauge: Any = Gauge(model, truth, seconds)
    vector = model.vector()
    free = free_parameters(model.plant.layout, ["supply.pressure"], vector)
    fit = levenberg_marquardt(gauge, vector, free, iterations=0)
    return best_periods(gauge, fit, model.plant.layout, _swing(model))


@given(
    frequency=st.floats(0.25, 2.0), phase=st.floats(-3.0, 3.0), size=st.floats(0.05, 1.0),
    sawtooth=st.booleans(),
)  # fmt: skip
def test_frequency_phase_and_size_are_those_of_the_swing(model, frequency, phase, size, sawtooth):
    """The model's mean is free, and the first two turns of a swing are enough."""
    truth = Others(1e10 * size, 1.0, 1.0, 1e-4, frequency, phase, float(sawtooth))
    best = _found(model, truth, 8.0)[0]
    settings, index = dict(best.settings), model.plant.layout.index
    found = settings[index["supply_sag.frequency"]]
    assert found == pytest.approx(frequency, abs=0.05)
    # frequency and phase answer for each other: what counts is the phase in mid-run
    turned = 2.0 * math.pi * (found - frequency) * 4.0
    assert math.cos(settings[index["supply_sag.phase"]] + turned - phase) > 0.9
    if not sawtooth:
        # where much is missing, the loss weighs it less
        assert best.strength == pytest.approx(truth.resistance, rel=0.4)


def test_a_few_periods_are_kept_that_a_run_tells_apart(model):
    found = _found(model, Others(5e9, 1.0, 1.0, 1e-4, 0.7, 0.0, 0.0), 8.0)
    place = model.plant.layout.index["supply_sag.frequency"]
    frequencies = sorted(dict(start.settings)[place] for start in found)
    assert len(frequencies) == 3
    assert min(np.diff(frequencies)) > 1.0 / 8.0


def test_what_does_not_swing_begins_where_it_did(model):
    layout = model.plant.layout
    starts = [s for s in effect_starts(layout, layout.effect("supply_sag")) if not is_swing(s)]
    assert starts
    search: Any = SimpleNamespace(problem=SimpleNamespace(plant=model.plant))
    assert with_periods(search, starts, model.vector()) == starts


@pytest.mark.slow(12)
@pytest.mark.parametrize("wave", ["sine", "sawtooth"])
def test_a_supply_that_others_draw_from_is_named(model, tmp_path: Path, wave: str) -> None:
    """Recordings of a rod on a spring, whose supply rises and falls every one and a half second."""
    words = {"sine": 0.0, "sawtooth": 1.0}
    vector = model.vector()
    truth = {"resistance": 5e8, "drawn_by": 1.0, "frequency": 0.66, "phase": 1.0,
             "wave": words[wave]}  # fmt: skip
    for name, value in truth.items():
        vector[model.plant.layout.index[f"supply_sag.{name}"]] = value
    vector[model.plant.layout.index["drag.viscous"]] *= 1.1
    rng = np.random.default_rng(2)
    time = np.arange(0.0, 4.0, 4e-3)
    rows = []
    for number in range(3):
        force = 200.0 * np.sign(np.sin(2.0 * np.pi * (0.8 + 0.3 * number) * time))
        drive = Drive(time, {"push_force": force}, {"rod_position": 0.05})
        position = model.plant.simulate(vector, drive, 1e-4)[:, 0]
        position = position + 2e-5 * rng.standard_normal(time.size)
        lines = [f"{t:.6f},{f:.6g},{x:.9g}" for t, f, x in zip(time, force, position, strict=True)]
        text = "time [s],push_force [N],rod_position [m]\n" + "\n".join(lines)
        (tmp_path / f"run_{number}.csv").write_text(text + "\n")
        rows.append(f"  - {{log: run_{number}.csv, use: {'holdout' if number == 2 else 'train'}}}")
    (tmp_path / "plant.yaml").write_text(FED_ROD)
    (tmp_path / "dataset.yaml").write_text("model: plant.yaml\nruns:\n" + "\n".join(rows) + "\n")
    found = diagnose(tmp_path / "dataset.yaml", tmp_path / "out")
    assert [effect.id for effect in found.effects] == ["supply_sag"]
    assert found.effects[0].parameters["frequency"].value == pytest.approx(0.66, rel=0.01)
    assert found.effects[0].settings["wave"] == wave
