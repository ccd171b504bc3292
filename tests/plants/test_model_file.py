"""model.yaml: read, refused with file, line and key, written and read again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.errors import InputError
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.plants.registry import get_plant

GOOD = """\
model: eha_knee
parameters:
  rotor_inertia: 0.001 kg*m^2
  bulk_modulus: 900 MPa
calibrate: [coulomb_torque, leakage]
effects:
  - {effect: anti_cavitation, charge_pressure: 6 bar, valve_conductance: 6e-10 m^3/(s*Pa)}
  - {effect: pressure_sensor_offset, offset: -2 bar, at: pressure_b}
"""


def _load(tmp_path, text):
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    return load_model(path)


def test_units_are_converted_and_the_rest_keeps_its_default(tmp_path) -> None:
    model = _load(tmp_path, GOOD)
    assert model.value("bulk_modulus") == 9e8
    assert model.value("torque_constant") == 0.13
    assert model.calibrate == ("coulomb_torque", "leakage")
    vector, index = model.vector(), model.plant.layout.index
    assert vector[index["anti_cavitation.charge_pressure"]] == pytest.approx(0.6e6)
    assert vector[index["pressure_sensor_offset.offset"]] == pytest.approx(-2e5)
    assert vector[index["pressure_sensor_offset.at"]] == 2.0
    assert vector[index["current_lag.time_constant"]] == 0.0


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("model: eha_knee", "model: eha_kne", 1, "did you mean 'eha_knee'"),
        ("rotor_inertia:", "rotor_inertai:", 3, "did you mean 'rotor_inertia'"),
        ("0.001 kg*m^2", "0.001 kg", 3, "wrong dimension"),
        ("0.001 kg*m^2", "0.001 kgs*m^2", 3, "unknown unit"),
        ("0.001 kg*m^2", "-1.0", 3, "outside"),
        ("0.001 kg*m^2", ".nan", 3, "nan"),
        ("[coulomb_torque, leakage]", "[coulomb_torque, leekage]", 5, "did you mean 'leakage'"),
        ("effect: anti_cavitation", "effect: anti_cavitatoin", 7, "anti_cavitation"),
        ("charge_pressure: 6 bar", "charge_pressur: 6 bar", 7, "did you mean 'charge_pressure'"),
        ("charge_pressure: 6 bar", "charge_pressure: 6 m", 7, "wrong dimension"),
        ("charge_pressure: 6 bar", "charge_pressure: -6 bar", 7, "outside"),
        ("charge_pressure: 6 bar", "charge_pressure: [1, 2]", 7, "expected one number"),
        ("at: pressure_b", "at: pressure_c", 8, "it may act at: all, pressure_a, pressure_b"),
        ("at: pressure_b", "at: 1", 8, "cannot act at"),
        (
            "at: pressure_b",
            "at: [pressure_a, pressure_b]",
            8,
            "names one place, or all of its kind",
        ),
        ("effect: pressure_sensor_offset", "effct: x", 8, "key 'effect' is missing"),
        ("effect: pressure_sensor_offset", "effect: anti_cavitation", 8, ""),
        ("parameters:", "params:", 2, "unknown key"),
    ],
)
def test_mistake_is_named_with_file_line_and_key(tmp_path, old, new, line, says) -> None:
    assert old in GOOD
    with pytest.raises(InputError) as caught:
        _load(tmp_path, GOOD.replace(old, new))
    text = str(caught.value)
    assert f"model.yaml:{line}" in text
    assert says in text


def test_effect_declared_twice_is_refused(tmp_path) -> None:
    text = GOOD + "  - {effect: anti_cavitation}\n"
    with pytest.raises(InputError, match=r"model.yaml:9.*declared twice"):
        _load(tmp_path, text)


def test_effect_of_another_plant_is_refused(tmp_path) -> None:
    text = "model: linear_drive\neffects:\n  - {effect: entrained_air}\n"
    with pytest.raises(InputError, match=r"model.yaml:3.*entrained_air"):
        _load(tmp_path, text)


def test_choice_that_makes_no_sense_in_the_plant_is_refused(tmp_path) -> None:
    text = (
        "model: linear_drive\neffects:\n  - {effect: learned, at: carriage, variable: pressure_a}\n"
    )
    with pytest.raises(InputError, match=r"model.yaml:3.*'pressure_a' is not a choice"):
        _load(tmp_path, text)


def test_curve_of_the_wrong_length_is_refused(tmp_path) -> None:
    text = "model: eha_knee\neffects:\n  - {effect: learned, at: rod, values: [1, 2]}\n"
    with pytest.raises(InputError, match=r"model.yaml:3.*list of 24 numbers"):
        _load(tmp_path, text)


def test_written_model_is_read_back_as_it_was(tmp_path) -> None:
    curve = list(np.linspace(-1e-3, 2.5, 24))
    model = Model(
        "eha_knee",
        {"rotor_inertia": 1.0 / 3.0, "leakage": 1.2345678901234567e-13},
        ("leakage",),
        (
            DeclaredEffect("anti_cavitation", {"charge_pressure": 0.6e6}),
            DeclaredEffect("learned", {"at": "pump", "variable": "time", "values": curve}),
        ),
    )
    path = tmp_path / "revised.yaml"
    model.write(path, comment="what was found\nand why")
    again = load_model(path)
    assert again == model
    np.testing.assert_array_equal(again.vector(), model.vector())
    assert again.sha256 == model.sha256
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# what was found\n# and why\n")
    # a line each, so that a diff shows what has changed
    assert f"\n  leakage: {1.2345678901234567e-13!r} # m^3/(s*Pa)\n" in text
    assert "\n  - effect: anti_cavitation\n    charge_pressure: 600000.0 # Pa\n" in text
    assert not any(line.endswith(" ") for line in text.splitlines())
    # as results of earlier versions have it
    assert model.sha256 == "a801f848f9e68386f8cf65d2592426e8de01d991cf269bc6379d7eebeeab8d27"


@given(values=st.dictionaries(
    st.sampled_from(["rotor_inertia", "leakage", "bulk_modulus", "load_mass", "rod_viscous"]),
    st.floats(1e3, 1e12), max_size=5,
))  # fmt: skip
def test_every_model_survives_its_own_file(tmp_path_factory, values) -> None:
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    model = Model("eha_knee", values)
    model.write(path)
    assert load_model(path) == model


def test_added_effect_replaces_the_one_of_its_name() -> None:
    model = Model("eha_knee").with_effect(DeclaredEffect("current_lag", {"time_constant": 1e-3}))
    again = model.with_effect(DeclaredEffect("current_lag", {"time_constant": 2e-3}))
    assert [effect.values for effect in again.effects] == [{"time_constant": 2e-3}]


def test_choices_are_words_in_files_and_places_in_vectors() -> None:
    effect = get_plant("eha_knee").layout.effect("joint_backlash")
    side = effect.parameter("side")
    assert side.encode("load") == 2.0
    assert side.decode(2.0) == "load"
    with pytest.raises(ValueError, match="sideways"):
        side.encode("sideways")


def test_choice_decides_the_equation() -> None:
    effect = get_plant("eha_knee").layout.effect("joint_backlash")
    assert effect.equation() == "measurement"
    assert effect.equation({"side": "load"}) == "force"
    assert effect.equation({"side": 2.0}) == "force"


def test_what_is_believed_and_what_differs_from_run_to_run(tmp_path) -> None:
    text = GOOD.replace(
        "calibrate: [coulomb_torque, leakage]",
        "calibrate: [leakage, {parameter: bulk_modulus, within: 10 %}, "
        "{parameter: rotor_inertia, within: 1e-5}, anti_cavitation.charge_pressure]\n"
        "per_run: [external_force]",
    )
    model = _load(tmp_path, text)
    names = ("leakage", "bulk_modulus", "rotor_inertia", "anti_cavitation.charge_pressure")
    assert model.calibrate == names
    assert model.within == pytest.approx({"bulk_modulus": 9e7, "rotor_inertia": 1e-5})
    assert model.per_run == ("external_force",)
    assert model.value("anti_cavitation.charge_pressure") == pytest.approx(0.6e6)
    (tmp_path / "again.yaml").write_text(model.to_yaml(), encoding="utf-8")
    assert load_model(tmp_path / "again.yaml") == model


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("calibrate: [{parameter: leekage}]", r":5.*calibrate\.0.*did you mean 'leakage'"),
        ("calibrate: [{parameter: leakage, within: 1 m}]", r":5.*calibrate\.0.*wrong dimension"),
        ("calibrate: [{parameter: leakage, within: 0 %}]", r":5.*leaves no room"),
        ("calibrate: [{parameter: leakage, within: 1.0e-20}]", r":5.*is only .* % of"),
        ("calibrate: [{parameter: external_force, within: 10 %}]", r":5.*"),
        ("calibrate: [entrained_air.air_fraction]", r":5.*declare entrained_air under effects"),
        ("calibrate: [pressure_sensor_offset.at]", r":5.*choice of words"),
        ("per_run: [leekage]", r":5.*per_run\.0.*did you mean 'leakage'"),
        ("calibrate: [leakage]\nper_run: [leakage]", r":6.*per_run\.0.*under calibrate as well"),
    ],
)
def test_wrong_entries_of_what_is_estimated(tmp_path, line, says) -> None:
    text = GOOD.replace("calibrate: [coulomb_torque, leakage]", line)
    if "external_force" in line:
        text = text.replace("parameters:", "parameters:\n  external_force: 0", 1)
        says = "leaves no room"
    with pytest.raises(InputError, match=says):
        _load(tmp_path, text)


AXIS = """\
plant: axis
nodes:
  rod:   {{kind: translation{mass}}}
  wheel: {{kind: rotation{inertia}}}
elements:
  rack:  {{kind: gear, from: wheel, to: rod, ratio: 20 rad/m}}
  motor: {{kind: motor, on: wheel, torque_constant: 0.1 N*m/A, current_limit: 9 A}}{more}
inputs:   {{current_command: motor.current}}
channels: {{piston_position: rod.position}}
"""


@pytest.mark.parametrize(
    ("mass", "inertia", "more"),
    [
        (", mass: 0 kg", ", inertia: 0 kg*m^2", ""),
        (", mass: 0 kg", "", ""),
        (", mass: 0 kg", "", "\n  bob: {kind: pendulum, on: wheel, mass: 0 kg, length: 1 m}"),
    ],
)
def test_a_coordinate_that_weighs_nothing_is_refused(tmp_path, mass, inertia, more):
    path = tmp_path / "axis.yaml"
    path.write_text(AXIS.format(mass=mass, inertia=inertia, more=more))
    with pytest.raises(InputError, match=r"inertia of 'rod' is 0 .*give it more than 0") as raised:
        load_model(path)
    assert (raised.value.where.line, raised.value.where.key) == (3, "nodes.rod.mass")


@pytest.mark.parametrize(
    ("mass", "inertia", "more"),
    [
        ("", "", ""),  # a channel shows how it moves
        (", mass: 0 kg", ", inertia: 1 g*cm^2", ""),
        (", mass: 1 g", ", inertia: 0 kg*m^2", ""),
        (", mass: 0 kg", "", "\n  bob: {kind: pendulum, on: wheel, mass: 1 g, length: 1 m}"),
    ],
)
def test_what_moves_with_it_may_weigh_for_a_coordinate(tmp_path, mass, inertia, more):
    path = tmp_path / "axis.yaml"
    path.write_text(AXIS.format(mass=mass, inertia=inertia, more=more))
    load_model(path)


def test_a_parameter_that_makes_a_shaft_weigh_nothing_is_refused_at_its_line(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text("model: eha_knee\nparameters:\n  rotor_inertia: 0 kg*m^2\n")
    with pytest.raises(InputError, match=r"inertia of 'shaft' is 0 \(rotor_inertia") as raised:
        load_model(path)
    assert (raised.value.where.line, raised.value.where.key) == (3, "parameters.rotor_inertia")
