"""From a parameter vector back to a model.yaml."""

from __future__ import annotations

from collections.abc import Sequence

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import DeclaredEffect, Model


def revised_model(
    model: Model, vector: FloatArray, keys: Sequence[str], effects: Sequence[str] = ()
) -> Model:
    """Return a model with some parameters and effects as a vector has them.

    Args:
        model: the declared one.
        vector: parameters, as the plant's layout orders them.
        keys: parameters that were estimated (plant's, or `effect.name` of a declared effect);
            a run's own parameters belong to no model.
        effects: ids of effects that were added.
    """
    layout = model.plant.layout
    plants_own = {parameter.name for parameter in layout.parameters}
    own = [key for key in keys if key in plants_own]
    out = model.with_parameters({key: float(vector[layout.index[key]]) for key in own})
    for item in model.effects:
        ours = {key.rpartition(".")[2]: float(vector[layout.index[key]]) for key in keys
                if key not in plants_own and key in layout.index
                and key.rpartition(".")[0] == item.id}  # fmt: skip
        if ours:
            out = out.with_values(item.id, ours)
    for name in effects:
        out = out.with_effect(_declared_effect(model, vector, name))
    return out


def _declared_effect(model: Model, vector: FloatArray, name: str) -> DeclaredEffect:
    layout = model.plant.layout
    values: dict[str, float | str | list[float]] = {}
    for parameter in layout.effect(name).parameters:
        at = layout.index[f"{name}.{parameter.name}"]
        if parameter.size > 1:
            values[parameter.name] = [float(v) for v in vector[at : at + parameter.size]]
        else:
            values[parameter.name] = parameter.decode(float(vector[at]))
    return DeclaredEffect(name, values)
