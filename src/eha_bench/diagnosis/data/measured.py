"""A run that passed the gate: what drives a model, and what it is held against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.note import Note, merged_notes
from eha_bench.core.turns import remembered_turns
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.data.lost_inputs import LostValues
from eha_bench.diagnosis.data.noise import noise_of, quantum_of
from eha_bench.diagnosis.data.repeats import distinct
from eha_bench.diagnosis.data.slopes import Slope, slope_of
from eha_bench.diagnosis.data.start_angle import KNOWN, StartAngle
from eha_bench.diagnosis.data.wander import Wander
from eha_bench.plants.channel_roles import KNOWN as KNOWN_CHANNELS
from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.plant import AT_ONCE, Drive

GAP = 1.5
"""A step of the clock by more than this many usual ones leaves samples out."""
_UNREAD = 0.1
"""Longest time between two readings of a speed over which its angle is known, s."""


@dataclass(frozen=True)
class FirstReading:
    """The first finite reading of a channel, SI, the sample that it is of, and if all are it."""

    value: float
    tick: int
    frozen: bool


class Turning(NamedTuple):
    """What turns and is read only as a speed.

    Attributes:
        channel: the speed that is read. angle: the state that nothing reads.
        ratio: how many times as fast the channel turns as the angle, as declared.
    """

    channel: str
    angle: str
    ratio: float


class Scattered(NamedTuple):
    """What a clock whose stamps scatter makes of a channel's readings (`stamps`).

    Attributes:
        stamps: standard deviation of stamps, s. noise: of a reading at rest, SI; NaN: not known.
        moved: (n,) standard deviation that scatter adds to each reading, SI.
    """

    stamps: float
    noise: float
    moved: FloatArray


@dataclass(frozen=True)
class Measured:
    """A recording that passed the gate, on its own clock.

    Attributes:
        run: where it is from, and its setup.
        time: (n,) s from the first sample.
        inputs: channel -> (n,), SI, without gaps.
        outputs: channels that can be compared with the plant's.
        values: (n, m) SI, 0 where not valid.
        valid: (n, m) whether a value may be believed.
        breaks: ticks before which inputs were not logged long enough to matter.
        notes: what was found, one sentence each.
        held: channel -> value that the setup holds (a locked piston's position), SI.
        still: channel -> (n,) readings of what the setup holds: its sensor's noise, SI.
        input_noise: channel -> standard deviation of the noise of an input that was measured, SI;
            what was asked for is exact, and not in here.
        colours: channel -> colour of its noise, where that is not white.
        wander: channel -> how its zero wanders, where that was found.
        scattered: channel -> what stamps that scatter make of its readings, where they do.
        start: angle of the shaft at the first sample. roles: what the channels are.
        first: channel -> its first reading as logged, whether it may be believed or not.
        taken: channel -> (n,) s that its samples were taken after their ticks; without: at them.
        late: channel -> clock that may be stamped late by always the same (`ticks`).
        topic_of: channel -> clock of its topic, of topics that drive nothing.
        clocks: clock -> place of its lateness in a vector of parameters.
        lateness: clock -> s by which its stamps are late, as far as it is known.
        unsure: input -> its values that were not logged.
        given_every: input -> s from one of its values to the next, where that is less than `tick`.
        asked_before: input -> what it was held at before the first tick, SI; one without was what
            it is at the first tick.
        apart: whether channels tick on different clocks.
    """

    run: Run
    time: FloatArray
    inputs: Mapping[str, FloatArray]
    outputs: tuple[str, ...]
    values: FloatArray
    valid: BoolArray
    breaks: tuple[int, ...] = ()
    notes: tuple[Note, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    still: Mapping[str, FloatArray] = field(default_factory=dict)
    input_noise: Mapping[str, float] = field(default_factory=dict)
    colours: Mapping[str, Colour] = field(default_factory=dict)
    wander: Mapping[str, Wander] = field(default_factory=dict)
    scattered: Mapping[str, Scattered] = field(default_factory=dict)
    start: StartAngle = KNOWN
    roles: ChannelRoles = KNOWN_CHANNELS
    first: Mapping[str, FirstReading] = field(default_factory=dict)
    taken: Mapping[str, FloatArray] = field(default_factory=dict)
    late: Mapping[str, str] = field(default_factory=dict)
    topic_of: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, int] = field(default_factory=dict)
    lateness: Mapping[str, float] = field(default_factory=dict)
    unsure: Mapping[str, LostValues] = field(default_factory=dict)
    given_every: Mapping[str, float] = field(default_factory=dict)
    asked_before: Mapping[str, float] = field(default_factory=dict)
    apart: bool = False

    def at(self, channel: str, ticks: slice | IndexArray) -> FloatArray:
        """Return when a channel's samples at some ticks were taken, s from the first tick."""
        taken = self.taken.get(channel)
        if taken is None:
            return self.time[ticks]
        late = self.lateness.get(self.late.get(channel, ""), 0.0)
        return self.time[ticks] + taken[ticks] - late

    def at_sample_instants(
        self, channel: str, simulated: FloatArray, lateness: Mapping[str, float]
    ) -> FloatArray:
        """Return a simulated channel at the instants at which its samples were taken, (n,).

        Args:
            channel: name. simulated: (n,) at the ticks.
            lateness: clock -> s that its stamps are late by.
        """
        taken = self.taken.get(channel)
        if taken is None:
            return simulated
        instants = self.time + taken - lateness.get(self.late.get(channel, ""), 0.0)
        return np.interp(instants, self.time, simulated)

    def at_angles(self, starts: Mapping[str, StartAngle]) -> Measured:
        """Return the same run with the shaft at another angle at its start, given by run's name."""
        return replace(self, start=starts.get(self.run.name, self.start))

    def knowing(self, parameters: Mapping[str, float]) -> Measured:
        """Return the same run with some of its parameters known, by name, SI."""
        if not parameters:
            return self
        known = {**self.run.parameters, **parameters}
        own = {key: place for key, place in self.run.own.items() if key not in known}
        return replace(self, run=replace(self.run, parameters=known, own=own))

    def beginning(self, length: float) -> Measured:
        """Return what the same run is for some seconds, two samples at least."""
        n = max(2, int(np.searchsorted(self.time, self.time[0] + length)))
        return replace(
            self,
            time=self.time[:n],
            inputs={name: values[:n] for name, values in self.inputs.items()},
            values=self.values[:n],
            valid=self.valid[:n],
            breaks=tuple(tick for tick in self.breaks if tick < n),
            taken={name: values[:n] for name, values in self.taken.items()},
            scattered={
                name: item._replace(moved=item.moved[:n]) for name, item in self.scattered.items()
            },
        )

    def ended(self, until: float) -> Measured:
        """Return the same run with no reading believed from a time on, s from its first sample."""
        before = self.time < until
        return self if before.all() else replace(self, valid=self.valid & before[:, None])

    @cached_property
    def tick(self) -> float:
        """Usual step of its clock, s."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def steps(self) -> dict[str, float]:
        """The step in which each output is quantised, SI; those without one are not there."""
        found = {}
        for name in self.outputs:
            column = self.column(name)
            if column is not None and (step := quantum_of(column[np.isfinite(column)])) > 0.0:
                found[name] = step
        return found

    @cached_property
    def distinct(self) -> BoolArray:
        """Which values may be believed and repeat no other one, (n, m)."""
        columns = np.where(self.valid, self.values, np.nan).T
        own = [distinct(column) for column in columns]
        return np.stack(own, axis=1) if own else self.valid

    def distinct_within(self, span: slice) -> BoolArray:
        """Return the same over some ticks; where all of them rest, one of each channel is left."""
        found = self.distinct[span]
        if found.any():
            return found
        one = np.zeros_like(found)
        for column, valid in enumerate(self.valid[span].T):
            read = np.flatnonzero(valid)
            one[read[read.size // 2 : read.size // 2 + 1], column] = True
        return one

    @cached_property
    def jumps(self) -> IndexArray:
        """Ticks at which an input jumps, in their order; what is logged there is from before."""
        found = []
        for values in self.inputs.values():
            change = np.abs(np.diff(values, prepend=values[0]))
            usual = np.quantile(change, 0.9)
            found.append(np.flatnonzero(change > max(10.0 * usual, 0.02 * np.ptp(values) + 1e-300)))
        return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.intp)

    @cached_property
    def turning(self) -> Turning | None:
        """What turns and is read only as a speed; None where there is nothing of the kind."""
        told = {shown for name, (shown, _) in self.roles.geared.items()
                if self.read(name) is not None}  # fmt: skip
        geared = [(name, *item) for name, item in self.roles.geared.items()]
        for speed, angle in self.roles.turning.items():
            if angle in told:
                continue
            for name, shown, ratio in [(speed, speed, 1.0), *geared]:
                if shown == speed and self.read(name) is not None:
                    return Turning(name, angle, ratio)
        return None

    @cached_property
    def shaft_angle(self) -> FloatArray | None:
        """The shaft's angle from its start by the integrated measured speed, (n,) rad, or None."""
        if self.turning is None:
            return None
        speed = self.read(self.turning.channel)
        assert speed is not None
        good = np.isfinite(speed)
        filled = np.interp(self.time, self.time[good], speed[good]) / self.turning.ratio
        steps = 0.5 * (filled[1:] + filled[:-1]) * np.diff(self.time)
        return self.start.value + np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def known_shaft_angle(self) -> FloatArray | None:
        """The same, NaN from where its speed was not read for long."""
        if self.turning is None or self.shaft_angle is None:
            return None
        speed = self.read(self.turning.channel)
        assert speed is not None
        read = np.append(self.time[np.isfinite(speed)], np.inf)
        ends = np.flatnonzero(np.diff(read) > max(_UNREAD, 3.0 * float(np.median(np.diff(read)))))
        return np.where(self.time <= read[ends[0]], self.shaft_angle, np.nan)

    @cached_property
    def slopes(self) -> dict[str, Slope]:
        """Rates that nothing reads, by their states: the slopes of positions that were read.

        Behind a gear they are divided by its declared ratio. What the setup locks has none.
        """
        found: dict[str, Slope] = {}
        for name, rate in self.roles.rate_of.items():
            if rate in found or self.read(rate) is not None:
                continue
            if self.run.locked and name in self.roles.locked:
                found[rate] = Slope(np.zeros(self.time.size), 0.0, name)
                continue
            position = self.read(name)
            if position is None:
                continue
            # the noise of what is read in steps is one of these, at least
            noise = np.nan_to_num(_noise_of_column(self, name, position))
            noise = max(float(noise), quantum_of(position[np.isfinite(position)]) / np.sqrt(12.0))
            _, ratio = self.roles.geared.get(name, ("", 1.0))
            slope = slope_of(self.time, self.at(name, slice(None)), position, noise, name)
            if slope is not None:
                found[rate] = Slope(slope.values / ratio, slope.noise / abs(ratio), name)
        return found

    def drive(
        self, first: int, last: int, initial: Mapping[str, float] | None = None, history: int = 0
    ) -> Drive:
        """Return what drives a simulation over the ticks from `first` to before `last`.

        Args:
            first, last: ticks. initial: channel -> what its sensor reads first, SI.
            history: ticks of the inputs before, at most; before these, where a command turned: what
                has play depends on nothing else.
        """
        lead = max(0, first - history)
        before = self._turns_before(lead) if history else np.zeros(0, dtype=np.intp)
        rows = np.concatenate([before, np.arange(lead, last)])
        time = self.time[rows]
        # all at once: what follows with time knows nothing of them
        time[: before.size] = self.time[lead] - AT_ONCE * np.arange(before.size, 0, -1)
        inputs = {name: values[rows] for name, values in self.inputs.items()}
        known = before.size + first - lead
        if self.asked_before and lead == 0:
            known += 1
            time = np.concatenate([[time[0] - AT_ONCE], time])
            inputs = {
                name: np.concatenate([[self.asked_before.get(name, values[0])], values])
                for name, values in inputs.items()
            }
        return Drive(
            time,
            inputs,
            initial or {},
            self.run.locked,
            self.run.bypass_open,
            known,
            turns=before.size,
        )

    @cached_property
    def strides(self) -> Mapping[str, int]:
        """Ticks from one reading of a channel to its next one, at least 1, by channel."""
        found = {}
        for at, name in enumerate(self.outputs):
            read = np.flatnonzero(self.valid[:, at])
            found[name] = max(1, round(float(np.median(np.diff(read))))) if read.size > 1 else 1
        return found

    @cached_property
    def _turns(self) -> dict[int, IndexArray]:
        """What `_turns_before` has found, by tick."""
        return {}

    def _turns_before(self, tick: int) -> IndexArray:
        """Return ticks at which commands turned that a play still remembers at one, (k,)."""
        if tick not in self._turns:
            commands = [self.inputs[name] for name in self.roles.remembered if name in self.inputs]
            found = [remembered_turns(own[:tick]) for own in commands]
            self._turns[tick] = np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *found]))
        return self._turns[tick]

    def column(self, channel: str) -> FloatArray | None:
        """Return a valid channel with NaN where it may not be believed, or None."""
        if channel not in self.outputs:
            return None
        at = self.outputs.index(channel)
        if not self.valid[:, at].any():
            return None
        return np.where(self.valid[:, at], self.values[:, at], np.nan)

    def read(self, channel: str) -> FloatArray | None:
        """Return an input, or a valid channel as `column` does, or None."""
        return self.inputs[channel] if channel in self.inputs else self.column(channel)


def notes_of_runs(measured: Sequence[Measured]) -> tuple[str, ...]:
    """Return the notes of several runs, those that differ in numbers only as one."""
    return merged_notes(note for item in measured for note in item.notes)


def pooled_noise(measured: Sequence[Measured], outputs: Sequence[str]) -> dict[str, float]:
    """Return each channel's noise over all runs: the median of the runs' own estimates."""
    noise: dict[str, float] = {}
    for name in outputs:
        found = []
        for item in measured:
            column = item.column(name)
            if column is not None:
                found.append(_noise_of_column(item, name, column))
        usable = [value for value in found if np.isfinite(value) and value > 0]
        if usable:
            noise[name] = float(np.median(usable))
    return noise


def _noise_of_column(measured: Measured, name: str, column: FloatArray) -> float:
    """Return a channel's noise in one run; where it has a colour, that of all of it."""
    scattered = measured.scattered.get(name)
    if scattered is not None and scattered.noise > 0.0:
        return scattered.noise
    parted = parted_at_gaps(measured.time, column)
    colour = measured.colours.get(name)
    if colour is None:
        return noise_of(parted)
    return noise_of(colour.whitened(parted)) / colour.sharpness


def parted_at_gaps(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return a channel's own samples with NaN in gaps between them."""
    good = np.isfinite(values)
    return _gaps_as_nan(time[good], values[good])


def _gaps_as_nan(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return a channel with NaN in gaps of the clock: what its signal does there is no noise."""
    if time.size < 2:
        return values
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    return np.insert(values, gaps, np.nan)
