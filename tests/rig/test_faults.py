"""Faults on request."""

import math

import pytest

from eha_bench.core.errors import InputError
from eha_bench.rig.faults import FaultKind, Faults, parse_fault


@pytest.mark.parametrize(
    ("text", "kind", "channel", "value", "start", "length"),
    [
        ("silent", FaultKind.SILENT, "", 0.0, -math.inf, math.inf),
        ("silent@0.5", FaultKind.SILENT, "", 0.0, 0.5, math.inf),
        ("late=5 ms@1 s+200 ms", FaultKind.LATE, "", 0.005, 1.0, 0.2),
        ("lost=0.25", FaultKind.LOST, "", 0.25, -math.inf, math.inf),
        ("frozen=pressure_a@1", FaultKind.FROZEN, "pressure_a", 0.0, 1.0, math.inf),
        ("scale=current:-1@0", FaultKind.SCALE, "current", -1.0, 0.0, math.inf),
        ("over-pressure=100 MPa/s@1", FaultKind.OVER_PRESSURE, "", 1e8, 1.0, math.inf),
    ],
)
def test_a_fault_is_read(
    text: str, kind: FaultKind, channel: str, value: float, start: float, length: float
) -> None:
    fault = parse_fault(text)
    assert (fault.kind, fault.channel) == (kind, channel)
    assert (fault.value, fault.start, fault.length) == (value, start, length)


@pytest.mark.parametrize(
    "text", ["", "silnt", "frozen", "frozen=presure_a", "late=5 MPa", "scale=current", "silent@x"]
)
def test_what_is_no_fault_is_said(text: str) -> None:
    with pytest.raises(InputError, match=r".+; .+|.+"):
        parse_fault(text)


def test_a_fault_counts_from_the_first_torque_and_ends() -> None:
    faults = Faults([parse_fault("late=5ms@1+0.5")])
    assert faults.update(100.0) == []
    faults.torque_on(100.0)
    faults.torque_on(100.7)
    assert faults.update(100.9) == []
    assert faults.update(101.0) == ["late=5ms@1+0.5"]
    assert faults.active(FaultKind.LATE) is not None
    assert faults.update(101.4) == []
    faults.update(101.6)
    assert faults.active(FaultKind.LATE) is None


def test_a_frozen_sensor_shows_what_it_showed_last() -> None:
    faults = Faults([parse_fault("frozen=current")])
    faults.update(0.0)
    assert faults.faulty_readings({"current": 1.0, "force": 2.0}) == {"current": 1.0, "force": 2.0}
    assert faults.faulty_readings({"current": 5.0, "force": 3.0}) == {"current": 1.0, "force": 3.0}
