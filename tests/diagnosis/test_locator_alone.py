"""A place whose sensors are all that is compared: nothing else bears their fault out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from eha_bench.diagnosis.unknown.locator import Locator
from eha_bench.diagnosis.unknown.places import SuspectPlace


def test_no_other_channel_makes_no_case_against_a_sensor():
    locator = object.__new__(Locator)
    locator.plant = SimpleNamespace(outputs=("pressure_a", "pressure_b"))
    locator.channels = np.array([0, 1, 0, 1])
    place = SuspectPlace(
        "measurement", "additive", "pressures", ("time",), ("pressure_a", "pressure_b")
    )
    locator.curves = SimpleNamespace(before=SimpleNamespace(residual=np.full(4, 9.0)))
    locator.short = SimpleNamespace(soft=3.0)
    elsewhere, own = locator._remaining_excess(place, np.zeros(4))
    assert elsewhere == 1.0
    assert own == 0.0
