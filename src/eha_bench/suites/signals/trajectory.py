"""A recorded or planned trajectory, from a CSV file in the suite's folder."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import UnitError
from eha_bench.core.units import factor_and_offset
from eha_bench.core.yaml_file import StrictModel
from eha_bench.suites.signals.signal_model import Moment, SignalContext, SignalModel
from eha_bench.suites.signals.table import Column, inside, read_columns

Finite = Annotated[float, Field(allow_inf_nan=False)]


class TrajectorySamples(StrictModel):
    """The trajectory itself, so that a recording can be re-scored without the file.

    Attributes:
        time: (n,) s from the trajectory's start, increasing.
        value: (n,) in the SI unit of the control mode.
    """

    time: Annotated[tuple[Finite, ...], Field(min_length=2)]
    value: Annotated[tuple[Finite, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _increases(self) -> TrajectorySamples:
        if len(self.time) != len(self.value):
            raise ValueError(f"{len(self.time)} times for {len(self.value)} values")
        if any(np.diff(self.time) <= 0):
            raise ValueError("time does not increase")
        return self


class Trajectory(SignalModel):
    """Straight lines between the rows of a CSV file, the first row at the time `at`.

    `file` is relative to the suite, and is in its folder or below; its first line names columns.
    """

    kind: Literal["trajectory"]
    at: Moment = 0.0
    samples: TrajectorySamples | None = Field(
        default=None, description="instead of a file's columns"
    )
    time: Column = Column(column="time", unit="s")
    value: Column | None = None
    file: str = ""

    @field_validator("time")
    @classmethod
    def _is_time(cls, column: Column) -> Column:
        return _checked(column, SignalContext(unit="s"))

    @field_validator("value")
    @classmethod
    def _is_of_the_mode(cls, column: Column | None, info: ValidationInfo[Any]) -> Column | None:
        context = SignalContext.of(info)
        return _checked(column, context) if column and context.mode else column

    @field_validator("file")
    @classmethod
    def _is_there(cls, file: str, info: ValidationInfo[Any]) -> str:
        folder = SignalContext.of(info).folder
        if file and folder is not None and not inside(folder, file).is_file():
            raise ValueError(f"there is no file '{file}' in the suite's folder")
        return file

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo[Any]) -> Trajectory:
        if self.samples is not None:
            return self
        context = SignalContext.of(info)
        if not self.file or self.value is None:
            raise ValueError("a trajectory needs 'file' and 'value', or 'samples'")
        if context.folder is None:
            raise ValueError(f"file '{self.file}' cannot be read here: give 'samples'")
        time, value = read_columns(
            inside(context.folder, self.file),
            self.time,
            self.value,
            context.unit_for(self.value.unit),
        )
        return self.model_copy(update={"samples": TrajectorySamples(time=time, value=value)})

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        assert self.samples is not None
        time = np.array(self.samples.time) - self.samples.time[0] + self.at
        return time, np.array(self.samples.value)

    @property
    def duration(self) -> float:
        """Time of the last row in s."""
        return float(self._table[0][-1])

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the reference at `time` in s, shape (n,) -> (n,)."""
        values: FloatArray = np.interp(time, *self._table)
        return values


def _checked(column: Column, context: SignalContext) -> Column:
    try:
        factor_and_offset(column.unit, context.unit_for(column.unit))
    except UnitError as error:
        raise ValueError(str(error)) from error
    return column
