"""Mistakes of a channel map that readings show: a sign, a scale, two channels for one another.

They are mistakes of the log's description, not of the machine: no effect of the plant explains
them, and a fit that tries bends every parameter. Readings are corrected as a log is read, so held
out runs are corrected as well.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset


class MapCorrection(Protocol):
    """What readings become, and which channels it concerns."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that are read otherwise."""
        ...

    @property
    def words(self) -> str:
        """How its channels are read."""
        ...

    def of(self, recording: Recording) -> Recording:
        """Return a recording with the channels that it has of them corrected."""
        ...

    def note(self, factor: float, where: str) -> str:
        """Say what is read otherwise, by what factor the error falls with it, and where to mend it.

        Args:
            factor: of the error. where: files that say how these channels are read.
        """
        ...


@dataclass(frozen=True)
class Reversed:
    """Channels of the opposite sign.

    Attributes:
        sums: channels, each with what a reading and the reversed one add up to, SI: 0 where the
            sign alone is the other one, both ends where a position counts from the other end.
    """

    sums: tuple[tuple[str, float], ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that are reversed."""
        return tuple(name for name, _ in self.sums)

    @property
    def words(self) -> str:
        """That they are reversed."""
        return f"{_quoted(self.channels)} reversed"

    def of(self, recording: Recording) -> Recording:
        """Return a recording with these channels reversed."""
        values = recording.values
        reverse = {name: total - values[name] for name, total in self.sums if name in values}
        return replace(recording, values={**values, **reverse})

    def note(self, factor: float, where: str) -> str:
        """Say that the sign is the other one, and what to look at."""
        ends = any(total != 0.0 for _, total in self.sums)
        keys = "`scale` and `offset`" if ends else "`scale`"
        return (
            f"CAUTION: opposite sign of {_quoted(self.channels)}: read reversed, as here, the "
            f"error is {factor:.3g} times smaller; correct {keys} in {where}"
        )


@dataclass(frozen=True)
class Scaled:
    """A channel of another scale.

    Attributes:
        channel: it. factor: by which its readings are multiplied.
    """

    channel: str
    factor: float

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel."""
        return (self.channel,)

    @property
    def words(self) -> str:
        """By what it is multiplied."""
        return f"'{self.channel}' times {self.factor:.4g}"

    def of(self, recording: Recording) -> Recording:
        """Return a recording with the channel multiplied, where it has it."""
        values = recording.values
        if self.channel not in values:
            return recording
        scaled = {self.channel: self.factor * values[self.channel]}
        return replace(recording, values={**values, **scaled})

    def note(self, factor: float, where: str) -> str:
        """Say what it reads of what there is, and what to look at."""
        return (
            f"CAUTION: '{self.channel}' reads {1.0 / self.factor:.4g} times what there is: read "
            f"right, as here, the error is {factor:.3g} times smaller, and what is believed does "
            f"not speak against it; correct `scale` in {where}, or have the sensor calibrated"
        )


@dataclass(frozen=True)
class Exchanged:
    """Two channels that are read for one another."""

    first: str
    second: str

    @property
    def channels(self) -> tuple[str, ...]:
        """Both channels."""
        return (self.first, self.second)

    @property
    def words(self) -> str:
        """That they are exchanged."""
        return f"{_quoted(self.channels)} exchanged"

    def of(self, recording: Recording) -> Recording:
        """Return a recording with each of the two under the other's name."""
        names = {self.first: self.second, self.second: self.first}
        values = {names.get(name, name): column for name, column in recording.values.items()}
        return replace(recording, values=values)

    def note(self, factor: float, where: str) -> str:
        """Say that they stand for one another, and what to look at."""
        return (
            f"CAUTION: '{self.first}' and '{self.second}' are exchanged: each read as the other, "
            f"as here, the error is {factor:.3g} times smaller; correct {where}"
        )


def corrected(
    dataset: Dataset, correction: MapCorrection, wrong: Collection[Path | None]
) -> Dataset:
    """Return a dataset of which some runs are read with a correction.

    Args:
        dataset: to correct. correction: of its channels. wrong: channel maps of these runs.
    """
    runs = [run.read_with(correction.of) if run.channels in wrong else run for run in dataset.runs]
    return replace(dataset, runs=tuple(runs), misread=(*dataset.misread, correction.words))


def _quoted(names: Iterable[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)
