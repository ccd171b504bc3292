"""What was measured: channels over one clock, wherever they came from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import MissingChannelError, Place, RecordingError
from eha_bench.core.lazy import later

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


RESAMPLED = "resampled"
"""Key of the metadata that lists what was resampled, as JSON."""

_NAMED = 12
"""Channels that are named in one line."""

_html = later("eha_bench.report.notebook", "recording_html")
_plot = later("eha_bench.report.plot", "plot_recording")


def _is_frozen(array: Any) -> bool:
    """Whether no code can write to an array, nor to the arrays that it is a view of."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None


def _frozen(array: Any) -> FloatArray:
    if isinstance(array, np.ndarray) and array.dtype == np.float64 and _is_frozen(array):
        return array  # a long recording needs no second copy
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


@dataclass(frozen=True)
class Recording:
    """Channels sampled on one clock; does not know whether a simulator or a rig made it.

    Attributes:
        time: (n,) seconds since `epoch_ns`, strictly increasing.
        values: channel name -> (n,) float64 in SI, read-only; NaN where nothing was measured.
        units: channel name -> SI unit.
        epoch_ns: time zero, nanoseconds since 1970 (0 if unknown).
        metadata: text by key (trial, seed, versions ...).
        attachments: files carried inside the recording, by name (suite, model, controller).
        notes: what the reader did or found (resampling, gaps, a torn end), one sentence each.
        source: the file it came from, for messages.
        damaged: names of attachments that the file holds, but damaged; they are left out.
        origin: where that file is, from the root, as a program may change its folder later.
    """

    time: FloatArray
    values: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    epoch_ns: int = 0
    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    source: str = ""
    damaged: tuple[str, ...] = ()
    origin: str = ""

    def __post_init__(self) -> None:
        """Freeze the arrays and check that they share one increasing clock."""
        where = Place(file=self.source)
        time = _frozen(self.time)
        if time.ndim != 1:
            raise RecordingError("time is not a one-dimensional array", where=where)
        increases = time[1:] > time[:-1]
        if not (increases.all() and np.isfinite(time[:1]).all() and np.isfinite(time[-1:]).all()):
            if not np.isfinite(time).all():
                raise RecordingError("time holds a value that is not finite", where=where)
            index = int(np.argmin(increases))
            raise RecordingError(
                "time does not increase", where=where._replace(time=float(time[index]))
            )
        values = {name: _frozen(array) for name, array in self.values.items()}
        for name, array in values.items():
            if array.shape != time.shape:
                raise RecordingError(
                    f"channel '{name}' has {array.size} samples where time has {time.size}",
                    where=where,
                )
        units = {name: self.units.get(name, unit_of(name)) for name in values}
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", MappingProxyType(values))
        object.__setattr__(self, "units", MappingProxyType(units))
        object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))
        object.__setattr__(self, "attachments", MappingProxyType(dict(self.attachments)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes: a read-only mapping cannot, a dict can."""
        content = {item.name: getattr(self, item.name) for item in fields(self)}
        plain = {k: dict(v) if isinstance(v, MappingProxyType) else v for k, v in content.items()}
        return _restored, (plain,)

    def __len__(self) -> int:
        """Number of samples."""
        return int(self.time.size)

    def __contains__(self, name: object) -> bool:
        """Whether the channel is there or can be derived."""
        return name in self.values or (
            name == "pressure_difference"
            and "pressure_a" in self.values
            and "pressure_b" in self.values
        )

    def __iter__(self) -> Iterator[str]:
        """Names of the channels, the derived pressure difference included."""
        yield from self.values
        if "pressure_difference" not in self.values and "pressure_difference" in self:
            yield "pressure_difference"

    def __getitem__(self, name: str) -> FloatArray:
        """Return a channel's values, shape (n,), SI.

        Raises:
            MissingChannelError: the channel is neither there nor derivable.
        """
        if name in self.values:
            return self.values[name]
        if name in self:
            difference = self.values["pressure_a"] - self.values["pressure_b"]
            difference.setflags(write=False)
            return difference
        raise MissingChannelError(name, where=Place(file=self.source), have=tuple(self.values))

    def unit(self, name: str) -> str:
        """SI unit of a channel."""
        return self.units.get(name, unit_of(name))

    @property
    def resampled(self) -> frozenset[str]:
        """Channels measured at other times than `time` says; `time` itself where a rate made it.

        Those that were carried from a clock of their own; of a log that does not say: none.
        """
        try:
            return frozenset(json.loads(self.metadata.get(RESAMPLED, "[]")))
        except (ValueError, TypeError):
            return frozenset()

    @property
    def sample_period(self) -> float:
        """Median time between samples in s (NaN for fewer than two samples)."""
        return float(np.median(np.diff(self.time))) if len(self) > 1 else float("nan")

    def between(self, start: float, stop: float) -> Recording:
        """Return the samples with start <= time < stop."""
        mask = (self.time >= start) & (self.time < stop)
        values = {name: array[mask] for name, array in self.values.items()}
        return replace(self, time=self.time[mask], values=values)

    def with_values(self, values: Mapping[str, FloatArray]) -> Recording:
        """Return a copy with channels added or replaced."""
        return replace(self, values={**self.values, **values})

    @property
    def summary(self) -> str:
        """What it is in one line, without its channels: samples, duration, rate."""
        span = self.time[-1] - self.time[0] if len(self) > 1 else 0.0
        rate = f" at {1.0 / self.sample_period:.6g} Hz" if len(self) > 1 else ""
        name = f" of {self.source}" if self.source else ""
        return f"Recording{name}: {len(self)} samples over {span:.4g} s{rate}"

    def __repr__(self) -> str:
        """What it is in one line: samples, duration, rate, channels."""
        names = list(self)
        left = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        listed = ", ".join(names[:_NAMED]) + left
        return f"<{self.summary}, {listed}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: a line a channel."""
        return str(_html(self))

    def plot(self, *channels: str) -> Figure:
        """Return a matplotlib figure of the channels named, or of all that show more than noise.

        Raises:
            MissingChannelError: a channel is not there.
        """
        figure: Figure = _plot(self, *channels)
        return figure

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas DataFrame of all channels, indexed by time in s."""
        import pandas as pd

        index = pd.Index(np.array(self.time), name="time")
        return pd.DataFrame({name: np.array(self[name]) for name in self}, index=index)


def _restored(content: dict[str, Any]) -> Recording:
    return Recording(**content)
