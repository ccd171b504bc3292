"""What the uncertainty of what was fitted makes of whole replays of held-out runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.diagnosis.slide_plant import slide

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.fit.uncertainty import Covariance
from eha_bench.diagnosis.outcome.model_errors import spread_of_replays
from eha_bench.diagnosis.outcome.rival import NO_EFFECT, Rival, Standing

MASS, VISCOUS, COULOMB, FORCE = 10.0, 100.0, 30.0, 80.0
TIME = np.arange(0.0, 2.0, 0.002)


def moved(time: np.ndarray, force: np.ndarray | float) -> np.ndarray:
    """How far a force beyond dry friction moves the rod, m: m v' = F - F_c - b v."""
    lag = MASS / VISCOUS
    return (force - COULOMB) / VISCOUS * (time - lag * (1.0 - np.exp(-time / lag)))


def run(use: Use, seed: int) -> Run:
    generator = np.random.default_rng(seed)
    columns = {
        "command": np.full(TIME.size, FORCE),
        "position": moved(TIME, FORCE) + 1e-5 * generator.standard_normal(TIME.size),
    }
    recording = Recording(TIME, columns)
    name = use.value
    return Run(name, Path(f"{name}.csv"), None, False, False, use, lambda: recording)


def test_it_is_the_sensitivity_times_what_is_uncertain(tmp_path: Path) -> None:
    runs = (run(Use.TRAIN, 1), run(Use.HOLDOUT, 2))
    dataset = Dataset(slide(tmp_path), ("command",), runs)
    base = calibrated_baseline(dataset)
    sure = Covariance(("seals.coulomb",), np.zeros((1, 1)))
    for deviation in (0.3, 0.6):
        unsure = Covariance(("seals.coulomb",), np.array([[deviation**2]]))
        rival = Rival(NO_EFFECT, (), Standing.FOUND, 0.0, dataset.model, unsure)
        expected = np.sqrt(np.mean((moved(TIME, FORCE) - moved(TIME, FORCE - deviation)) ** 2))
        found = spread_of_replays(dataset, base, rival, {})
        assert found["position"] == pytest.approx(expected, rel=1e-3)
    rival = Rival(NO_EFFECT, (), Standing.FOUND, 0.0, dataset.model, sure)
    assert spread_of_replays(dataset, base, rival, {})["position"] == pytest.approx(0.0, abs=1e-12)
