"""Units whose words depend on the place, by hand."""

import pytest

from eha_bench.core.errors import PluginError
from eha_bench.core.place_unit import powers, unit_at_place, usual_size
from eha_bench.core.units import parse
from eha_bench.plants.effect import Action, Effect, bind_effects
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.roles import roles_of, usual_effort
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.registry import get_plant

TURNS = {"effort": "N*m", "speed": "rad/s", "damping": "N*m*s/rad", "position": "rad", "none": ""}
SLIDES = {"effort": "N", "speed": "m/s", "damping": "N*s/m", "position": "m", "none": ""}


@pytest.mark.parametrize(
    ("unit", "turns", "slides"),
    [
        ("N/m", "N/m", "N/m"),
        ("{effort}", "N*m", "N"),
        ("{effort}/{position}", "N*m/rad", "N/m"),
        ("{effort}/{speed}^2", "N*m*s^2/rad^2", "N*s^2/m^2"),
        ("{damping}/({speed})", "N*m*s^2/rad^2", "N*s^2/m^2"),
        ("1/{speed}", "s/rad", "s/m"),
        ("{none}", "", ""),
        ("{none}/{speed}", "s/rad", "s/m"),
        ("{position}/{position}", "", ""),
        ("{effort}/(A^2*{position})", "N*m/(A^2*rad)", "N/(A^2*m)"),
    ],
)
def test_a_unit_at_a_place(unit: str, turns: str, slides: str) -> None:
    assert unit_at_place(unit, TURNS) == turns
    assert unit_at_place(unit, SLIDES) == slides
    for text in (turns, slides):
        if text:
            assert parse(f"3 {text}", text) == 3.0


@pytest.mark.parametrize(
    "unit", ["{effort", "{effort}//{speed}", "{effort}^", "2*{effort}", "({speed}"]
)
def test_what_is_no_unit_is_a_sentence(unit: str) -> None:
    with pytest.raises(PluginError, match="is no unit"):
        powers(unit)


def test_a_word_that_a_place_lacks_is_named_with_those_meant() -> None:
    with pytest.raises(PluginError, match=r"asks for '\{efort\}'.*did you mean 'effort'"):
        unit_at_place("{efort}/{speed}", TURNS)


def test_a_usual_size_is_that_of_its_words() -> None:
    usual = {"effort": 2.0, "speed": 10.0}
    assert usual_size("{effort}/{speed}^2", usual) == pytest.approx(0.02)
    assert usual_size("N", usual) == 1.0
    assert usual_size("{effort}/{position}", usual) == 2.0


def keep(coefficient: float, speed: float, windage: float) -> float:
    return coefficient + windage * abs(speed)


def windage(unit: str) -> Effect:
    return Effect(
        "windage", "Drag.", (Parameter("windage", unit, 0.1, 0.0, 1e9),),
        {"friction": Action({"viscous": keep})}, "by hand",
    )  # fmt: skip


def test_one_effect_acts_on_what_turns_and_what_slides() -> None:
    """At a usual speed the default adds a tenth of the usual effort, on shaft and rod."""
    plant = get_plant("eha_knee")
    assert isinstance(plant, NetworkPlant)
    (found,) = bind_effects([windage("{effort}/{speed}^2")], roles_of(plant.system))
    units = {
        found.parameter_at("windage", {"at": float(place)}).unit
        for place in range(len(found.places))
    }
    assert units == {"N*m*s^2/rad^2", "N*s^2/m^2"}
    for spot in found.spots:
        (item,) = [one for one in plant.system.coordinates if one.name == spot.name]
        at = {"at": float(found.places.index(spot.name))}
        default = found.parameter_at("windage", at).default
        assert spot.usual["effort"] == usual_effort(plant.system, item)
        added = default * spot.usual["speed"] ** 2
        assert added == pytest.approx(0.1 * spot.usual["effort"])


def test_a_wrong_word_is_refused_with_the_effect_and_its_parameter() -> None:
    plant = get_plant("eha_knee")
    assert isinstance(plant, NetworkPlant)
    said = r"effect 'windage', parameter 'windage': .*'\{sped\}'.*did you mean 'speed'"
    with pytest.raises(PluginError, match=said):
        bind_effects([windage("{effort}/{sped}")], roles_of(plant.system))
