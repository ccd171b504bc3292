"""Channels that are computed from others: `voltage: {expression: duty * supply_voltage, unit: V}`.

An expression works on values in SI, and gives one in SI.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.expression import Expression
from eha_bench.core.near_miss import suggest
from eha_bench.core.recording import RESAMPLED, Recording
from eha_bench.core.units import base_unit, factor_and_offset
from eha_bench.core.yaml_file import ErrorAt, StrictModel


def arithmetic(text: str) -> str:
    """Return an expression that is one (a validator of pydantic).

    Raises:
        ValueError: as `Expression.parse`.
    """
    Expression.parse(text)
    return text


class ComputedChannel(StrictModel):
    """A channel that is computed from others of the same recording, all in SI."""

    expression: Annotated[
        str,
        AfterValidator(arithmetic),
        Field(description="arithmetic between channels in SI: duty * supply_voltage"),
    ]
    unit: str | None = Field(default=None, description="its SI unit; '' for a pure number")

    @model_validator(mode="after")
    def _in_si(self) -> ComputedChannel:
        if self.unit is not None:
            check_si(self.unit)
        return self


def check_si(unit: str) -> None:
    """Refuse a unit that is not SI: what is computed from SI values is SI.

    Raises:
        ErrorAt: at `unit`.
    """
    try:
        si_unit = base_unit(unit)
        factor = factor_and_offset(unit, si_unit)
    except UnitError as error:
        raise ErrorAt(str(error), "unit") from error
    if factor != (1.0, 0.0):
        raise ErrorAt(
            f"an expression is worked out in SI, so its unit is '{si_unit}' and not '{unit}'",
            "unit",
        )


def check_known(name: str, unit: str | None) -> None:
    """Refuse a unit that a known channel of this name has not, and an unknown one without.

    Raises:
        ErrorAt: at `unit`.
    """
    known = CHANNELS[name].unit if name in CHANNELS else ""
    if unit is None:
        if not known:
            raise ErrorAt(f"'{name}' needs a unit ('' for none)", "unit")
    elif known and base_unit(unit) != known:
        raise ErrorAt(f"'{name}' is in {known}, not in '{unit}'", "unit")


def with_computed(
    recording: Recording, channels: Mapping[str, ComputedChannel], where: Place
) -> Recording:
    """Return a recording with channels computed from its own and from each other.

    Args:
        recording: SI. channels: by name. where: the key that holds them, for messages.

    Raises:
        InputError: an expression needs a channel that is not there, or itself.
    """
    values = {name: recording[name] for name in recording}
    units = dict(recording.units)
    notes: list[str] = []
    resampled = set(recording.resampled)
    for name in in_order(channels, where):
        entry = channels[name]
        expression = Expression.parse(entry.expression)
        for needed in expression.names:
            if needed not in values:
                raise InputError(
                    f"'{name}' is computed from '{needed}', which is not in {recording.source}",
                    where=where,
                    hint=suggest(needed, values),
                )
        found = np.broadcast_to(expression.value(values), recording.time.shape)
        values[name] = np.array(found)
        units[name] = _unit(name, entry)
        resampled |= {name} if resampled & {*expression.names} else set()
        lost = ~np.isfinite(found)
        for needed in expression.names:
            lost &= np.isfinite(values[needed])
        if lost.any():
            notes.append(
                f"'{name}' = {entry.expression} is not finite in {int(lost.sum())} samples"
            )
    derived = {"pressure_difference"} - recording.values.keys() - channels.keys()
    kept = {name: value for name, value in values.items() if name not in derived}
    metadata = dict(recording.metadata)
    if resampled:
        metadata[RESAMPLED] = json.dumps(sorted(resampled), ensure_ascii=False)
    notes = [*recording.notes, *notes]
    return replace(recording, values=kept, units=units, metadata=metadata, notes=tuple(notes))


def in_order(channels: Mapping[str, ComputedChannel], where: Place) -> list[str]:
    """Return names so that what another one needs comes before it.

    Raises:
        InputError: a channel needs itself.
    """
    done: list[str] = []
    open_: list[str] = []

    def visit(name: str) -> None:
        if name in open_:
            raise InputError(
                f"'{name}' is computed from itself: {' <- '.join([*open_, name])}", where=where
            )
        if name in done:
            return
        open_.append(name)
        for needed in Expression.parse(channels[name].expression).names:
            if needed in channels:
                visit(needed)
        open_.pop()
        done.append(name)

    for name in channels:
        visit(name)
    return done


def _unit(name: str, entry: ComputedChannel) -> str:
    known = CHANNELS[name].unit if name in CHANNELS else ""
    return known or base_unit(entry.unit or "")
