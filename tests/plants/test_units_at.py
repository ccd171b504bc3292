"""Units of an effect's parameters are those of the place where it acts."""

from __future__ import annotations

import pytest

from eha_bench.plants.registry import get_plant


@pytest.mark.parametrize(("place", "units"), [("rod", ("N", "m/s")), ("shaft", ("N*m", "rad/s"))])
def test_a_rods_friction_is_a_force_and_a_shafts_a_torque(
    place: str, units: tuple[str, str]
) -> None:
    layout = get_plant("eha_knee").layout
    effect = layout.effect("stribeck_friction")
    vector = layout.defaults()
    vector[layout.index["stribeck_friction.at"]] = effect.places.index(place)
    found = layout.units_at(vector)
    keys = ("stribeck_friction.excess_force", "stribeck_friction.stribeck_velocity")
    assert tuple(found[key] for key in keys) == units
    assert found.keys() == layout.by_key.keys()
