"""What may be missing from a model: nothing that it says already."""

from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.fit.candidates import (
    SameNumber,
    SheetNumber,
    all_starts,
    declared_sizes,
    effect_starts,
    sheet_numbers,
)
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.registry import get_plant

CYLINDER = "suites/plants/valve_cylinder.yaml"
CLOSED = "suites/plants/single_rod_eha.yaml"


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
    as_one = "parameter:cylinder.area_a+cylinder.area_b"
    assert candidates(both) - candidates(one) == {"unequal_areas", as_one}


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


def test_refinements_are_tried_one_at_a_time() -> None:
    layout = get_plant("eha_knee").layout
    effect = layout.effect("entrained_air")
    places = [layout.index[f"entrained_air.{name}"] for name in ("dissolution", "gas")]
    settings = [dict(start.settings) for start in effect_starts(layout, effect, refined=True)]
    words = {tuple(own[at] for at in places) for own in settings}
    assert words == {(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, 2.0)}


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


def test_a_number_of_a_drawing_may_be_wrong_unless_it_is_calibrated(
    repository: Path, tmp_path: Path
) -> None:
    layout = load_plant(repository / "suites/plants/geared_servo.yaml").layout
    starts = all_starts(layout, layout.defaults(), (), ())
    ratio = next(start for start in starts if start.candidate == "parameter:gear.ratio")
    assert ratio.is_parameter
    assert ratio.equation == ""
    assert ratio.low < ratio.neutral < ratio.strength < ratio.high
    calibrated = all_starts(layout, layout.defaults(), (), ("gear.ratio",))
    assert "parameter:gear.ratio" not in {start.candidate for start in calibrated}
    # one of two areas that are declared the same is a single rod, which is an effect
    text = (repository / CYLINDER).read_text(encoding="utf-8")
    one = tmp_path / "one.yaml"
    one.write_text(text.replace("area_b: 12 cm^2", "area_b: 9 cm^2"), encoding="utf-8")
    areas = {"parameter:cylinder.area_a", "parameter:cylinder.area_b"}
    assert areas <= candidates(one)
    assert areas.isdisjoint(candidates(repository / CYLINDER))


def test_a_rack_that_turns_the_other_way_has_its_ends_in_order(
    repository: Path, tmp_path: Path
) -> None:
    text = (repository / "suites/plants/geared_servo.yaml").read_text(encoding="utf-8")
    assert "ratio: 193" in text
    reversed_ = tmp_path / "reversed.yaml"
    reversed_.write_text(text.replace("ratio: 193", "ratio: -193"), encoding="utf-8")
    layout = load_plant(reversed_).layout
    starts = all_starts(layout, layout.defaults(), (), ())
    ratio = next(start for start in starts if start.candidate == "parameter:gear.ratio")
    assert ratio.low < ratio.strength < ratio.neutral == -193.0 < ratio.high < 0.0


def test_parts_of_one_sheet_are_one_candidate(repository: Path) -> None:
    """Both check valves of a closed circuit are of one type; a third is declared otherwise."""
    layout = load_plant(repository / CLOSED).layout
    vector = layout.defaults()
    first, second = "check_a.cracking_pressure", "check_b.cracking_pressure"
    vector[[layout.index[first], layout.index[second]]] = 2e4
    (start,) = (item for item in sheet_numbers(layout, vector, ()) if first in item.keys)
    assert start.keys == (first, second)
    on = start.apply(vector)
    assert on[layout.index[first]] == on[layout.index[second]] == pytest.approx(2.2e4)
    assert start.is_within(on)
    assert np.array_equal(start.off(on), vector)
    vector[layout.index[second]] = 3e4
    alone = [item.keys for item in sheet_numbers(layout, vector, ())]
    assert {(first,), (second,)} <= {*alone}
    beyond = start.apply(vector, 10.0)
    assert not start.is_within(beyond)
    assert start.is_within(0.999 * start.clipped(beyond))
    assert first not in {
        key for item in sheet_numbers(layout, vector, (first,)) for key in item.keys
    }


def test_two_areas_that_are_declared_alike_are_one_number_in_doubt(repository: Path) -> None:
    """A rod that goes through has one area on either side: both are off, or neither."""
    layout = load_plant(repository / CLOSED).layout
    vector = layout.defaults()
    names = ("cylinder.area_a", "cylinder.area_b")
    places = [layout.index[name] for name in names]
    vector[places] = 8e-4
    (start,) = (item for item in all_starts(layout, vector, (), ()) if names[0] in item.keys)
    assert start.candidate == "parameter:cylinder.area_a+cylinder.area_b"
    assert start.keys == names
    assert list(start.apply(vector)[places]) == pytest.approx([8.8e-4, 8.8e-4])
    assert np.array_equal(start.off(start.apply(vector)), vector)
    assert isinstance(start, SameNumber)
    assert start.is_one(start.apply(vector))
    apart = start.apply(vector)
    apart[places[1]] *= 1.03
    assert not start.is_one(apart)
    # the number of a drawing is no spread of parts, and is named
    assert not isinstance(start, SheetNumber)
    assert not any(names[1] in item.keys for item in all_starts(layout, vector, (), names[:1]))
