"""What may be missing from a model: nothing that it says already."""

from pathlib import Path

import pytest

from eha_bench.diagnosis.fit.candidates import all_starts, declared_sizes, effect_starts
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.registry import get_plant

CYLINDER = "suites/plants/valve_cylinder.yaml"


def candidates(file: Path) -> set[str]:
    layout = load_plant(file).layout
    return {start.candidate for start in all_starts(layout, layout.defaults(), (), ())}


def test_a_rod_that_is_declared_cannot_be_missing(repository: Path, tmp_path: Path) -> None:
    text = (repository / CYLINDER).read_text(encoding="utf-8")
    both, one = tmp_path / "both.yaml", tmp_path / "one.yaml"
    both.write_text(text, encoding="utf-8")
    assert "area_b: 12 cm^2" in text
    one.write_text(text.replace("area_b: 12 cm^2", "area_b: 9 cm^2"), encoding="utf-8")
    assert "unequal_areas" in candidates(both)
    assert candidates(both) - candidates(one) == {"unequal_areas"}


def test_oil_that_warms_is_no_oil_that_cools(repository: Path) -> None:
    layout = load_plant(repository / CYLINDER).layout
    starts = all_starts(layout, layout.defaults(), (), ())
    own = [start for start in starts if start.candidate == "viscosity_drift"]
    assert own
    assert all(start.low == 0.0 < start.strength for start in own)


def test_refinements_are_left_until_the_effect_is_there(repository: Path) -> None:
    layout = load_plant(repository / "suites/plants/geared_servo.yaml").layout
    for name, refinement in (("current_deadband", "edges"), ("cogging_torque", "harmonics")):
        effect = layout.effect(name)
        at = layout.index[f"{name}.{refinement}"]
        first, refined = (
            {dict(start.settings)[at] for start in effect_starts(layout, effect, refined=asked)}
            for asked in (False, True)
        )
        assert (first, refined) == ({0.0}, {0.0, 1.0})


def test_the_size_of_a_declared_effect_may_be_wrong() -> None:
    layout = get_plant("eha_knee").layout
    vector = layout.defaults()
    at = layout.index["pressure_sensor_lag.time_constant"]
    vector[at] = 1e-3
    (start,) = declared_sizes(layout, vector, ["pressure_sensor_lag", "entrained_air"], ())
    assert start.candidate == "parameter:pressure_sensor_lag.time_constant"
    assert start.is_parameter
    assert (start.neutral, start.low, start.high) == (1e-3, 1e-4, 1e-2)
    assert start.keys == ("pressure_sensor_lag.time_constant",)
    assert start.apply(vector)[at] == pytest.approx(1.5e-3)
    # what is estimated anyway is no candidate, nor what is off
    assert not declared_sizes(layout, vector, ["pressure_sensor_lag"], start.keys)
    assert not declared_sizes(layout, vector, ["entrained_air"], ())
