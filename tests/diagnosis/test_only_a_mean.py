"""A constant that is only the mean of what follows a variable is no cause."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome.only_a_mean import is_constant, only_a_mean
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.plants.registry import get_plant

LEFT = Remainder(0.43, "force", "platen", "position", 0.99, found_there=("gravity_load",))


@pytest.mark.parametrize(
    ("plant", "constant"),
    [
        ("linear_drive", {"gravity_load"}),
        # its weight turns with the joint
        ("eha_knee", {"pressure_sensor_offset"}),
    ],
)
def test_a_weight_on_a_slide_and_a_sensors_zero_are_constant(
    plant: str, constant: set[str]
) -> None:
    found = {effect.id for effect in get_plant(plant).layout.effects if is_constant(effect)}
    assert found == constant


def _search(*names: str, share: float = 0.54) -> SimpleNamespace:
    gain = SimpleNamespace(share=share, share_out=share)
    items = [SimpleNamespace(start=SimpleNamespace(candidate=n), comparison=gain) for n in names]
    roles = SimpleNamespace(rates=("velocity",))
    plant = SimpleNamespace(layout=get_plant("linear_drive").layout, roles=roles)
    problem = SimpleNamespace(plant=plant)
    return SimpleNamespace(effects=items, thresholds=DEFAULT, problem=problem)


def test_a_weight_is_the_mean_of_a_spring_that_stiffens() -> None:
    refused = only_a_mean(_search("coulomb_friction", "gravity_load"), LEFT)
    assert refused is not None
    assert refused.note == (
        "gravity_load is not accepted: it is constant and explains 54 %, and a curve of position "
        "at its place 99 % of what it leaves: it is the mean of what follows position"
    )


@pytest.mark.parametrize(
    "left",
    [
        replace(LEFT, share=0.1),  # little remains
        replace(LEFT, explained=0.7),  # the curve does not explain it
        replace(LEFT, variable="", explained=0.0),
        replace(LEFT, variable="velocity"),  # a friction is odd: a weight is no mean of it
        replace(LEFT, variable="time"),
        replace(LEFT, found_there=()),  # what remains acts elsewhere
        replace(LEFT, found_there=("coulomb_friction",)),  # which is no constant
    ],
)
def test_what_else_remains_says_nothing_against_a_constant(left: Remainder) -> None:
    assert only_a_mean(_search("coulomb_friction", "gravity_load"), left) is None
