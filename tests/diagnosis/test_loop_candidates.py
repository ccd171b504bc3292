"""Effects of a controller inside a plant are candidates only where it drives."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.diagnosis.fit.candidates import effect_starts
from eha_bench.diagnosis.search.state import _is_of_open_loop
from eha_bench.plants.registry import get_plant


@pytest.mark.parametrize(("driven_by", "is_open"), [("goal_position", False), ("duty", True)])
def test_no_firmware_is_missing_where_a_log_has_what_it_asks_for(
    driven_by: str, is_open: bool
) -> None:
    plant = get_plant("position_servo")
    window = SimpleNamespace(measured=SimpleNamespace(inputs={driven_by: np.zeros(9)}))
    problem: Any = SimpleNamespace(plant=plant, windows=(window,))
    for effect in plant.layout.effects:
        (start, *_) = effect_starts(plant.layout, effect)
        of_loop = effect.role == "position_loop"
        assert _is_of_open_loop(problem, start) is (of_loop and is_open)
