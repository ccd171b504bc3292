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
from typing import TYPE_CHECKING, Any

from eha_bench.core.arrays import FloatArray
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place, PluginError, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.effect import AT, EVERYWHERE
from eha_bench.plants.layout import Layout
from eha_bench.plants.network.file import plant_of
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.plant import Plant
from eha_bench.plants.registry import get_plant

if TYPE_CHECKING:
    from eha_bench.plants.model_file import ModelFile

_LEAST_WITHIN = 1e-4
"""Share of a value that it may be off by at least: less is a unit or a percent sign forgotten."""
_ONE_LINE = 10_000
"""Width of a text in which an element of a plant, or a curve, takes one line however long."""

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
        calibrate: names of parameters that calibration may estimate, also `effect.parameter` of
            declared effects.
        effects: declared effects.
        within: of those under `calibrate`, what the true value may be off by at most, SI.
        per_run: names of unmeasured parameters that differ from run to run.
        network: what a plant.yaml says, where the plant is not a registered one.
        held: what the model below has under `calibrate` or `per_run`, where this one has a list of
            its own without it.
    """

    plant_id: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    calibrate: tuple[str, ...] = ()
    effects: tuple[DeclaredEffect, ...] = ()
    within: Mapping[str, float] = field(default_factory=dict)
    per_run: tuple[str, ...] = ()
    network: Mapping[str, Any] | None = None
    held: tuple[str, ...] = ()

    @property
    def plant(self) -> Plant:
        """The plant, compiled on first use."""
        if self.network is not None:
            return plant_of(self.network)
        return get_plant(self.plant_id)

    def value(self, name: str) -> float:
        """Value of a parameter, SI: the plant's, or `effect.name` of a declared effect."""
        name = self.plant.layout.key(name)
        if name in self.parameters:
            return self.parameters[name]
        if any(name.startswith(f"{effect.id}.") for effect in self.effects):
            return float(self.vector()[self.plant.layout.index[name]])
        return self.plant.layout.by_key[name].default

    def vector(self) -> FloatArray:
        """Return the parameter vector `P` of the plant's layout."""
        layout = self.plant.layout
        vector = layout.defaults()
        for name, value in self.parameters.items():
            vector[layout.index[name]] = value
        for declared in self.effects:
            effect = layout.effect(declared.id)
            for name in declared.values:
                effect.parameter(name)
            for parameter in effect.parameters:
                at = layout.index[f"{effect.id}.{parameter.name}"]
                default = effect.parameter_at(parameter.name, declared.values).default
                given = declared.values.get(parameter.name, default)
                vector[at : at + parameter.size] = _encoded(parameter, given)
        return vector

    def with_parameters(self, values: Mapping[str, float]) -> Model:
        """Return a copy with plant parameters replaced."""
        return replace(self, parameters={**self.parameters, **values})

    def with_effect(self, effect: DeclaredEffect) -> Model:
        """Return a copy with an effect added, or replaced where it is declared already."""
        kept = tuple(other for other in self.effects if other.id != effect.id)
        return replace(self, effects=(*kept, effect))

    def with_values(self, effect: str, values: Mapping[str, Value]) -> Model:
        """Return a copy with some values of a declared effect replaced."""
        effects = tuple(
            replace(item, values={**item.values, **values}) if item.id == effect else item
            for item in self.effects
        )
        return replace(self, effects=effects)

    def to_yaml(self, comment: str = "") -> str:
        """Return the model as model.yaml text, a parameter a line, so that it can be diffed.

        Numbers are SI with all their digits: they are read again bit for bit. Units are comments.
        """
        data, layout = self._content(), self.plant.layout
        units = {name: layout.by_key[layout.key(name)].unit for name in self.parameters}
        data["parameters"] = _with_units(data["parameters"], units)
        items = zip(data.pop("effects", ()), self.effects, strict=True)
        if effects := [self._effect_with_units(item, declared) for item, declared in items]:
            data["effects"] = effects
        head = "".join(f"# {line}\n" for line in comment.splitlines())
        return head + _dumped(data, _ONE_LINE, sequence=4, offset=2)

    def _effect_with_units(
        self, item: Mapping[str, Any], declared: DeclaredEffect
    ) -> Mapping[str, Any]:
        effect = self.plant.layout.effect(declared.id)
        numbers = [name for name, value in item.items() if isinstance(value, float)]
        return _with_units(
            item, {name: effect.parameter_at(name, declared.values).unit for name in numbers}
        )

    def _content(self) -> dict[str, Any]:
        """Return what model.yaml holds, as plain numbers, words, lists and mappings."""
        parameters = {name: float(value) for name, value in self.parameters.items()}
        plant = {"model": self.plant_id} if self.network is None else dict(self.network)
        data: dict[str, Any] = {**plant, "parameters": parameters}
        if self.calibrate:
            data["calibrate"] = [
                {"parameter": key, "within": float(self.within[key])} if key in self.within else key
                for key in self.calibrate
            ]
        if self.per_run:
            data["per_run"] = list(self.per_run)
        if self.effects:
            data["effects"] = [
                {"effect": item.id, **{key: _plain(value) for key, value in item.values.items()}}
                for item in self.effects
            ]
        return data

    def write(self, path: Path, comment: str = "") -> None:
        """Write model.yaml, whole or not at all."""
        write_text(path, self.to_yaml(comment))

    @property
    def sha256(self) -> str:
        """Digest of what the model says, independent of comments and order of files.

        Of the text that it has always been of, whatever `to_yaml` looks like: digests of results
        that are years apart are compared.
        """
        return hashlib.sha256(_dumped(self._content(), 100).encode()).hexdigest()


def _with_units(block: Mapping[str, Any], units: Mapping[str, str]) -> Mapping[str, Any]:
    """Return a mapping that is written a key a line, with units as comments."""
    from ruamel.yaml.comments import CommentedMap

    lines = CommentedMap(block)
    lines.fa.set_block_style()
    for name, unit in units.items():
        if unit:
            lines.yaml_add_eol_comment(unit, name, column=0)
    return lines


def _dumped(data: Mapping[str, Any], width: int, *, sequence: int = 2, offset: int = 0) -> str:
    """Return YAML text whose innermost lists and mappings take a line, unless they say otherwise.

    Args:
        data: what is written. width: of a line. sequence, offset: indent of lists, and of dashes.
    """
    from ruamel.yaml import YAML

    writer = YAML()
    writer.default_flow_style = None
    writer.indent(mapping=2, sequence=sequence, offset=offset)
    writer.width = width
    stream = StringIO()
    writer.dump(data, stream)
    return stream.getvalue()


def load_model(source: str | Path | Mapping[str, Any]) -> Model:
    """Read a model.yaml, a shipped one by its name, or a dict of what it would hold.

    Raises:
        InputError: unknown plant, parameter or effect, or a wrong unit, with file, line and key.
    """
    from eha_bench.core import yaml_file

    path = yaml_file.file_of(source, "model", "models")
    return parse_model(yaml_file.load(path), str(path))


def model_from(source: str | Path | Mapping[str, Any]) -> Model:
    """Return the model that a file of any kind holds: a model.yaml, or a plant by itself.

    `source` is a file, a shipped model's name, or a dict of what the file would hold.

    Raises:
        InputError: the file holds none, or is wrong, with file, line and key.
    """
    from eha_bench.core import yaml_file
    from eha_bench.core.file_kind import kind_by_keys

    path = yaml_file.file_of(source, "model", "models")
    kind = kind_by_keys(yaml_file.peek(path))
    if kind is None or kind.model is None:
        return load_model(path)  # says what it is instead
    model = kind.model(path)
    if not isinstance(model, Model):
        raise PluginError(f"a {kind.name} does not make a model but {type(model).__name__}")
    return model


def parse_model(content: Any, name: str, prefix: Sequence[int | str] = ()) -> Model:
    """Return the model that a YAML mapping holds; `name` is the file for messages."""
    # a third of what a first simulation imports, which one of a model made in Python does without
    from eha_bench.core import yaml_file
    from eha_bench.plants.model_file import ModelFile

    if (
        isinstance(content, Mapping)
        and content.keys() >= {"nodes", "elements"}
        and not content.keys() & {"plant", "model"}
    ):
        # by its other keys it would be a file of another kind
        raise InputError(
            "key 'plant' is missing",
            where=Place(file=name, line=1),
            hint="name the plant in its first line, e.g. plant: my_actuator",
        )
    kind = "" if prefix else "model"
    file = yaml_file.validate(ModelFile, content, name, prefix, kind=kind)

    def place(*keys: int | str) -> Place:
        line = yaml_file.line_of(content, keys)
        return Place(file=name, line=line, key=".".join(str(key) for key in (*prefix, *keys)))

    base = _base(file, content, name, place)
    layout = base.plant.layout
    own = {parameter.name: parameter for parameter in layout.parameters}
    parameters = {**base.parameters}
    for key, raw in file.parameters.items():
        parameters[layout.key(key)] = parse_parameter(layout, key, raw, place("parameters", key))
    effects = (
        *base.effects,
        *(_parse_effect(layout, raw, number, place) for number, raw in enumerate(file.effects)),
    )
    seen = [effect.id for effect in effects]
    for number, effect_id in enumerate(seen):
        if effect_id in seen[:number]:
            raise InputError(
                f"effect '{effect_id}' is declared twice",
                where=place("effects", number - len(base.effects)),
            )
    model = replace(base, parameters=parameters, calibrate=(), effects=effects)
    known = own | {
        f"{item.id}.{parameter.name}": parameter
        for item in effects
        for parameter in layout.effect(item.id).parameters
    }
    calibrate, within = [*base.calibrate], {**base.within}
    if "calibrate" in file.model_fields_set:
        calibrate, within = [], {}
    for number, entry in enumerate(file.calibrate):
        where = place("calibrate", number)
        key, tolerance = (entry, None) if isinstance(entry, str) else (
            entry.parameter, entry.within
        )  # fmt: skip
        parameter = _calibrated_parameter(layout, known, key, where)
        key = layout.key(key)
        if key in calibrate:
            raise InputError(
                f"'{key}' is under calibrate twice", where=where, hint="keep one of the two entries"
            )
        calibrate.append(key)
        if tolerance is not None:
            value = float(model.vector()[layout.index[key]])
            within[key] = _tolerance(parameter, value, tolerance, where)
    for number, key in enumerate(file.per_run):
        where = place("per_run", number)
        _calibrated_parameter(layout, known, key, where)
        if layout.key(key) in calibrate:
            raise InputError(
                f"'{key}' is under calibrate as well",
                where=where,
                hint="one value for all runs (calibrate), or one for each (per_run)",
            )
    per_run = tuple(dict.fromkeys(layout.key(key) for key in file.per_run))
    if "per_run" not in file.model_fields_set:
        per_run = tuple(key for key in base.per_run if key not in calibrate)
    _refuse_weightless(model, file, place)
    below = dict.fromkeys((*base.held, *base.calibrate, *base.per_run))
    held = tuple(key for key in below if key not in (*calibrate, *per_run))
    return replace(model, calibrate=tuple(calibrate), within=within, per_run=per_run, held=held)


def _refuse_weightless(model: Model, file: ModelFile, place: Callable[..., Place]) -> None:
    """Refuse inertias that are declared as nothing: what they move would accelerate without end.

    Raises:
        InputError: one is, with the line that says so.
    """
    found = model.plant.weightless(model.vector())
    if found is None:
        return
    node, keys = found
    given = [key for key in file.parameters if model.plant.layout.key(key) in keys]
    own = [
        (group, name, value)
        for name, _, value in (key.rpartition(".") for key in keys)
        for group, items in (("nodes", file.nodes), ("elements", file.elements))
        if isinstance(entry := (items or {}).get(name), dict) and value in entry
    ]
    if given:
        where = place("parameters", given[0])
    elif own:
        where = place(*own[0])
    else:
        where = place("nodes", node) if file.plant else place("model")
    raise InputError(
        f"the whole inertia of '{node}' is 0 ({', '.join(keys)}): it would accelerate without end",
        where=where,
        hint="give it more than 0; where a channel shows its motion the key may be left out",
    )


def _base(file: ModelFile, content: Any, name: str, place: Callable[..., Place]) -> Model:
    """Return the plant that a model file stands on: its own network, a file's, or a registered one.

    Raises:
        InputError: there is no such plant, or no such file.
    """
    from eha_bench.core import yaml_file

    if file.plant:
        plant = plant_of(content, place)
        return Model(plant.id, network=plant.network.source)
    if file.model.endswith((".yaml", ".yml")):
        below = yaml_file.named_file(Path(name).parent, file.model, place("model"))
        _refuse_circle(Path(name), below, place("model"))
        return load_model(below)
    try:
        get_plant(file.model)
    except PluginError as error:
        raise InputError(error.what, where=place("model"), hint=error.hint) from error
    return Model(file.model)


def _refuse_circle(above: Path, below: Path, where: Place) -> None:
    """Refuse models that stand on one another in a circle.

    Raises:
        InputError: they do, with their names.
    """
    from eha_bench.core import yaml_file

    chain, path = [above.resolve()], below
    while path.resolve() not in chain:
        chain.append(path.resolve())
        content = yaml_file.peek(path)
        model = content.get("model") if isinstance(content, Mapping) else None
        if not (isinstance(model, str) and model.endswith((".yaml", ".yml"))):
            return
        path = path.parent / model
        if not path.is_file():
            return  # said when it is loaded
    names = ", ".join(item.name for item in chain[chain.index(path.resolve()) :])
    raise InputError(
        f"models stand on one another in a circle: {names}",
        where=where,
        hint="one of them names a plant",
    )


def parse_parameter(layout: Layout, key: str, raw: Any, where: Place) -> float:
    """Return a plant's parameter in SI, checked for unit and bounds; `where` is its key.

    Raises:
        InputError: unknown parameter, wrong unit, or outside its bounds.
    """
    own = {parameter.name: parameter for parameter in layout.parameters}
    own |= {other: own[name] for other, name in layout.synonyms.items()}
    return float(checked_value(_known_parameter(own, key, where), raw, where))


def _calibrated_parameter(
    layout: Layout, known: Mapping[str, Parameter], key: str, where: Place
) -> Parameter:
    """Return the parameter of a key under `calibrate` or `per_run`."""
    effect = key.partition(".")[0]
    key = layout.key(key)
    if key not in known and key in layout.by_key:
        raise InputError(
            f"'{key}' is of an effect that is not declared",
            where=where,
            hint=f"declare {effect} under effects",
        )
    parameter = _known_parameter(known, key, where)
    if parameter.choices:
        raise InputError(f"'{key}' is a choice of words, which no fit can estimate", where=where)
    return parameter


def _tolerance(parameter: Parameter, value: float, raw: float | str, where: Place) -> float:
    """Return what a value may be off by, SI, from a share of it in percent or an amount."""
    from eha_bench.core import units

    share = str(raw).strip()
    try:
        if share.endswith("%"):
            amount = 0.01 * units.parse(share[:-1], "") * abs(value)
        else:
            amount = abs(units.parse_difference(raw, parameter.unit))
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if not amount > 0.0:
        raise InputError(
            f"within: {raw} of {value:g} leaves no room",
            where=where,
            hint=f"give an amount in {parameter.unit or 'its unit'} that is more than nothing",
        )
    if amount < _LEAST_WITHIN * abs(value):
        raise InputError(
            f"within: {raw} is only {100.0 * amount / abs(value):.2g} % of {value:g}",
            where=where,
            hint="give it with its unit or in percent, or leave the parameter out of `calibrate`",
        )
    return amount


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
    values: dict[str, Any] = {}
    if AT in raw:
        word = effect.word(str(raw[AT]))
        if word is None:
            raise InputError(
                f"'{effect.id}' cannot act at '{raw[AT]}'",
                where=place("effects", number, AT),
                hint=f"it may act at: {', '.join(effect.places)}",
            )
        if len(effect.places) > 1:
            values[AT] = word
    elif len(effect.places) > 1 and EVERYWHERE not in effect.places:
        raise InputError(
            f"'{effect.id}' does not say where it acts",
            where=place("effects", number, "effect"),
            hint=f"add `at:` with one of {', '.join(effect.places)}",
        )
    for key, value in raw.items():
        if key in {"effect", AT}:
            continue
        where = place("effects", number, key)
        _known_parameter(own, key, where)
        parameter = effect.parameter_at(key, values)
        values[key] = checked_value(parameter, value, where, effect.words(parameter))
    return DeclaredEffect(effect.id, values)


def _known_parameter(own: Mapping[str, Parameter], key: str, where: Place) -> Parameter:
    if key not in own:
        raise InputError(f"unknown parameter '{key}'", where=where, hint=suggest(key, own))
    return own[key]


def checked_value(
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
        return [float(checked_value(replace(parameter, size=1), item, where)) for item in raw]
    from eha_bench.core import units

    try:
        value = units.parse(raw, parameter.unit)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if refusal := parameter.refusal(value, parameter.unit):
        raise InputError(refusal, where=where)
    return value


def _plain(value: Value) -> Value:
    """Return a value of Python's own types, whatever numpy's it was computed as."""
    if isinstance(value, str):
        return str(value)
    return [float(item) for item in value] if isinstance(value, list) else float(value)


def _encoded(parameter: Parameter, value: Value) -> float | list[float]:
    return value if isinstance(value, list) else parameter.encode(value)
