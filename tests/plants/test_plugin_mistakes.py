"""What somebody who writes an effect or an element gets wrong is said with its place."""

import math
from collections.abc import Callable

import pytest

from eha_bench.core.errors import PluginError, UnitError
from eha_bench.core.units import parse
from eha_bench.plants.network.compiler import refuse_uncompiled
from eha_bench.plants.network.element import Anatomy, Effort, ElementKind, NodeKind, Port
from eha_bench.plants.network.network import Element, Network, Node
from eha_bench.plants.network.system import System
from eha_bench.plants.parameter import Parameter

DAMPING = Parameter("damping", "N*m*s/rad", 0.1, 0.0, math.inf)


def misspelt(speed: float, damping: float) -> float:
    return -dampin * speed  # noqa: F821 - the mistake


def misspelt_of_math(speed: float, damping: float) -> float:
    return damping * math.copysig(1.0, speed)  # type: ignore[attr-defined]  # the mistake


def nothing(speed: float, damping: float) -> None:
    _ = damping * speed


def brake(speed: float, damping: float) -> float:
    return -damping * speed


def unknown(velocity: float, damping: float) -> float:
    return -damping * velocity


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (misspelt, r"misspelt \(.*test_plugin_mistakes.py:\d+\) cannot be compiled: .*'dampin'"),
        (misspelt_of_math, r"misspelt_of_math \(.*\) cannot be compiled: .*copysig"),
        (nothing, r"nothing \(.*\) returns none, and a number is expected"),
    ],
)
def test_a_function_that_cannot_be_compiled_is_named(law: Callable[..., object], said: str) -> None:
    refuse_uncompiled([brake])
    with pytest.raises(PluginError, match=said):
        refuse_uncompiled([brake, law])


def _kind(anatomy: Callable[[frozenset[str]], Anatomy], required: tuple[str, ...]) -> ElementKind:
    ports = (Port("on", (NodeKind.ROTATION,)),)
    return ElementKind("damper", "A damper.", ports, (DAMPING,), anatomy, required)


def _laid_out(kind: ElementKind) -> System:
    node = Node("shaft", NodeKind.ROTATION, {"inertia": 1e-3})
    element = Element("damper", kind, {"on": "shaft"}, {"damping": 0.1})
    channels = {"motor_speed": ("shaft", "speed")}
    return System(Network("tiny", {"shaft": node}, {"damper": element}, {}, channels))


def test_a_law_that_names_what_there_is_not_is_told_what_there_is() -> None:
    kind = _kind(lambda _: Anatomy((DAMPING,), (Effort("on", unknown),)), ())
    system = _laid_out(kind)
    with pytest.raises(PluginError, match=r"asks for 'velocity'.*it has: damping, speed, position"):
        system.call(system.parts["damper"], unknown)


def test_an_anatomy_that_fails_is_named_with_its_place() -> None:
    def anatomy(declared: frozenset[str]) -> Anatomy:
        raise KeyError("threshold")

    with pytest.raises(
        PluginError, match=r"anatomy of the element kind 'damper' fails .*KeyError.*in anatomy"
    ):
        _laid_out(_kind(anatomy, ()))


def test_what_is_required_is_a_parameter() -> None:
    said = "requires 'dampening', which is no parameter of it; did you mean 'damping'"
    with pytest.raises(PluginError, match=said):
        _kind(lambda _: Anatomy(()), ("dampening",))


def test_a_wrong_unit_of_a_parameter_is_not_blamed_on_who_gives_a_value() -> None:
    with pytest.raises(UnitError, match="'1/Bar', the unit that is expected here, is not one"):
        parse("2e-8 1/Pa", "1/Bar")
