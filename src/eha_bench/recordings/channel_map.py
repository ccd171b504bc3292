"""`channels.yaml`: how a foreign log becomes channels in SI."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    field_validator,
    model_validator,
)

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.expression import Expression
from eha_bench.core.near_miss import likely, suggest
from eha_bench.core.sensor import Sensor
from eha_bench.core.units import Unit, base_unit, factor_and_offset
from eha_bench.core.yaml_file import (
    ErrorAt,
    Real,
    StrictModel,
    line_of,
    load,
    load_model,
    named_file,
)
from eha_bench.recordings.computed import (
    ComputedChannel,
    arithmetic,
    check_known,
    check_si,
    in_order,
)
from eha_bench.recordings.encodings.field_path import FieldPath


class Clock(StrEnum):
    """Which time stamps a sample."""

    LOG = "log"
    PUBLISH = "publish"
    HEADER = "header"


class Method(StrEnum):
    """How a channel is carried onto the common clock."""

    LINEAR = "linear"
    HOLD = "hold"


class Duplicates(StrEnum):
    """What to do with samples of one topic that carry the same stamp."""

    ERROR = "error"
    FIRST = "first"
    LAST = "last"


class StepsBack(StrEnum):
    """What to do where a topic's stamps step back in time."""

    ERROR = "error"
    SORT = "sort"
    DROP = "drop"


class Gaps(StrEnum):
    """What a channel holds on the common clock where its own topic has a gap."""

    NAN = "nan"
    INTERPOLATE = "interpolate"


class TimeRange(StrEnum):
    """Whether the recording ends where the first channel ends, or holds NaN from there on."""

    COMMON = "common"
    ALL = "all"


_MISSPELT = 0.8
"""So like a known name is one that was meant to be it; `spool_position` is like `piston_position`
by 0.76, and is another channel."""

HELD = frozenset({"reference", "current_command"})
"""Commands keep their value until the next one; measured states are interpolated."""


def _path(text: str) -> str:
    FieldPath.parse(text)
    return text


class ChannelEntry(StrictModel):
    """Where one channel comes from: value = (raw * scale + offset) in `unit`, then SI.

    Or what it is computed from.
    """

    topic: str | None = Field(default=None, min_length=1, description="topic of the message")
    field: Annotated[str, AfterValidator(_path)] | None = Field(
        default=None,
        description="field of the message: velocity[0], pose.position.z, velocity[motor]",
    )
    column: str | None = Field(
        default=None, min_length=1, description="column of a CSV, Parquet or MAT file"
    )
    expression: Annotated[str, AfterValidator(arithmetic)] | None = Field(
        default=None, description="arithmetic between other channels in SI: duty * supply_voltage"
    )
    unit: str | None = Field(default=None, description="unit of raw * scale + offset; default SI")
    scale: Real = 1.0
    offset: Real = 0.0
    resolution: Real | str | None = Field(
        default=None,
        description="smallest step of the sensor's reading: 1 bar",
    )
    uncertainty: Real | str | None = Field(
        default=None,
        description="standard uncertainty of the sensor's calibration: a quantity, or 0.2 % of "
        "the reading",
    )
    clock: Clock | None = Field(default=None, description="another clock for this channel's topic")
    method: Method | None = Field(
        default=None, description="how it is carried onto the common clock"
    )
    unwrap: Annotated[int, Field(ge=2, le=63)] | None = Field(
        default=None, description="repair a raw integer of so many bits that wrapped around"
    )

    @model_validator(mode="after")
    def _one_place(self) -> ChannelEntry:
        if self.expression is not None:
            return self._alone()
        if self.column is not None and (self.topic is not None or self.field is not None):
            raise ValueError("give either topic and field, or column, not both")
        if self.column is None and (self.topic is None or self.field is None):
            raise ValueError(
                "a topic and a field are needed, a column for a table, or an expression"
            )
        return self

    @field_validator("scale")
    @classmethod
    def _tells_readings_apart(cls, scale: float) -> float:
        if scale == 0.0:
            raise ValueError("a scale of 0 makes all readings alike: give the sensor's, or none")
        return scale

    def _alone(self) -> ChannelEntry:
        for key in self.model_fields_set - {"expression", "unit"}:
            raise ErrorAt(f"a computed channel has an expression and a unit, and no '{key}'", key)
        check_si(self.unit or "")
        return self


class TimeColumn(StrictModel):
    """The column of a table that holds the time."""

    column: str = Field(min_length=1)
    unit: str = "s"

    @field_validator("unit")
    @classmethod
    def _of_time(cls, unit: str) -> str:
        _check_unit(unit, "s")
        return unit


class Repair(StrictModel):
    """What may be repaired; by default nothing."""

    duplicates: Duplicates = Duplicates.ERROR
    steps_back: StepsBack = StepsBack.ERROR
    gaps: Gaps = Gaps.NAN


def _as_list(value: object) -> object:
    return [value] if isinstance(value, str) else value


class ChannelMapFile(StrictModel):
    """A `channels.yaml`: where every channel of a log comes from."""

    clock: Clock = Clock.LOG
    base: str | None = Field(default=None, description="channel whose topic gives the common clock")
    range: TimeRange = TimeRange.COMMON
    time: TimeColumn | None = None
    sample_rate: Annotated[float, Unit("Hz")] | None = Field(
        default=None, description="of a table without a time column"
    )
    repair: Repair = Repair()
    dbc: Annotated[tuple[str, ...], BeforeValidator(_as_list)] = Field(
        default=(), description="DBC that decodes the CAN frames of an MDF, or a list of them"
    )
    channels: dict[str, ChannelEntry] = Field(json_schema_extra={"minProperties": 1})

    _of_plant: frozenset[str] = PrivateAttr(default=frozenset())

    @field_validator("sample_rate")
    @classmethod
    def _positive(cls, rate: float | None) -> float | None:
        if rate is not None and not 0 < rate <= 1e9:
            raise ValueError(
                f"the sample rate must be positive, and at most 1 GHz: {rate:g} Hz is not "
                "(stamps are whole nanoseconds)"
            )
        return rate

    @field_validator("channels")
    @classmethod
    def _units(cls, channels: dict[str, ChannelEntry]) -> dict[str, ChannelEntry]:
        if not channels:
            raise ValueError("there is no channel: map at least one")
        for name, entry in channels.items():
            if name == "time" or not name.isprintable() or not name.strip():
                raise ErrorAt(f"'{name}' cannot be the name of a channel", name)
            if entry.expression is not None:
                try:
                    check_known(name, entry.unit)
                except ErrorAt as error:
                    raise ErrorAt(f"channel '{name}': {error}", name, *error.keys) from error
                continue
            try:
                _check_channel_unit(name, entry)
            except ValueError as error:
                raise ErrorAt(f"channel '{name}': {error}", name, "unit") from error
        return channels

    @model_validator(mode="after")
    def _consistent(self) -> ChannelMapFile:
        if self.time is not None and self.sample_rate is not None:
            raise ErrorAt("give either time or sample_rate, not both", "sample_rate")
        self._check_expressions()
        for name, entry in self.channels.items():
            for key in ("resolution", "uncertainty"):
                given = {"resolution": None, "uncertainty": None, key: getattr(entry, key)}
                try:
                    Sensor.parse(**given, si_unit=self.si_unit(name))
                except UnitError as error:
                    what = f"channel '{name}': {error}"
                    raise ErrorAt(what, "channels", name, key) from error
        if self.base is None:
            return self
        if self.base not in self.channels:
            hint = suggest(self.base, self.channels)
            raise ErrorAt(f"'{self.base}' is not one of the channels; {hint}", "base")
        topics = self.of_kind(tables=False)
        if topics and self.base not in topics:
            raise ErrorAt(
                f"'{self.base}' is a column, and the common clock is that of a topic; "
                f"{suggest(self.base, topics)}",
                "base",
            )
        return self

    def _check_expressions(self) -> None:
        known = {*self.channels}
        if {"pressure_a", "pressure_b"} <= known:
            known.add("pressure_difference")
        for name, entry in self.computed.items():
            for needed in Expression.parse(entry.expression).names:
                if needed not in known:
                    hint = suggest(needed, known - {name})
                    what = f"channel '{name}' is computed from '{needed}', which is not mapped"
                    raise ErrorAt(f"{what}; {hint}", "channels", name, "expression")
        try:
            in_order(self.computed, Place())
        except InputError as error:
            raise ErrorAt(error.what, "channels") from error

    @property
    def computed(self) -> dict[str, ComputedChannel]:
        """Channels that are computed from others, by name."""
        return {
            name: ComputedChannel(expression=entry.expression, unit=entry.unit)
            for name, entry in self.channels.items()
            if entry.expression is not None
        }

    @property
    def read(self) -> ChannelMapFile:
        """The map of what is read from the log, without what is computed from it."""
        own = {n: entry for n, entry in self.channels.items() if entry.expression is None}
        return self if len(own) == len(self.channels) else self.model_copy(update={"channels": own})

    def of_kind(self, *, tables: bool) -> dict[str, ChannelEntry]:
        """Return the channels that a table holds, or those that a log of topics holds."""
        return {
            name: entry
            for name, entry in self.channels.items()
            if entry.expression is None and (entry.column is not None) is tables
        }

    def part(self, *, tables: bool) -> ChannelMapFile:
        """Return the map with the channels `of_kind` only; a table has one clock and no base."""
        channels = self.of_kind(tables=tables)
        return self.model_copy(update={"channels": channels, "base": None if tables else self.base})

    def knowing(self, names: Collection[str]) -> ChannelMapFile:
        """Return the map for a plant that gives or takes channels of some names."""
        found = self.model_copy()
        found._of_plant = frozenset(names)
        return found

    def strangers(self) -> list[str]:
        """Say which channels may be meant to be called otherwise."""
        free = [name for name in CHANNELS if name not in self.channels]
        notes = []
        for name in self.channels:
            known = name in CHANNELS or name in self._of_plant
            hint = "" if known else likely(name, free, likeness=_MISSPELT)
            if hint:
                notes.append(f"channel '{name}' is not one that eha-bench knows; {hint}")
        return notes

    def sensor(self, name: str) -> Sensor:
        """How good a channel's sensor is, as far as the map says."""
        entry = self.channels[name]
        return Sensor.parse(entry.resolution, entry.uncertainty, self.si_unit(name))

    def method(self, name: str) -> Method:
        """How a channel is carried onto the common clock."""
        return self.channels[name].method or (Method.HOLD if name in HELD else Method.LINEAR)

    def si_unit(self, name: str) -> str:
        """SI unit of a channel's values."""
        known = CHANNELS[name].unit if name in CHANNELS else ""
        return known or base_unit(self.channels[name].unit or "")

    def to_si(self, name: str) -> tuple[float, float]:
        """Return (factor, offset) from a channel's unit to SI."""
        unit = self.channels[name].unit
        return (1.0, 0.0) if unit is None else factor_and_offset(unit, self.si_unit(name))


ChannelMap = ChannelMapFile


def _check_unit(unit: str, si_unit: str) -> tuple[float, float]:
    try:
        return factor_and_offset(unit, si_unit)
    except UnitError as error:
        raise ValueError(str(error)) from error


def _check_channel_unit(name: str, entry: ChannelEntry) -> None:
    known = CHANNELS.get(name)
    if entry.unit is None:
        if known is None:
            raise ValueError(
                "a channel that eha-bench does not know needs a unit ('' for none); "
                f"{suggest(name, CHANNELS)}"
            )
        if not known.unit:
            raise ValueError(f"'{name}' needs a unit, since it has that of the control mode")
        return
    if known is not None and known.unit:
        if known.unit == "rad/s" and entry.unit.strip().lower() in {"hz", "khz", "hertz"}:
            raise ValueError(
                f"unit '{entry.unit}' is ambiguous for a speed; write rev/s, rpm or rad/s"
            )
        _check_unit(entry.unit, known.unit)
        return
    try:
        base_unit(entry.unit)
    except UnitError as error:
        raise ValueError(str(error)) from error


def load_channel_map(channels: str | Path | ChannelMap | Mapping[str, object]) -> ChannelMap:
    """Return a channel map from a file, a mapping as in the file, or as it is.

    Raises:
        InputError: the file is missing or not a channel map.
    """
    if isinstance(channels, ChannelMapFile):
        return channels
    if isinstance(channels, Mapping):
        from eha_bench.core.yaml_file import validate

        return validate(ChannelMapFile, dict(channels), "channels")
    path = Path(channels)
    mapping = load_model(ChannelMapFile, path, "channels")
    if not mapping.dbc:
        return mapping
    where = Place(file=str(path), line=line_of(load(path), ["dbc"]), key="dbc")
    files = tuple(str(named_file(path.parent, name, where)) for name in mapping.dbc)
    return mapping.model_copy(update={"dbc": files})
