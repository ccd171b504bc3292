"""The data gate: what of a recording may be believed, and how noisy each channel is.

Noise is estimated from the recording itself (`noise`), never assumed. Channels that do not move,
stretches that stand still or are clipped, and gaps are noted and left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.errors import MissingChannelError, Place, RecordingError
from eha_bench.core.note import Note, of_run
from eha_bench.core.recording import Recording
from eha_bench.core.slow_channel import readings_of
from eha_bench.diagnosis.data.beyond_sensors import refuse_beyond_sensors
from eha_bench.diagnosis.data.clock import regular_clock
from eha_bench.diagnosis.data.dataset import Run
from eha_bench.diagnosis.data.lost_inputs import LostValues, guess_lost
from eha_bench.diagnosis.data.measured import FirstReading, Measured, parted_at_gaps
from eha_bench.diagnosis.data.noise import (
    is_rough,
    noise_of_input,
    quantum_of,
    sharp_noise_of,
)
from eha_bench.diagnosis.data.stuck import FLICKERS, stuck
from eha_bench.diagnosis.data.ticks import Sampled
from eha_bench.plants.channel_roles import KNOWN as KNOWN_CHANNELS
from eha_bench.plants.channel_roles import ChannelRoles

_LONG_GAP = 0.05
"""Gap in time behind which windows always begin anew, s."""
_FEWEST, _MOSTLY = 25, 0.5
"""Shorter gaps do not cut windows where stretches of fewer samples than that from one to the next
make up so large a share of a run."""
_RESTS = 3
"""Samples on either side of a gap that show whether an input rests there."""
SAME = 1e-3
"""What an input may move and still rest, as a share of its range."""


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
        RecordingError: an input is nowhere finite, no output can be compared, or one holds
            readings beyond all sensors and hardly any other.
    """
    where = Place(file=str(run.log))
    sampled = recording if isinstance(recording, Sampled) else Sampled(recording)
    recording, apart = sampled.recording, sampled.is_of_several
    refuse_beyond_sensors(recording, (*inputs, *outputs), where)
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
            # a row that was put in before the first has a command alone
            if gaps > int(not good[0]) and not apart:
                notes.append(
                    Note(
                        "{run}: samples of '{channel}' that are missing: {count:d}",
                        run=run.name,
                        channel=name,
                        count=gaps,
                    )
                )
        names.append(name)
        columns.append(np.where(good, raw, 0.0))
        masks.append(good)
    if not names and strict:
        own = [name for name in outputs if name not in driven.values and name not in held]
        raise _nothing_compared(own, recording, where)
    long, short = _clock(run, time, driven.values, driven.missing, notes)
    read = np.ones(time.size, dtype=np.bool_) if sampled.logged is None else sampled.logged
    logged = np.flatnonzero(read)
    for k in {int(k) for item in driven.unsure.values() for k in item.anew if k < time.size}:
        before = int(logged[max(int(np.searchsorted(logged, k)) - 1, 0)])
        (long if time[k] - time[before] > _LONG_GAP else short).add(k)
    breaks = _far_apart(run, time, long, short, notes)
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
        topic_of={name: sampled.topic_of[name] for name in names if name in sampled.topic_of},
        unsure={name: item for name, item in driven.unsure.items() if item.ticks.size},
        apart=apart,
    )


def _nothing_compared(
    outputs: Collection[str], recording: Recording, where: Place
) -> RecordingError:
    """Return the error of a run in which nothing of the plant is to be compared."""
    there = [name for name in outputs if name in recording]
    if not there:
        return RecordingError(
            "no channel of the plant is measured",
            where=where,
            hint=f"one of {', '.join(outputs)} must be there; it has: {', '.join(recording)}; map "
            "it in channels.yaml",
        )
    return RecordingError(
        f"no channel of the plant changes: {', '.join(there)} has one value, or none, from end to "
        "end",
        where=where,
        hint="a dead sensor, or a run that stands still, tells a fit nothing: leave the run out",
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
        asked = _is_exact(name, time, raw, roles)
        known = raw
        if lost.any():
            found.missing[lost] = True
            text = "{run}: gaps of input '{channel}', bridged: {count:d}"
            values: dict[str, str | int] = {"channel": name, "count": int(lost.sum())}
            if asked:
                # whether a row was not written, or what it asks for not sent either, no log says
                held = sampled.logged is not None
                known, found.unsure[name] = guess_lost(time, raw, lost, may_be_held=held)
                text += ", of which unknown: {unknown:d}"
                values["unknown"] = found.unsure[name].ticks.size
            notes.append(Note(text, run=run.name, **values))
        found.values[name] = _filled(time, known, held=asked)
        if not asked and (level := noise_of_input(parted_at_gaps(time, raw))) > 0.0:
            found.noise[name] = level
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


def _is_exact(name: str, time: FloatArray, raw: FloatArray, roles: ChannelRoles) -> bool:
    """Whether an input is what was asked for: by its name, or as it is smooth."""
    if name in roles.commands:
        return True
    return name in roles.read_back and not is_rough(parted_at_gaps(time, raw))


def _clock(
    run: Run,
    time: FloatArray,
    inputs: Mapping[str, FloatArray],
    missing: BoolArray,
    notes: list[Note],
) -> tuple[set[int], set[int]]:
    """Say what is wrong with the clock; return ticks behind which inputs were unknown.

    Those behind long gaps, and those behind short ones.
    """
    steps = np.diff(time)
    if not steps.size:
        return set(), set()
    usual = float(np.median(steps))
    jumps = np.flatnonzero(steps > 5.0 * usual) + 1
    if jumps.size:
        notes.append(
            Note(
                "{run}: jumps of the clock by more than five periods of {period:.3g} ms: {count:d}",
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
    long = {k for k in map(int, jumps) if steps[k - 1] > _LONG_GAP}
    short = {k for k in map(int, jumps) if k not in long and not _held_across(inputs, k)}
    return {*long, *holes}, short


def _far_apart(
    run: Run, time: FloatArray, long: set[int], short: set[int], notes: list[Note]
) -> tuple[int, ...]:
    """Return the ticks at which windows begin anew: behind gaps, unless these come too often.

    A controller that is held up for some milliseconds again and again leaves windows in which
    nothing slow shows: these go on, with the command in between as its neighbours say.
    """
    breaks = sorted(long | short)
    stretches = np.diff([0, *breaks, time.size])
    if not short or stretches[stretches < _FEWEST].sum() < _MOSTLY * time.size:
        return tuple(breaks)
    notes.append(
        Note(
            "{run}: gaps come every {apart:.3g} s, so windows go on through them, with the inputs "
            "as their neighbours say",
            run=run.name,
            apart=float(np.median(np.diff(time[[0, *breaks]]))),
        )
    )
    return tuple(sorted(long))


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
