"""A model: a plant, what differs from its defaults, its effects, and what may be calibrated.

The file format is model.yaml (contract, section 3): it can be diffed, and what `diagnose` writes
is read again by `run --target`, `predict` and the next `diagnose`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place, PluginError, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.plant import Plant, get_plant

FloatArray = NDArray[np.float64]
Value = float | str | list[float]


@dataclass(frozen=True)
class DeclaredEffect:
    """An effect with its parameters: a number, or a word, or a list for a curve; SI."""

    id: str
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Model:
    """A plant with parameters and effects, all SI.

    Attributes:
        plant_id: id of the plant.
        parameters: values that differ from the plant's defaults.
        calibrate: names of parameters that calibration may estimate.
        effects: declared effects.
    """

    plant_id: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrate: tuple[str, ...] = ()
    effects: tuple[DeclaredEffect, ...] = ()

    @property
    def plant(self) -> Plant:
        """The plant, compiled on first use."""
        return get_plant(self.plant_id)

    def value(self, name: str) -> float:
        """Value of a plant parameter, SI."""
        if name in self.parameters:
            return self.parameters[name]
        return self.plant.layout.by_key[name].default

    def vector(self) -> FloatArray:
        """Return the parameter vector `P` of the plant's layout."""
        layout = self.plant.layout
        vector = layout.defaults()
        for name, value in self.parameters.items():
            vector[layout.index[name]] = value
        for declared in self.effects:
            effect = layout.effect(declared.id)
            for parameter in effect.parameters:
                at = layout.index[f"{effect.id}.{parameter.name}"]
                given = declared.values.get(parameter.name, parameter.default)
                vector[at : at + parameter.size] = _encoded(parameter, given)
        return vector

    def with_parameters(self, values: Mapping[str, float]) -> Model:
        """Return a copy with plant parameters replaced."""
        return replace(self, parameters={**self.parameters, **values})

    def with_effect(self, effect: DeclaredEffect) -> Model:
        """Return a copy with an effect added, or replaced where it is declared already."""
        kept = tuple(other for other in self.effects if other.id != effect.id)
        return replace(self, effects=(*kept, effect))

    def to_yaml(self, comment: str = "") -> str:
        """Return the model as model.yaml text."""
        from ruamel.yaml import YAML

        parameters = {name: float(value) for name, value in self.parameters.items()}
        data: dict[str, Any] = {"model": self.plant_id, "parameters": parameters}
        if self.calibrate:
            data["calibrate"] = list(self.calibrate)
        if self.effects:
            data["effects"] = [
                {"effect": item.id, **{key: _plain(value) for key, value in item.values.items()}}
                for item in self.effects
            ]
        stream = StringIO()
        writer = YAML()
        writer.default_flow_style = None
        writer.width = 100
        writer.dump(data, stream)
        head = "".join(f"# {line}\n" for line in comment.splitlines())
        return head + stream.getvalue()

    def write(self, path: Path, comment: str = "") -> None:
        """Write model.yaml, whole or not at all."""
        write_text(path, self.to_yaml(comment))

    @property
    def sha256(self) -> str:
        """Digest of what the model says, independent of comments and order of files."""
        return hashlib.sha256(self.to_yaml().encode()).hexdigest()


def load_model(path: Path) -> Model:
    """Read a model.yaml.

    Raises:
        InputError: unknown plant, parameter or effect, or a wrong unit, with file, line and key.
    """
    from eha_bench.core import yaml_file

    return parse_model(yaml_file.load(path), str(path))


def parse_model(content: Any, name: str, prefix: Sequence[int | str] = ()) -> Model:
    """Return the model that a YAML mapping holds; `name` is the file for messages."""
    # a third of what a first simulation imports, which one of a model made in Python does without
    from eha_bench.core import yaml_file
    from eha_bench.plants.model_file import ModelFile

    file = yaml_file.validate(ModelFile, content, name, prefix)

    def place(*keys: int | str) -> Place:
        line = yaml_file.line_of(content, keys)
        return Place(file=name, line=line, key=".".join(str(key) for key in (*prefix, *keys)))

    try:
        layout = get_plant(file.model).layout
    except PluginError as error:
        raise InputError(error.what, where=place("model"), hint=error.hint) from error
    own = {parameter.name: parameter for parameter in layout.parameters}
    parameters = {}
    for key, raw in file.parameters.items():
        where = place("parameters", key)
        parameters[key] = float(_checked(_known(own, key, where), raw, where))
    for number, key in enumerate(file.calibrate):
        _known(own, key, place("calibrate", number))
    effects = tuple(
        _parse_effect(layout, raw, number, place) for number, raw in enumerate(file.effects)
    )
    seen = [effect.id for effect in effects]
    for number, effect_id in enumerate(seen):
        if effect_id in seen[:number]:
            raise InputError(
                f"effect '{effect_id}' is declared twice", where=place("effects", number)
            )
    return Model(file.model, parameters, tuple(file.calibrate), effects)


def _parse_effect(
    layout: Layout, raw: Mapping[str, Any], number: int, place: Callable[..., Place]
) -> DeclaredEffect:
    if "effect" not in raw:
        raise InputError("key 'effect' is missing", where=place("effects", number))
    try:
        effect = layout.effect(str(raw["effect"]))
    except PluginError as error:
        where = place("effects", number, "effect")
        raise InputError(error.what, where=where, hint=error.hint) from error
    own = {parameter.name: parameter for parameter in effect.parameters}
    here = effect.action(layout.plant).choices
    values = {}
    for key, value in raw.items():
        if key != "effect":
            where = place("effects", number, key)
            values[key] = _checked(_known(own, key, where), value, where, here.get(key))
    return DeclaredEffect(effect.id, values)


def _known(own: Mapping[str, Parameter], key: str, where: Place) -> Parameter:
    if key not in own:
        raise InputError(f"unknown parameter '{key}'", where=where, hint=suggest(key, own))
    return own[key]


def _checked(
    parameter: Parameter, raw: Any, where: Place, words: tuple[str, ...] | None = None
) -> Any:
    """Return a value in SI after checking unit, bounds and form; `words` narrows the choices."""
    if parameter.choices:
        allowed = words or parameter.choices
        if raw not in allowed:
            raise InputError(
                f"'{raw}' is not a choice", where=where, hint=suggest(str(raw), allowed)
            )
        return raw
    if parameter.size > 1 or isinstance(raw, list):
        if not isinstance(raw, list) or len(raw) != parameter.size:
            wanted = "one number" if parameter.size == 1 else f"a list of {parameter.size} numbers"
            raise InputError(f"expected {wanted}", where=where)
        return [float(_checked(replace(parameter, size=1), item, where)) for item in raw]
    from eha_bench.core import units

    try:
        value = units.parse(raw, parameter.unit)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if not parameter.low <= value <= parameter.high:
        raise InputError(
            f"{value:g} {parameter.unit} is outside {parameter.low:g} ... {parameter.high:g}",
            where=where,
        )
    return value


def _plain(value: Value) -> Value:
    """Return a value of Python's own types, whatever numpy's it was computed as."""
    if isinstance(value, str):
        return str(value)
    return [float(item) for item in value] if isinstance(value, list) else float(value)


def _encoded(parameter: Parameter, value: Value) -> float | list[float]:
    return value if isinstance(value, list) else parameter.encode(value)
