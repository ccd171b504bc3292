"""The `matrix` of a trial: each combination of its parameters becomes a trial."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

from eha_bench.core.errors import InputError, Place
from eha_bench.core.located import Located
from eha_bench.core.near_miss import suggest
from eha_bench.suites.identifiers import label

MOST_TRIALS = 10_000
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_REFERENCE = re.compile(r"\$\{([^{}]*)\}")


@dataclass(frozen=True)
class FactorLevel:
    """One value of one parameter, and what goes with it.

    Attributes:
        label: how the value stands in the trial's id.
        values: what `${name}` is replaced by, by name. places: where each was written.
    """

    label: str
    values: Mapping[str, Any]
    places: Mapping[str, Place]


def expand(trial: Located) -> Iterator[tuple[object, Located]]:
    """Yield (id as written, trial) for every combination, in the order in which they are written.

    Raises:
        InputError: a parameter that is not well formed, or a `${name}` that the matrix lacks.
    """
    matrix = trial.at("matrix").mapping("named parameters")
    parameters = [_cases(name, values) for name, values in matrix.items()]
    _check_names(parameters, matrix)
    count = 1
    for cases in parameters:
        count *= len(cases)
    if count > MOST_TRIALS:
        raise matrix.error(f"{count} trials are more than {MOST_TRIALS}")
    body = trial.without("matrix")
    pattern = body.value.get("id")
    marked = body.holding("${")
    whole = {keys: name.strip() for keys, name in marked.whole(_REFERENCE).items()}
    for combination in product(*parameters):
        values = {name: value for case in combination for name, value in case.values.items()}
        written = {name: place for case in combination for name, place in case.places.items()}
        # what is wrong with a value is wrong where it stands: in the matrix
        expanded = marked.mapped(partial(with_values, values=values)).placed(
            {keys: written[name] for keys, name in whole.items()}
        )
        yield _identifier(pattern, combination, body.place(("id",))), expanded


def _identifier(pattern: object, combination: tuple[FactorLevel, ...], place: Place) -> object:
    if not isinstance(pattern, str):
        return pattern  # whoever checks the id says what is wrong with it
    if _REFERENCE.search(pattern):
        values = {name: value for case in combination for name, value in case.values.items()}
        labels = {name: label(value) for name, value in values.items()}
        return str(with_values(pattern, place, labels))
    return "-".join([pattern, *(case.label for case in combination)])


def _cases(name: str, values: Located) -> list[FactorLevel]:
    if not _NAME.fullmatch(name):
        raise values.error(
            f"'{name}' is not a name for a parameter", hint="use letters, digits and '_'"
        )
    if isinstance(values.value, list):
        entries = [(item, replace(values.at(i), value={})) for i, item in enumerate(values.value)]
    elif isinstance(values.value, dict):
        entries = [(key, further.mapping("further parameters")) for key, further in values.items()]
    else:
        raise values.error(
            f"parameter '{name}' has no list of values",
            hint="write [15 MPa, 20 MPa], or '15 MPa: {limit: 41 ms}' lines",
        )
    if not entries:
        raise values.error(f"parameter '{name}' has no values")
    return [_case(name, value, further) for value, further in entries]


def _case(name: str, value: Any, further: Located) -> FactorLevel:
    if isinstance(value, (dict, list)) or value is None or not label(value):
        raise further.error(f"a value of parameter '{name}' is not a number or text")
    for other in further.value:
        if not _NAME.fullmatch(other):
            raise further.at(other).error(
                f"'{other}' is not a name for a parameter", hint="use letters, digits and '_'"
            )
    places = {name: further.place(), **{key: further.place((key,)) for key in further.value}}
    return FactorLevel(label(value), {name: value, **further.value}, places)


def _check_names(parameters: list[list[FactorLevel]], matrix: Located) -> None:
    owner: dict[str, str] = {}
    for own, cases in zip(matrix.value, parameters, strict=True):
        everywhere = set(cases[0].values)
        for case in cases:
            missing = everywhere ^ set(case.values)
            if missing:
                raise matrix.at(own).error(
                    f"'{min(missing)}' does not go with every value of parameter '{own}'",
                    hint="give it with each, null where it does not apply",
                )
        for name in everywhere:
            if name in owner or (name != own and name in matrix.value):
                raise matrix.at(own).error(f"parameter '{name}' is given twice")
            owner[name] = own


def with_values(value: Any, place: Place, values: Mapping[str, Any]) -> Any:
    """Return text with each `${name}` replaced; text that is nothing else becomes the value itself.

    Raises:
        InputError: no parameter has that name.
    """
    if not isinstance(value, str) or "${" not in value:
        return value

    def look_up(match: re.Match[str]) -> Any:
        name = match[1].strip()
        if name not in values:
            hint = suggest(name, values) if values else "the trial has no matrix"
            raise InputError(f"unknown parameter '{name}' in '{value}'", where=place, hint=hint)
        return values[name]

    whole = _REFERENCE.fullmatch(value.strip())
    if whole:
        return look_up(whole)
    text = _REFERENCE.sub(lambda match: str(look_up(match)), value)
    if "${" in text:
        raise InputError(f"'{value}' is not closed", where=place, hint="write ${name}")
    return text
