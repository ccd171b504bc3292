"""Gains by name: read, changed, and judged where their unit follows from the trial."""

from pathlib import Path

import pytest

from eha_bench.control.controller_file import load_controllers
from eha_bench.control.gains import gains_of, read_gain, unit_of_gain, with_gains
from eha_bench.core.errors import InputError, Place

PID = "piston_position: {controller: pid, k_p: 4 V/mm, filter_time: 5 ms}\n"
IN_PROCESS = Place(file="vary.yaml", line=2)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "c.yaml").write_text(PID, encoding="utf-8")
    return tmp_path / "c.yaml"


def test_a_gain_with_a_unit_of_its_own_is_a_number_in_si(file: Path) -> None:
    found = gains_of(load_controllers(file))
    assert found["piston_position.k_p"] == pytest.approx(4000.0)
    assert found["piston_position.k_i"] == 0.0
    assert "piston_position.tracking_time" not in found


def test_such_a_gain_is_read_and_changed(file: Path) -> None:
    controllers = load_controllers(file)
    gain = read_gain(controllers, "piston_position.k_p", "2 V/cm", IN_PROCESS)
    assert gain.value == pytest.approx(200.0)
    assert gains_of(gain.controllers)["piston_position.k_p"] == pytest.approx(200.0)
    assert unit_of_gain(controllers, "piston_position.k_p", IN_PROCESS)
    changed = with_gains(controllers, {"piston_position.k_p": 300.0, "piston_position.k_i": 2.0})
    assert gains_of(changed)["piston_position.k_p"] == 300.0
    assert gains_of(changed)["piston_position.filter_time"] == pytest.approx(5e-3)


def test_what_is_no_quantity_is_refused(file: Path) -> None:
    with pytest.raises(InputError) as error:
        read_gain(load_controllers(file), "piston_position.k_p", "4 flurbs", IN_PROCESS)
    assert error.value.where is not None
    assert error.value.where.line == 2
