"""Values of a model by name: a plant's own (`leakage`), an effect's (`command_delay.delay`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.plants.model import Model, checked_value
from eha_bench.plants.parameter import Parameter


def numbers_of(model: Model) -> dict[str, Parameter]:
    """Return every parameter that is one number, by key: the plant's, and declared effects'."""
    layout = model.plant.layout
    own = {item.name: item for item in layout.parameters}
    for declared in model.effects:
        effect = layout.effect(declared.id)
        own |= {
            f"{effect.id}.{item.name}": effect.parameter_at(item.name, declared.values)
            for item in effect.parameters
        }
    return {key: item for key, item in own.items() if item.size == 1 and not item.choices}


def parameter_named(model: Model, key: str, where: Place) -> tuple[str, Parameter]:
    """Return a parameter's key in the plant's layout and the parameter itself.

    Raises:
        InputError: the model has no such number; one of an effect that it does not declare is
            called so.
    """
    layout = model.plant.layout
    known = numbers_of(model)
    name = layout.key(key)
    if name in known:
        return name, known[name]
    effect = name.partition(".")[0]
    if name in layout.by_key and effect in {item.id for item in layout.effects}:
        raise InputError(
            f"'{key}' is of an effect that the model does not declare",
            where=where,
            hint=f"declare {effect} under the model's effects",
        )
    raise InputError(
        f"the model has no parameter '{key}'",
        where=where,
        hint=suggest(key, (*known, *layout.synonyms)),
    )


def read_value(model: Model, key: str, raw: Any, where: Place) -> float:
    """Return a value for a parameter in SI, checked for unit and bounds.

    Raises:
        InputError: no such parameter, a wrong unit, or outside of its bounds.
    """
    _, parameter = parameter_named(model, key, where)
    return float(checked_value(parameter, raw, where))


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """Return a model with other values of its parameters, SI, by key."""
    layout = model.plant.layout
    own = {item.name for item in layout.parameters}
    for key, value in values.items():
        name = layout.key(key)
        if name in own:
            model = model.with_parameters({name: value})
        else:
            effect, _, parameter = name.partition(".")
            model = model.with_values(effect, {parameter: value})
    return model
