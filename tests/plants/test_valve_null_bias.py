"""A valve whose null is off."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.fit.candidates import all_starts
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive

BIAS = 0.02


def rod(parameters: dict[str, float], *effects: DeclaredEffect) -> np.ndarray:
    model = Model("valve_cylinder", parameters, (), effects)
    time = np.arange(0.0, 0.5, 1e-3)
    command = 1.0 * np.sin(12.0 * time)
    out = model.plant.simulate(model.vector(), Drive(time, {"valve_command": command}), 1e-4)
    return np.asarray(out[:, model.plant.outputs.index("piston_position")])


def test_it_says_what_the_plants_own_parameter_says() -> None:
    effect = DeclaredEffect("valve_null_bias", {"bias": BIAS})
    assert rod({}, effect) == pytest.approx(rod({"valve.null_bias": BIAS}), abs=1e-12)


def test_unequal_overlap_is_a_dead_band_and_a_null() -> None:
    """Known answer: edges of 0.03 and 0.01 are a dead band of 0.02, shifted by -0.01."""
    unequal = DeclaredEffect("valve_deadband", {"deadband": 0.02, "asymmetry": 0.5})
    equal = DeclaredEffect("valve_deadband", {"deadband": 0.02})
    null = DeclaredEffect("valve_null_bias", {"bias": -0.01})
    assert rod({}, unequal) == pytest.approx(rod({}, equal, null), abs=1e-12)


def test_it_is_looked_for_where_the_plants_own_is_nothing() -> None:
    layout = Model("valve_cylinder").plant.layout
    for own, found in ((0.0, True), (0.01, False)):
        vector = layout.defaults()
        vector[layout.index["valve.null_bias"]] = own
        starts = all_starts(layout, vector, [], ())
        assert any(start.candidate == "valve_null_bias" for start in starts) is found
