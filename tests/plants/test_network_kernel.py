"""How a network and its effects become one kernel, also with effects of other people's packages."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from textwrap import dedent
from typing import NamedTuple

import numpy as np
import pytest

from eha_bench.core.errors import PluginError
from eha_bench.plants.compiled import njit
from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.effects import current_lag
from eha_bench.plants.file_kind import PLANT
from eha_bench.plants.network import compiler
from eha_bench.plants.network.compiler import kernel_folder
from eha_bench.plants.network.element import Anatomy, Effort
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.parameter import Parameter, choice
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

PACKAGE = {
    "stray_field/__init__.py": "",
    "stray_field/effect.py": """
        '''A field from outside pulls what moves towards position 0.'''

        from eha_bench.plants.effect import Action, Effect
        from eha_bench.plants.parameter import Parameter


        def pull(effort, position, stiffness):
            return effort - stiffness * position


        EFFECT = Effect(
            id="stray_field",
            summary="A field pulls what moves back.",
            parameters=(Parameter("stiffness", "N/m", 100.0, 0.0, 1e6),),
            actions={"friction": Action({"net": pull})},
            source="this test",
            separate="let go of the carriage",
        )
    """,
    "stray_field-1.0.dist-info/METADATA": """
        Metadata-Version: 2.1
        Name: stray-field
        Version: 1.0
    """,
    "stray_field-1.0.dist-info/entry_points.txt": """
        [eha_bench.effects]
        stray_field = stray_field.effect:EFFECT
    """,
}
SCRIPT = """
    import numpy as np
    from eha_bench.plants.model import DeclaredEffect, Model
    from eha_bench.plants.plant import Drive
    from eha_bench.plants.registry import get_plant

    plant = get_plant("linear_drive")
    assert "stray_field" in {effect.id for effect in plant.layout.effects}
    time = np.arange(0.0, 1.0, 1e-3)
    field = DeclaredEffect("stray_field", {"stiffness": 400.0})
    model = Model("linear_drive", {"mass": 1.0, "viscous_friction": 0.0}, (), (field,))
    drive = Drive(time, {"voltage": np.zeros(time.size)}, {"piston_position": 0.01})
    x = plant.simulate(model.vector(), drive, 1e-4)[:, 1]
    assert np.max(np.abs(x - 0.01 * np.cos(20.0 * time))) < 1e-6
    print("swings")
"""


def _write_package(folder: Path) -> None:
    for name, text in PACKAGE.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text).lstrip(), encoding="utf-8")


@pytest.mark.slow
def test_effect_of_a_foreign_package_is_found_and_compiled(tmp_path) -> None:
    """One file and one line in a package's metadata add an effect: nothing here names it."""
    _write_package(tmp_path)
    environment = {
        **os.environ,
        "PYTHONPATH": str(tmp_path),
        "EHA_BENCH_CACHE": str(tmp_path / "cache"),
    }
    done = subprocess.run(
        [sys.executable, "-c", dedent(SCRIPT)], env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "swings"


def _drive(*effects: Effect) -> NetworkPlant:
    return NetworkPlant(get_plant("linear_drive").network, effects)


def _effect(function, hook="net", **options) -> Effect:
    return Effect(
        id="mine", summary="Mine.", parameters=(Parameter("size", "N", 1.0, 0.0, 1e6),),
        actions={"friction": Action({hook: function})}, source="here", **options,
    )  # fmt: skip


def _with_unknown_quantity(force, pressure):
    return force + pressure


def _plain(force, size):
    return force + size


def _twice(force, size):
    return force + 2.0 * size


class Where(NamedTuple):
    position: float
    speed: float


class Elsewhere(NamedTuple):
    position: float
    pressure: float


def _spring(force, size, where: Where):
    return force - size * where.position


def _with_unknown_field(force, where: Elsewhere):
    return force + where.pressure


def test_quantity_that_is_not_there_is_named_with_what_is() -> None:
    said = r"'mine' asks for 'pressure' in _with_unknown.*there are: .*speed"
    with pytest.raises(PluginError, match=said):
        _ = _drive(_effect(_with_unknown_quantity)).compiled


def test_fields_of_a_named_tuple_are_bound_by_name() -> None:
    """A spring on the carriage swings at sqrt(k / M) (the carriage's own friction is off)."""
    plant = _drive(_effect(_spring))
    vector = plant.layout.defaults()
    values = {"mass": 100.0, "viscous_friction": 0.0, "coulomb_friction": 0.0, "mine.size": 4e4}
    for key, value in values.items():
        vector[plant.layout.index[key]] = value
    time = np.arange(0.0, 1.0, 1e-3)
    drive = Drive(time, {"voltage": np.zeros(time.size)}, {"piston_position": 0.01})
    out = plant.simulate(vector, drive, 1e-4)
    np.testing.assert_allclose(out[:, 1], 0.01 * np.cos(20.0 * time), atol=2e-6)


def test_field_that_is_not_there_is_named_with_what_is() -> None:
    with pytest.raises(PluginError, match=r"'mine' asks for 'pressure' in _with_unknown_field"):
        _ = _drive(_effect(_with_unknown_field)).compiled


def test_hook_that_is_not_there_is_named_with_what_is() -> None:
    with pytest.raises(PluginError, match=r"hook 'delivery', which the role 'friction' does.*net"):
        _ = _drive(_effect(_plain, hook="delivery")).compiled


def _doubled(value):
    return 2.0 * value


@njit()
def _halved(value):
    return 0.5 * value


def _helped_by_python(force, size):
    return force + _doubled(size)


def _helped(force, size):
    return force + _halved(size)


def test_a_helper_that_is_not_compiled_is_named_with_the_way_out() -> None:
    said = r"_helped_by_python \(.*test_network_kernel.py:\d+\) .* calls '_doubled'.*@njit\(\)"
    plant = _drive(_effect(_helped_by_python))
    with pytest.raises(PluginError, match=said):
        plant.check()
    with pytest.raises(PluginError, match=said):
        _ = plant.compiled
    _drive(_effect(_helped)).check()


def test_a_role_that_nothing_plays_is_named_with_the_nearest() -> None:
    stray = replace(_effect(_plain), actions={"frictoin": Action({"net": _plain})})
    with pytest.raises(PluginError, match=r"role 'frictoin', which there is not; .*'friction'"):
        _drive(stray)


def test_a_port_that_an_element_does_not_have_is_named_with_the_nearest() -> None:
    network = get_plant("linear_drive").network
    name, element = next(iter(network.elements.items()))
    (port, *_) = element.ports
    stray = Anatomy((), (Effort(f"{port}x", _plain),))
    kind = replace(element.kind, id="stray", anatomy=lambda declared: stray)
    changed = {name: replace(element, kind=kind, values={})}
    with pytest.raises(PluginError, match=f"'stray' acts on a port '{port}x' .*mean '{port}'"):
        NetworkPlant(replace(network, elements={**network.elements, **changed}), ())


def test_a_file_is_valid_only_if_its_plug_ins_are(tmp_path, monkeypatch) -> None:
    """`validate` says it before anything is compiled or run."""
    path = tmp_path / "plant.yaml"
    path.write_text(
        "plant: puck\nnodes: {puck: {kind: translation, mass: 2 kg}}\n"
        "elements: {push: {kind: load, on: puck, force: 0 N}}\n"
        "inputs: {force: push.force}\nchannels: {piston_position: puck.position}\n"
    )
    monkeypatch.setattr(
        "eha_bench.plants.network.file.registered_effects",
        lambda: (_effect(_with_unknown_quantity),),
    )
    with pytest.raises(PluginError, match="'mine' asks for 'pressure'"):
        PLANT.check(path)


def test_effect_without_a_place_is_none_of_the_plant_s() -> None:
    other = replace(_effect(_plain), actions={"valve": Action({"opening": _plain})})
    assert _drive(other).layout.effects == ()


def test_first_compilation_is_announced_once(tmp_path, monkeypatch, caplog) -> None:
    monkeypatch.setenv("EHA_BENCH_CACHE", str(tmp_path))
    compiler._say_that_it_compiles.cache_clear()
    with caplog.at_level(logging.INFO, logger="eha_bench"):
        module = _drive(_effect(_twice)).compiled
        assert "compiling kernels of linear_drive (once per machine)" in caplog.text
        caplog.clear()
        assert _drive(_effect(_twice)).compiled is module
        assert not caplog.text
    assert kernel_folder() == tmp_path
    assert [path.suffix for path in tmp_path.iterdir() if path.is_file()] == [".py"]


def test_folder_that_cannot_be_written_costs_a_compilation_but_works(
    tmp_path, monkeypatch, caplog
) -> None:
    (tmp_path / "file").write_text("not a folder", encoding="utf-8")
    monkeypatch.setenv("EHA_BENCH_CACHE", str(tmp_path / "file" / "cache"))
    with caplog.at_level(logging.WARNING, logger="eha_bench"):
        module = _drive(_effect(_plain, states=("idle",))).compiled
    assert "EHA_BENCH_CACHE" in caplog.text
    assert Path(module.__file__).exists()


def test_kernel_is_named_after_what_it_is_made_of(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("EHA_BENCH_CACHE", str(tmp_path))
    names = {
        _drive(*effects).compiled.__name__
        for effects in ((), (current_lag.EFFECT,), (_effect(_plain),))
    }
    assert len(names) == 3


def test_numbers_of_a_plant_are_not_in_its_kernel() -> None:
    """Another value is another vector, never another compilation."""
    network = get_plant("linear_drive").network
    carriage = replace(network.nodes["carriage"], values={"mass": 7.0})
    other = replace(network, nodes={**network.nodes, "carriage": carriage})
    assert NetworkPlant(other, ()).compiled is NetworkPlant(network, ()).compiled


def test_layout_places_every_parameter_once() -> None:
    layout = get_plant("eha_knee").layout
    spans = sorted(
        (layout.index[key], layout.index[key] + parameter.size) for key, parameter in layout.items()
    )
    assert spans[0][0] == 0
    assert spans[-1][1] == layout.size
    assert all(one[1] == two[0] for one, two in pairwise(spans))


def test_defaults_leave_every_effect_off() -> None:
    layout = get_plant("eha_knee").layout
    vector = layout.defaults()
    for effect in layout.effects:
        assert vector[layout.index[f"{effect.id}.{effect.strength.name}"]] == effect.neutral


@pytest.mark.parametrize("plant", ["eha_knee", "linear_drive"])
def test_sensors_are_ideal_unless_an_effect_acts_on_what_they_read(plant) -> None:
    """By the place where it acts: a curve in the drive leaves the sensors alone."""
    layout = get_plant(plant).layout
    assert layout.sensors_are_ideal(layout.defaults())
    effect = layout.effect("learned")
    for number, spot in enumerate(effect.spots):
        vector = layout.defaults()
        vector[layout.index["learned.scale"]] = 1.0
        vector[layout.index["learned.at"]] = number
        assert layout.sensors_are_ideal(vector) == (spot.equation != "measurement"), spot.name


def test_an_offset_makes_a_sensor_tell_another_value_than_the_state() -> None:
    layout = get_plant("eha_knee").layout
    vector = layout.defaults()
    vector[layout.index["pressure_sensor_offset.offset"]] = 1e5
    assert not layout.sensors_are_ideal(vector)


def test_what_scales_comes_after_what_adds() -> None:
    order = {bound.id: bound.effect.order for bound in get_plant("eha_knee").layout.effects}
    assert order["coulomb_friction"] < order["asymmetric_friction"] < order["presliding_friction"]
    assert order["pressure_sensor_lag"] < order["pressure_sensor_offset"]


def test_parameter_refuses_a_default_outside_its_bounds() -> None:
    with pytest.raises(ValueError, match="outside its bounds"):
        Parameter("x", "", 2.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="outside its bounds"):
        Parameter("x", "", np.nan, 0.0, 1.0)
    with pytest.raises(ValueError, match="place of no choice"):
        replace(choice("x", ("a", "b")), default=2.0, high=3.0)


def test_effect_that_repeats_a_declared_parameter_says_so() -> None:
    friction = get_plant("eha_knee").layout.effect("coulomb_friction")
    assert friction.repeats({"at": "rod"}) == "rod_coulomb"
    assert friction.repeats({"at": "shaft"}) == "coulomb_torque"
    assert get_plant("linear_drive").layout.effect("coulomb_friction").repeats() == (
        "coulomb_friction"
    )
    assert get_plant("eha_knee").layout.effect("current_lag").repeats() == ""
