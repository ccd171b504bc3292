"""What holds of every effect: named, sourced, nested in the declared model, smooth, repeatable."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core import plugins, units
from eha_bench.plants.effect import BoundEffect, Effect, registered_effects
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

# contract, section 5: public names that may not change
CONTRACT_IDS = frozenset(
    (
        *("current_lag", "command_delay", "current_deadband", "torque_saturation"),
        *("cogging_torque", "pump_ripple", "pressure_dependent_friction", "viscosity_drift"),
        *("asymmetric_friction", "turbulent_leakage", "external_leakage", "entrained_air"),
        *("anti_cavitation", "relief_valve", "presliding_friction", "seal_friction"),
        *("joint_backlash", "gravity_load", "pressure_sensor_lag", "pressure_sensor_offset"),
        *("unequal_areas", "coulomb_friction", "learned", "load_dependent_friction"),
        *("valve_deadband", "valve_lag", "valve_leakage", "supply_sag"),
    )
)
EFFECTS: dict[str, Effect] = {
    name: plugins.load("effects", name) for name in plugins.names("effects")
}


KNEE = {effect.id: effect for effect in get_plant("eha_knee").layout.effects}


def _starts(effect: BoundEffect) -> list[dict[str, float]]:
    """The default start and one of each choice: further phases and counts are alike."""
    kept: dict[tuple[object, ...], dict[str, float]] = {}
    for start in effect.starts:
        words = tuple(
            (p.name, start.get(p.name, p.default)) for p in effect.parameters if p.choices
        )
        kept.setdefault(words, dict(start))
    return list(kept.values())


CASES = [
    pytest.param(effect.id, start, id=f"{effect.id}-{number}")
    for effect in KNEE.values()
    for number, start in enumerate(_starts(effect))
]


def test_every_id_of_the_contract_is_registered() -> None:
    assert set(EFFECTS) >= CONTRACT_IDS


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_effect_says_what_it_is(name) -> None:
    effect = EFFECTS[name]
    assert effect.id == name
    assert effect.summary.endswith(".")
    assert effect.source
    assert effect.separate, "which experiment tells it from its look-alikes?"
    assert effect.actions
    assert effect.strength.low <= effect.neutral <= effect.strength.high
    assert effect.strength.default != effect.neutral, "a search cannot start where it is off"


@pytest.mark.parametrize("name", sorted(KNEE))
def test_effect_has_units_and_starts_within_bounds_where_it_acts(name) -> None:
    effect = KNEE[name]
    for parameter in effect.parameters:
        units.parse(f"1 {parameter.unit}" if parameter.unit else 1.0, parameter.unit)
    for start in effect.starts:
        for key, value in start.items():
            parameter = effect.parameter(key)
            assert parameter.low <= value <= parameter.high, key


def _runs():
    """A locked and a free run that visit both signs, rest, high and low pressure."""
    time = np.arange(0.0, 0.25, 1e-3)
    tone = np.sin(2 * np.pi * 5 * time)
    locked = Drive(time, {"current_command": 16.0 * tone + 3.0}, {}, locked=True)
    warm = {"oil_temperature": np.linspace(300.0, 330.0, time.size)}
    free = Drive(time, {"current_command": 9.0 * tone, **warm}, {})
    return locked, free


def _base(*effects: DeclaredEffect) -> Model:
    values = {
        "rotor_inertia": 0.001, "leakage": 1e-13, "current_limit": 36.0,
        "initial_pressure": 0.6e6, "external_force": 200.0,
    }  # fmt: skip
    return Model("eha_knee", values, (), (DeclaredEffect("anti_cavitation"), *effects))


def _simulate(vector, step=50e-6):
    return np.concatenate(
        [get_plant("eha_knee").simulate(vector, drive, step) for drive in _runs()]
    )


@pytest.mark.parametrize(("name", "start"), CASES)
def test_neutral_strength_is_the_declared_model_to_the_last_bit(name, start) -> None:
    effect = KNEE[name]
    layout = get_plant("eha_knee").layout
    vector = _base().vector()
    expected = _simulate(vector)
    if name == "anti_cavitation":
        vector[layout.index["anti_cavitation.valve_conductance"]] = 0.0
        expected = _simulate(vector)
    for parameter in effect.parameters[1:]:
        at = layout.index[f"{name}.{parameter.name}"]
        value = start.get(parameter.name, parameter.default)
        vector[at : at + parameter.size] = value
    vector[layout.index[f"{name}.{effect.strength.name}"]] = effect.neutral
    np.testing.assert_array_equal(_simulate(vector), expected)


def test_kernel_without_any_effect_gives_the_same_bits() -> None:
    """The hooks cost nothing but time: off, they leave every number as it was."""

    network = get_plant("eha_knee").network
    bare = NetworkPlant(network, ())
    full = get_plant("eha_knee")
    own = np.array([parameter.default for parameter in bare.layout.parameters])
    for drive in _runs():
        got = bare.simulate(own, drive, 50e-6)
        np.testing.assert_array_equal(got, full.simulate(full.layout.defaults(), drive, 50e-6))


@pytest.mark.parametrize(("name", "start"), CASES)
def test_effect_at_its_starting_size_is_seen_and_finite(name, start) -> None:
    wave = list(0.3 * np.sin(np.arange(24.0)))
    curve = {"values": wave, "form": "gain"} if name == "learned" else {}
    if name == "learned" and "gain" not in KNEE[name].spots_at(start)[0].follows:
        curve["form"] = "additive"
    declared = DeclaredEffect(name, {**start, **curve})
    plain = Model("eha_knee", _base().parameters)
    without = _simulate(plain.vector() if name == "anti_cavitation" else _base().vector())
    got = _simulate(_base(*(() if name == "anti_cavitation" else (declared,))).vector())
    assert np.all(np.isfinite(got))
    span = np.ptp(without, axis=0)
    seen = float(np.max(np.abs(got - without) / span))
    assert seen > 1e-4, (
        f"'{name}' at {start} changes no channel by more than {seen:.1e} of its span: its default "
        "is no typical size; where the unit depends on the place, write it so "
        "('{effort}/{speed}^2'), and the default becomes a share of what is usual there"
    )


@pytest.mark.parametrize(("name", "start"), CASES)
def test_finite_differences_are_usable(name, start) -> None:
    """Steps of 0.5 % and 1 % agree on the slope: a search by finite differences works.

    Within 0.25 s: periodic effects lose their phase later, as any search on them has to know.
    """
    effect = KNEE[name]
    layout = get_plant("eha_knee").layout
    declared = DeclaredEffect(name, {**start})
    if name == "learned":
        declared = DeclaredEffect(name, {"values": list(np.sin(np.arange(24.0)))})
    base = _base(*(() if name == "anti_cavitation" else (declared,)))
    vector = base.vector()
    middle = _simulate(vector, 25e-6)
    span = np.ptp(middle, axis=0)
    for parameter in effect.search_parameters(start):
        if parameter.size > 1 or parameter.name == "count":
            continue  # a curve; whole numbers, to be scanned
        at = layout.index[f"{name}.{parameter.name}"]
        size = abs(vector[at]) or 1.0
        slopes = []
        for share in (0.005, 0.01):
            moved = vector.copy()
            moved[at] += share * size
            slopes.append((_simulate(moved, 25e-6) - middle) / span / share)
        if start.get("side") == 1.0:
            slopes = [slope[:, :5] for slope in slopes]  # the velocity beyond a gap jumps
        norm = np.linalg.norm(slopes[1])
        if norm < 1e-3:
            continue
        # rest and slip make corners: alike to a third is enough to find the way downhill
        assert np.linalg.norm(slopes[0] - slopes[1]) < 0.35 * norm, parameter.name


def test_a_plant_has_the_effects_that_it_has_places_for() -> None:
    assert {effect.id for effect in registered_effects()} == set(EFFECTS)
    drive = {effect.id for effect in get_plant("linear_drive").layout.effects}
    assert {"coulomb_friction", "asymmetric_friction", "load_dependent_friction"} <= drive
    assert not drive & {"entrained_air", "pump_ripple", "valve_lag", "pressure_sensor_lag"}
    assert not set(KNEE) & {"valve_deadband", "supply_sag", "load_dependent_friction"}


LOGGED_SUPPLY = """
plant: seal_rig
nodes:
  air:      {kind: reservoir, pressure: 1 bar}
  ambient:  {kind: reservoir, pressure: 0 bar}
  carriage: {kind: translation}
  rod:      {kind: translation, mass: 0.3 kg}
elements:
  cylinder: {kind: cylinder, on: rod, a: air, b: ambient, area_a: 5 cm^2, area_b: 5 cm^2}
  cell:     {kind: load_cell, between: [rod, carriage], stiffness: 4e4 N/m, damping: 50 N*s/m}
channels: {carriage_position: carriage.position, cell_force: cell.force}
"""


@pytest.mark.parametrize("logged", [False, True])
def test_a_supply_sags_only_where_its_pressure_is_not_logged(tmp_path: Path, logged: bool) -> None:
    """What an input gives is as it was measured: nothing unknown can act there either."""
    path = tmp_path / "plant.yaml"
    path.write_text(LOGGED_SUPPLY + "inputs: {air_pressure: air.pressure}\n" * logged)
    layout = load_model(path).plant.layout
    assert ("supply_sag" in {effect.id for effect in layout.effects}) is not logged
    places = {spot.name for spot in layout.effect("learned").spots}
    assert places - {"air"} == {"rod", "carriage_position.sensor", "cell_force.sensor"}
    assert ("air" in places) is not logged


def test_what_moves_behind_a_load_cell_may_follow_what_is_logged_before_it(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(LOGGED_SUPPLY + "inputs: {air_pressure: air.pressure}\n")
    (rod,) = (
        spot for spot in load_model(path).plant.layout.effect("learned").spots if spot.name == "rod"
    )
    # its speed, too, which a cell transmits and nobody logs
    assert rod.follows["additive"] == ("time", "carriage_position", "carriage_velocity")
    assert rod.follows["friction"] == (
        "time", "carriage_position", "air_pressure", "oil_temperature",
    )  # fmt: skip


def test_same_input_gives_the_same_bits() -> None:
    vector = _base(DeclaredEffect("presliding_friction"), DeclaredEffect("current_lag")).vector()
    np.testing.assert_array_equal(_simulate(vector), _simulate(vector))


def test_all_effects_at_once_stay_finite() -> None:
    skip = {"anti_cavitation", "learned"}
    every = [DeclaredEffect(name) for name in KNEE if name not in skip]
    assert np.all(np.isfinite(_simulate(_base(*every).vector())))
