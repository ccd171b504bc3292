"""What every signal of a suite is built on: a mapping of a YAML file that is itself a `Signal`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    Discriminator,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    ValidationInfo,
)
from pydantic_core import CoreSchema, core_schema

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import UnitError
from eha_bench.core.signal import Signal
from eha_bench.core.units import Unit, base_unit, parse, unit_in
from eha_bench.core.yaml_file import StrictModel

TICK = 1e-9
"""A time this close (s) before an edge counts as on it: sums of periods are not exact in binary."""


class SignalModel(StrictModel, Signal):
    """Base of the signals: a `kind` that names its entry point, and quantities in SI.

    Levels and amplitudes are typed `Level`: they take the unit of the trial's control mode. A field
    `duration` is declared as `span: Seconds = Field(alias="duration")`, next to the property.
    """

    kind: str


@dataclass(frozen=True)
class SignalContext:
    """What the trial around a signal says while its YAML is read (pydantic's `context`).

    Attributes:
        mode: the control mode, for messages.
        unit: SI unit of its reference; None for that of the first quantity that names one.
        folder: where relative file names start; None where no file may be read.
        named: the SI unit that a quantity has named, where `unit` is None.
    """

    mode: str = ""
    unit: str | None = ""
    folder: Path | None = None
    named: list[str] = field(default_factory=list)

    def unit_for(self, written: str) -> str:
        """Return the SI unit of a quantity that is written in a unit, or without any ("").

        Raises:
            UnitError: the unit is unknown.
        """
        if self.unit is not None:
            return self.unit
        if written and not self.named:
            self.named.append(base_unit(written))
        return self.named[0] if self.named else ""

    @staticmethod
    def of(info: ValidationInfo[Any]) -> SignalContext:
        """Return the context of a validation, or an empty one."""
        return info.context if isinstance(info.context, SignalContext) else SignalContext()


@dataclass(frozen=True)
class ModeUnit:
    """Marks a field as a quantity of the trial's control mode, in the unit of its channel."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Accept a number in SI, or text with a unit of the control mode's dimension."""

        def convert(value: Any, info: ValidationInfo[Any]) -> float:
            context = SignalContext.of(info)
            if isinstance(value, bool) or not isinstance(value, (str, int, float)):
                raise ValueError(f"expected a number or text such as '1 {context.unit_for('')}'")
            try:
                return parse(value, context.unit_for(unit_in(value)))
            except UnitError as error:
                because = f", because the trial controls {context.mode}" if context.mode else ""
                raise ValueError(f"{error}{because}") from error

        return core_schema.with_info_before_validator_function(convert, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Editors see: a number in SI, or text with a unit."""
        described = "a number in the SI unit of the control mode, or text with a unit"
        return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": described}


def _positive(value: float) -> float:
    if value <= 0:
        raise ValueError(f"{value:g} is not greater than 0")
    return value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError(f"{value:g} is negative")
    return value


Level = Annotated[float, ModeUnit()]
"""A level or amplitude, in the unit of the control mode."""

Seconds = Annotated[float, Unit("s"), AfterValidator(_positive)]
"""A length of time greater than 0."""

Moment = Annotated[float, Unit("s"), AfterValidator(_not_negative)]
"""A moment, or a length of time that may be 0."""

Hertz = Annotated[float, Unit("Hz"), AfterValidator(_positive)]
"""A frequency greater than 0."""

Angle = Annotated[float, Unit("rad")]
"""A phase in rad."""


def _count(value: object) -> str:
    return "each" if isinstance(value, (list, tuple)) else "one"


OneOrEachLevel = Annotated[
    Annotated[Level, Tag("one")] | Annotated[tuple[Level, ...], Tag("each")], Discriminator(_count)
]
"""One level for all, or a list with one for each."""

OneOrEachTime = Annotated[
    Annotated[Seconds, Tag("one")] | Annotated[tuple[Seconds, ...], Tag("each")],
    Discriminator(_count),
]
"""One length of time for all, or a list with one for each."""


def within(time: FloatArray, start: float, stop: float) -> FloatArray:
    """Return `time` (s) clipped to [start, stop], so that values are held outside, (n,) -> (n,)."""
    import numpy as np

    return np.clip(np.asarray(time, dtype=np.float64), start, stop)
