"""Which channels a trial may name on a target."""

from __future__ import annotations

import pytest

from eha_bench.core.errors import InputError
from eha_bench.suites import load_suite
from eha_bench.targets.channel_check import check_channels

BOTH = {"reference": "Pa", "pressure_a": "Pa", "pressure_b": "Pa"}


def test_a_pressure_difference_is_derived_where_both_pressures_are_there() -> None:
    signal = {"kind": "constant", "value": "4 MPa"}
    only = {"id": "a", "mode": "pressure", "duration": "0.1 s", "signal": signal}
    (trial,) = load_suite({"name": "own", "trials": [only]}).trials
    check_channels(trial, BOTH, "my rig")
    with pytest.raises(InputError, match="pressure_difference, which my rig does not have") as told:
        check_channels(trial, {"reference": "Pa", "pressure_a": "Pa"}, "my rig")
    # no mode is called so
    assert "'reference'" not in str(told.value)
