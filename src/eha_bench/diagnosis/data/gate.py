"""The data gate: what of a recording may be believed, and how noisy each channel is.

Noise is estimated from the recording itself (`noise`), never assumed. Channels that do not move,
stretches that stand still or are clipped, and gaps are noted and left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray, IndexArray
from eha_bench.core.errors import MissingChannelError, Place, RecordingError
from eha_bench.core.note import Note, merged_notes, of_run
from eha_bench.core.recording import Recording
from eha_bench.core.slow_channel import readings_of
from eha_bench.core.turns import remembered_turns
from eha_bench.diagnosis.data.clock import regular_clock
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.data.lost_inputs import LostValues, guess_lost
from eha_bench.diagnosis.data.noise import (
    noise_of,
    noise_of_input,
    quantum_of,
    sharp_noise_of,
)
from eha_bench.diagnosis.data.start_angle import KNOWN, StartAngle
from eha_bench.diagnosis.data.stuck import FLICKERS, stuck
from eha_bench.diagnosis.data.ticks import Sampled
from eha_bench.diagnosis.data.wander import Wander
from eha_bench.plants.channel_roles import KNOWN as KNOWN_CHANNELS
from eha_bench.plants.channel_roles import ChannelRoles
from eha_bench.plants.plant import Drive

GAP = 1.5
"""A step of the clock by more than this many usual ones leaves samples out."""
_RESTS = 3
"""Samples on either side of a gap that show whether an input rests there."""
SAME = 1e-3
"""What an input may move and still rest, as a share of its range."""
# a number on its own, not one in a name


@dataclass(frozen=True)
class FirstReading:
    """The first finite reading of a channel, SI, the sample that it is of, and if all are it."""

    value: float
    tick: int
    frozen: bool


_AT_ONCE = 1e-9
"""Time between two turns that are remembered, s: too short for anything to follow."""


_UNREAD = 0.1
"""Longest time between two readings of a speed over which its angle is known, s."""


class Turning(NamedTuple):
    """What turns and is read only as a speed.

    Attributes:
        channel: the speed that is read. angle: the state that nothing reads.
        ratio: how many times as fast the channel turns as the angle, as declared.
    """

    channel: str
    angle: str
    ratio: float


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
        start: angle of the shaft at the first sample. roles: what the channels are.
        first: channel -> its first reading as logged, whether it may be believed or not.
        taken: channel -> (n,) s that its samples were taken after their ticks; without: at them.
        late: channel -> clock that may be stamped late by always the same (`ticks`).
        clocks: clock -> place of its lateness in a vector of parameters.
        lateness: clock -> s by which its stamps are late, as far as it is known.
        unsure: input -> its values that were not logged.
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
    start: StartAngle = KNOWN
    roles: ChannelRoles = KNOWN_CHANNELS
    first: Mapping[str, FirstReading] = field(default_factory=dict)
    taken: Mapping[str, FloatArray] = field(default_factory=dict)
    late: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, int] = field(default_factory=dict)
    lateness: Mapping[str, float] = field(default_factory=dict)
    unsure: Mapping[str, LostValues] = field(default_factory=dict)
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
        told = {shown for name, (shown, _) in self.roles.geared.items() if self._reads(name)}
        geared = [(name, *item) for name, item in self.roles.geared.items()]
        for speed, angle in self.roles.turning.items():
            if angle in told:
                continue
            for name, shown, ratio in [(speed, speed, 1.0), *geared]:
                if shown == speed and self._reads(name):
                    return Turning(name, angle, ratio)
        return None

    def _reads(self, channel: str) -> bool:
        return channel in self.inputs or self.column(channel) is not None

    @cached_property
    def shaft_angle(self) -> FloatArray | None:
        """The shaft's angle from its start by the integrated measured speed, (n,) rad, or None."""
        if self.turning is None:
            return None
        speed = self.inputs.get(self.turning.channel, self.column(self.turning.channel))
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
        speed = self.inputs.get(self.turning.channel, self.column(self.turning.channel))
        assert speed is not None
        read = np.append(self.time[np.isfinite(speed)], np.inf)
        ends = np.flatnonzero(np.diff(read) > max(_UNREAD, 3.0 * float(np.median(np.diff(read)))))
        return np.where(self.time <= read[ends[0]], self.shaft_angle, np.nan)

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
        time[: before.size] = self.time[lead] - _AT_ONCE * np.arange(before.size, 0, -1)
        return Drive(
            time,
            {name: values[rows] for name, values in self.inputs.items()},
            initial or {},
            self.run.locked,
            self.run.bypass_open,
            before.size + first - lead,
            turns=before.size,
        )

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
    parted = _own_parted(measured.time, column)
    colour = measured.colours.get(name)
    return noise_of(colour.whitened(parted) if colour else parted)


def _own_parted(time: FloatArray, values: FloatArray) -> FloatArray:
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


def admit(
    run: Run,
    recording: Recording | Sampled,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    strict: bool = True,
    restful: Collection[str] = (),
    roles: ChannelRoles = KNOWN_CHANNELS,
) -> Measured:
    """Pass one recording through the gate.

    Args:
        run: where it is from. recording: what was read, on one clock or of topics on common ticks.
        inputs: channels that drive the model. outputs: channels that the model gives.
        strict: whether a recording without any output to compare is an error.
        restful: channels that read the same for as long as nothing moves, as other runs show:
            standing still all through a run, they tell of a machine that does.
        roles: what the plant's channels are.

    Raises:
        MissingChannelError: an input is not in the recording.
        RecordingError: an input is nowhere finite, or no output can be compared.
    """
    where = Place(file=str(run.log))
    sampled = recording if isinstance(recording, Sampled) else Sampled(recording)
    recording, apart = sampled.recording, sampled.is_of_several
    time = np.array(recording.time - recording.time[0])
    notes = [of_run(run.name, note) for note in recording.notes]
    regular = None
    if not apart:
        regular = regular_clock(time, [recording[name] for name in outputs if name in recording])
    if regular is not None:
        beside = 1e3 * float(np.std(time - regular))
        notes.append(
            Note(
                "{run}: its time stamps are {off:.2g} ms off a regular clock; the readings follow "
                "that clock, so it is used",
                run=run.name,
                off=beside,
            )
        )
        time = regular
    driven = _driving_inputs(run, sampled, time, inputs, roles, where, notes)
    names, columns, masks = [], [], []
    held: dict[str, float] = {}
    unmoved: dict[str, FloatArray] = {}
    for name in outputs:
        if name in inputs or name not in recording:
            continue
        raw = np.array(recording[name])
        good = np.isfinite(raw)
        if not good.any():
            notes.append(
                Note(
                    "{run}: '{channel}' holds no finite value and is left out",
                    run=run.name,
                    channel=name,
                )
            )
            continue
        if run.locked and name in roles.locked and name in roles.rate_of:
            held[name] = float(raw[int(np.argmax(good))])
        if np.ptp(raw[good]) == 0.0 and not _stands(run, name, restful, notes, roles):
            continue
        if run.locked and name in roles.locked:
            unmoved[name] = raw
            continue
        still = _stuck(raw, good, limited=name in roles.limited, own=apart)
        if still.any():
            notes.append(
                Note(
                    "{run}: '{channel}' stands still or is clipped for {count:d} samples, left out",
                    run=run.name,
                    channel=name,
                    count=int(still.sum()),
                )
            )
            good &= ~still
        if not good.all():
            gaps = readings_of(raw if sampled.logged is None else raw[sampled.logged]).missing
            if gaps and not apart:
                notes.append(
                    Note(
                        "{run}: '{channel}' has {count:d} samples missing",
                        run=run.name,
                        channel=name,
                        count=gaps,
                    )
                )
        names.append(name)
        columns.append(np.where(good, raw, 0.0))
        masks.append(good)
    if not names and strict:
        raise RecordingError(
            "no channel of the plant is measured",
            where=where,
            hint=f"one of {', '.join(outputs)} must be there and change; it has: "
            f"{', '.join(recording)}; map it in channels.yaml",
        )
    breaks = _clock(run, time, driven.values, driven.missing, notes)
    return Measured(
        run,
        time,
        driven.values,
        tuple(names),
        np.column_stack(columns) if columns else np.zeros((time.size, 0)),
        np.column_stack(masks) if masks else np.zeros((time.size, 0), dtype=np.bool_),
        breaks,
        tuple(notes),
        held,
        unmoved,
        driven.noise,
        first=_first_readings(recording),
        roles=roles,
        taken={name: sampled.taken[name] for name in names if name in sampled.taken},
        late={name: sampled.late[name] for name in names if name in sampled.late},
        unsure={name: item for name, item in driven.unsure.items() if item.ticks.size},
        apart=apart,
    )


@dataclass(frozen=True)
class _Driven:
    """What drives a run.

    Attributes:
        values: input -> (n,), SI, without gaps. noise: of those that were measured, SI.
        unsure: input -> its values that were not logged. missing: (n,) where any of them has none.
    """

    values: dict[str, FloatArray]
    noise: dict[str, float]
    unsure: dict[str, LostValues]
    missing: BoolArray


def _driving_inputs(
    run: Run,
    sampled: Sampled,
    time: FloatArray,
    inputs: Sequence[str],
    roles: ChannelRoles,
    where: Place,
    notes: list[Note],
) -> _Driven:
    """Return what drives a run, and say what is not there."""
    found = _Driven({}, {}, {}, np.zeros(time.size, dtype=np.bool_))
    recording = sampled.recording
    for name in inputs:
        if name not in recording and name in roles.on_top:
            notes.append(
                Note(
                    "{run}: no '{channel}' in the log, so it is taken as zero",
                    run=run.name,
                    channel=name,
                )
            )
            found.values[name] = np.zeros(time.size)
            continue
        raw = _input(name, recording, where)
        lost = sampled.lost.get(name, ~np.isfinite(raw))
        asked = name in roles.commands
        known = raw
        if lost.any():
            found.missing[lost] = True
            text = "{run}: input '{channel}' has {count:d} gaps, bridged"
            values: dict[str, str | int] = {"channel": name, "count": int(lost.sum())}
            if asked:
                known, found.unsure[name] = guess_lost(time, raw, lost)
                text += "; {unknown:d} of them are unknown"
                values["unknown"] = found.unsure[name].ticks.size
            notes.append(Note(text, run=run.name, **values))
        found.values[name] = _filled(time, known, held=asked)
        found.noise.update(_input_noise(name, time, raw, roles))
    return found


def _first_readings(recording: Recording) -> dict[str, FirstReading]:
    found = {}
    for name in recording:
        good = np.isfinite(recording[name])
        if good.any():
            tick = int(np.argmax(good))
            read = recording[name][good]
            frozen = read.size > 1 and float(np.ptp(read)) == 0.0
            found[name] = FirstReading(float(read[0]), tick, frozen)
    return found


def restful_channels(readings: Iterable[tuple[str, FloatArray]]) -> frozenset[str]:
    """Return channels whose readings rest where nothing moves, as at least one run shows.

    Their noise is finer than their resolution, so a reading that stands still is that of a
    machine that does.

    Args:
        readings: channels of runs, (n,) each, NaN where nothing was measured.
    """
    found = set()
    for name, values in readings:
        there = values[np.isfinite(values)]
        if there.size > 1 and np.ptp(there) > 0.0 and _may_rest(there):
            found.add(name)
    return frozenset(found)


def _may_rest(values: FloatArray) -> bool:
    """Whether a reading stands still for long without being stuck, and moves at other times."""
    step = quantum_of(values)
    same = np.diff(values) == 0.0
    return step > 0.0 and bool(same.any()) and sharp_noise_of(values) <= FLICKERS * step


def _stands(
    run: Run, name: str, restful: Collection[str], notes: list[Note], roles: ChannelRoles
) -> bool:
    """Whether a reading that never changes is that of a machine that stands, and say so."""
    if run.locked and name in roles.locked:
        return False
    if name in restful:
        notes.append(
            Note(
                "{run}: '{channel}' never changes, as in other runs at rest: the machine is taken "
                "to be at rest or stalled",
                run=run.name,
                channel=name,
            )
        )
        return True
    notes.append(
        Note(
            "{run}: '{channel}' never changes (dead sensor?) and is left out",
            run=run.name,
            channel=name,
        )
    )
    return False


def _stuck(raw: FloatArray, good: BoolArray, *, limited: bool, own: bool) -> BoolArray:
    """Return where a reading is stuck; a channel with its own samples is looked at in these."""
    read = raw[good]
    if own:
        still = np.zeros(raw.size, dtype=np.bool_)
        still[good] = stuck(read, quantum_of(read), sharp_noise_of(read))
    else:
        still = stuck(raw, quantum_of(read), sharp_noise_of(raw))
    # at its limit a drive's current does stand still
    return still & (np.abs(raw) < np.nanmax(np.abs(raw))) if limited else still


def _input(name: str, recording: Recording, where: Place) -> FloatArray:
    if name not in recording:
        raise MissingChannelError(name, where=where, have=tuple(recording.values))
    raw = np.array(recording[name])
    if not np.isfinite(raw).any():
        raise RecordingError(f"input '{name}' holds no finite value", where=where)
    return raw


def _input_noise(
    name: str, time: FloatArray, raw: FloatArray, roles: ChannelRoles
) -> dict[str, float]:
    """Return an input's noise by its name; what was asked for, or never changes, has none."""
    level = 0.0 if name in roles.commands else noise_of_input(_own_parted(time, raw))
    return {name: level} if level > 0.0 else {}


def _clock(
    run: Run,
    time: FloatArray,
    inputs: Mapping[str, FloatArray],
    missing: BoolArray,
    notes: list[Note],
) -> tuple[int, ...]:
    """Say what is wrong with the clock; return ticks after which inputs were unknown for long."""
    steps = np.diff(time)
    if not steps.size:
        return ()
    usual = float(np.median(steps))
    jumps = np.flatnonzero(steps > 5.0 * usual) + 1
    if jumps.size:
        notes.append(
            Note(
                "{run}: the clock jumps {count:d} times by more than five periods of "
                "{period:.3g} ms",
                run=run.name,
                count=jumps.size,
                period=usual * 1e3,
            )
        )
    uneven = float(np.std(steps[steps <= 5.0 * usual]) / usual) if steps.size else 0.0
    if uneven > 0.3:
        notes.append(
            Note(
                "{run}: the sampling period varies by {uneven:.0f} %",
                run=run.name,
                uneven=100.0 * uneven,
            )
        )
    holes = _long_holes(missing, time, 10.0 * usual)
    telling = [k for k in map(int, jumps) if steps[k - 1] > 0.05 or not _held_across(inputs, k)]
    return tuple(sorted({*telling, *holes}))


def _held_across(inputs: Mapping[str, FloatArray], k: int) -> bool:
    """Whether every input rests before and after a gap and is the same: it was so within it.

    What moves on either side took an unknown path through the gap.
    """
    return all(
        np.ptp(values[max(0, k - _RESTS) : k + _RESTS]) <= SAME * np.ptp(values)
        for values in inputs.values()
    )


def _filled(time: FloatArray, raw: FloatArray, *, held: bool) -> FloatArray:
    good = np.isfinite(raw)
    if good.all():
        return np.ascontiguousarray(raw, dtype=np.float64)
    if not held:
        return np.interp(time, time[good], raw[good])
    last = np.maximum.accumulate(np.where(good, np.arange(raw.size), -1))
    first = int(np.argmax(good))
    return np.ascontiguousarray(raw[np.where(last < 0, first, last)])


def _long_holes(missing: BoolArray, time: FloatArray, longest: float) -> list[int]:
    ends = []
    start: int | None = None
    for k in range(missing.size):
        if missing[k] and start is None:
            start = k
        elif not missing[k] and start is not None:
            if time[k] - time[start] > longest:
                ends.append(k)
            start = None
    return ends
