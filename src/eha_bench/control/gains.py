"""Gains by name: `pressure.k_p`, `joint_angle.speed.k_i`, of any controller, also a user's own.

The first word is the control mode, the others lead through the controller's `Gains`. A value is
read and checked by that model, so that units and bounds are those of a controller.yaml.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from eha_bench.control.controller_file import ControllerSet, ControllerSpec
from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.near_miss import suggest
from eha_bench.core.units import Unit, base_unit, parse, unit_in
from eha_bench.core.yaml_file import StrictModel


def gains_of(controllers: ControllerSet) -> dict[str, float]:
    """Return every gain that is a number, SI, by its name."""
    return {
        f"{mode}.{name}": value
        for mode, spec in controllers.by_mode.items()
        for name, value in _numbers(spec.gains, "")
    }


def _numbers(gains: StrictModel, prefix: str) -> Iterator[tuple[str, float]]:
    for name in type(gains).model_fields:
        value = getattr(gains, name)
        if isinstance(value, StrictModel):
            yield from _numbers(value, f"{prefix}{name}.")
        elif (number := _in_si(value)) is not None:
            yield f"{prefix}{name}", number


def _in_si(value: object) -> float | None:
    """Return a number, or a quantity whose unit its controller judges (`700 V/m`), in SI."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str) and (unit := _own_unit(value)):
        return parse(value, unit)
    return None


def _own_unit(value: object) -> str:
    """Return the SI unit of a quantity that is written with one; "" of anything else."""
    if not isinstance(value, str):
        return ""
    try:
        unit = base_unit(unit_in(value))
        parse(value, unit)
    except UnitError:
        return ""
    return unit


def unit_of_gain(controllers: ControllerSet, key: str, where: Place) -> str:
    """Return the SI unit of a gain; "" for a pure number, or where nothing says one.

    Raises:
        InputError: no controller has such a gain.
    """
    mode, path = _mode_and_keys(controllers, key, where)
    gains: Any = controllers.by_mode[mode].gains
    for name in path[:-1]:
        gains = getattr(gains, name)
    field = type(gains).model_fields[path[-1]]
    declared = next((item.si for item in field.metadata if isinstance(item, Unit)), "")
    return declared or _own_unit(getattr(gains, path[-1]))


@dataclass(frozen=True)
class WrittenGain:
    """A gain as a file writes it.

    Attributes:
        value: SI. controllers: with the gain as it is written, its unit not yet judged by a trial.
    """

    value: float
    controllers: ControllerSet


def read_gain(controllers: ControllerSet, key: str, raw: float | str, where: Place) -> WrittenGain:
    """Return a gain as its controller takes it.

    Raises:
        InputError: no controller has such a gain, or none of this unit or size.
    """
    mode, path = _mode_and_keys(controllers, key, where)
    changed = _spec_with_values(controllers.by_mode[mode], {path: raw}, where)
    if (number := _in_si(_value(changed.gains, path))) is None:
        raise InputError(f"'{raw}' is not a number, with or without a unit", where=where)
    by_mode = {**controllers.by_mode, mode: changed}
    return WrittenGain(number, replace(controllers, by_mode=by_mode))


def with_gains(controllers: ControllerSet, gains: Mapping[str, float]) -> ControllerSet:
    """Return the same controllers with other gains, SI.

    Raises:
        InputError: a gain that no controller has, or that its controller does not take.
    """
    if not gains:
        return controllers
    by_mode: dict[str, dict[tuple[str, ...], float]] = {}
    content = copy.deepcopy(yaml_file.mapping_of(controllers.text, controllers.name))
    for key, value in gains.items():
        mode, path = _mode_and_keys(controllers, key, Place(file=controllers.name, key=key))
        by_mode.setdefault(mode, {})[path] = value
        block = content[mode]
        for name in path[:-1]:
            block = block.setdefault(name, {})
        block[path[-1]] = value
    changed = {
        mode: _spec_with_values(
            controllers.by_mode[mode], paths, Place(file=controllers.name, key=mode)
        )
        for mode, paths in by_mode.items()
    }
    return replace(
        controllers,
        by_mode={**controllers.by_mode, **changed},
        text=json.dumps(content, indent=1, ensure_ascii=False) + "\n",
    )


def _mode_and_keys(
    controllers: ControllerSet, key: str, where: Place
) -> tuple[str, tuple[str, ...]]:
    """Return the mode of a gain and what leads to it within the mode's gains."""
    # the name of a mode may hold dots itself
    for mode in sorted(controllers.by_mode, key=len, reverse=True):
        own = dict(_numbers(controllers.by_mode[mode].gains, ""))
        if key.startswith(f"{mode}.") and key[len(mode) + 1 :] in own:
            return mode, tuple(key[len(mode) + 1 :].split("."))
    raise InputError(
        f"no controller has a gain '{key}'",
        where=where,
        hint=suggest(key, gains_of(controllers)),
    )


def _value(gains: StrictModel, path: tuple[str, ...]) -> object:
    value: Any = gains
    for name in path:
        value = getattr(value, name)
    return value


def _spec_with_values(
    spec: ControllerSpec, values: Mapping[tuple[str, ...], float | str], where: Place
) -> ControllerSpec:
    """Return a controller with some of its gains replaced, read as its file would be."""
    content = spec.gains.model_dump(exclude_none=True)
    for path, raw in values.items():
        block = content
        for name in path[:-1]:
            block = block[name]
        block[path[-1]] = raw
    gains = yaml_file.validate(type(spec.gains), content, where.file, places=lambda _: where)
    return replace(spec, gains=gains)
