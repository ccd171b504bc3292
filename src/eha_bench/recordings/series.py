"""Looks at a topic's stamps and values: duplicates, steps back, gaps, NaN, wrapped integers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.note import Note
from eha_bench.core.slow_channel import readings_of
from eha_bench.recordings.channel_map import ChannelEntry, Duplicates, Repair, StepsBack
from eha_bench.recordings.track import Column, Stamps, Track

GAP = 1.5
"""An interval longer than this many median intervals is reported as a gap."""
_GAPS = (
    "{clock}: {count:d} gap{s} in time, the longest {longest:.6g} s after {at:.6g} s "
    "(samples usually every {period:.6g} s)"
)
_NOT_FINITE = (
    "channel '{channel}': {count:d} of {size:d} samples are not finite, first at {at:.6g} s; they "
    "are kept"
)
_SLOW = "channel '{channel}' has one reading in {every:d} samples"
_BLOCK = 1 << 16
_SAMPLED = 1 << 14
_EXACT = 2.0**53
"""Up to here a double holds every whole number."""
BRIDGED = 3.0
"""Values are interpolated across intervals of up to this many median intervals."""


def seconds_in_place(stamps: Stamps, epoch: int) -> FloatArray:
    """Return stamps in s since `epoch`, shape (n,), in the memory of the stamps."""
    time = stamps.view(np.float64)
    for start in range(0, stamps.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        time[block] = seconds(stamps[block], epoch)
    return time


def seconds(stamps: Stamps, epoch: int) -> FloatArray:
    """Return stamps in s since `epoch`, shape (n,)."""
    return (stamps - np.int64(epoch)) / 1e9


_LATE = 3
"""Most samples that come late with one step back of the time, where a logger swaps messages."""


def ordered_track(track: Track, repair: Repair, where: Place) -> tuple[Track, list[str]]:
    """Return the track with strictly increasing stamps, and notes of what was repaired.

    Raises:
        RecordingError: stamps repeat or step back and the map does not say how to repair it, or
            the time stands still.
    """
    notes: list[str] = []
    if len(track) < 2:
        return track, notes
    if (track.stamps[1:] > track.stamps[:-1]).all():
        return track, notes
    epoch = int(track.stamps[0])
    if track.stamps.min() == track.stamps.max():
        raise RecordingError(
            f"the time stands still: all {len(track)} samples have the same stamp",
            where=where,
            hint="choose another clock in channels.yaml (log, publish or header)",
        )
    steps = np.diff(track.stamps)
    back = np.flatnonzero(steps < 0)
    if back.size:
        text = (
            f"{_times(back.size)} the time steps back, first at "
            f"{seconds(track.stamps[back[:1] + 1], epoch)[0]:.6g} s by "
            f"{-steps[back[0]] / 1e9:.6g} s (sample {back[0] + 1})"
        )
        if repair.steps_back is StepsBack.ERROR:
            raise RecordingError(text, where=where, hint=_mend_of(track.stamps, back.size))
        if repair.steps_back is StepsBack.SORT:
            track = track.rows(np.argsort(track.stamps, kind="stable"))
            notes.append(f"{where}: {text}; the samples were sorted by time")
        else:
            before = len(track)
            highest = np.maximum.accumulate(track.stamps)
            later = np.r_[True, track.stamps[1:] > highest[:-1]]
            # what only repeats the sample before it is a duplicate, and left to that rule
            again = np.r_[False, (steps == 0) & (track.stamps[1:] == highest[:-1])]
            track = track.rows(later | again)
            notes.append(f"{where}: {text}; {before - len(track)} samples were dropped")
    same = np.flatnonzero(np.diff(track.stamps) == 0)
    if same.size and (joined := _joined(track)) is not None:
        notes.append(
            f"{where}: {same.size} rows share the stamp of the row before and hold other channels: "
            "they were joined"
        )
        return joined, notes
    if same.size:
        text = (
            f"{same.size} samples repeat the stamp before, first at "
            f"{seconds(track.stamps[same[:1]], epoch)[0]:.6g} s (sample {same[0] + 1})"
        )
        if repair.duplicates is Duplicates.ERROR:
            raise RecordingError(
                text,
                where=where,
                hint="say 'repair: {duplicates: first}' or 'last' in channels.yaml",
            )
        keep = np.ones(len(track), dtype=bool)
        keep[same + (repair.duplicates is Duplicates.FIRST)] = False
        track = track.rows(keep)
        notes.append(f"{where}: {text}; the {repair.duplicates.value} of each was kept")
    return track, notes


def _joined(track: Track) -> Track | None:
    """Return a track whose rows of one stamp are one row; None where they hold the same channel.

    Several clocks in one table meet now and then, each in a row of its own.
    """
    stamps, row = np.unique(track.stamps, return_inverse=True)
    columns: dict[str, Column] = {}
    for name, column in track.columns.items():
        if column.dtype.kind != "f":
            return None
        there = ~np.isnan(column)
        if np.bincount(row[there], minlength=1).max() > 1:
            return None
        columns[name] = np.full(stamps.size, np.nan, dtype=column.dtype)
        columns[name][row[there]] = column[there]
    return Track(track.name, stamps, columns, track.kinds)


def _mend_of(stamps: Stamps, steps: int) -> str:
    """Say what to do about stamps that step back: single late ones, or a clock that was set back.

    Sorted, the stretches before and after a clock was set back would be mixed sample by sample.
    """
    late = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if late <= _LATE * steps:
        return "say 'repair: {steps_back: sort}' or 'drop' in channels.yaml"
    return (
        f"{late} samples follow with stamps that had been there, so the clock was set back: in "
        "channels.yaml give 'sample_rate' instead of the time of a table that ticks evenly, or "
        "leave the overlapping samples out with 'repair: {steps_back: drop}'; sorted, two "
        "stretches would be mixed"
    )


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


@dataclass(frozen=True)
class GapList:
    """Intervals of a clock that are much longer than its median interval."""

    starts: IndexArray
    lengths: FloatArray
    period: float


def gaps(stamps: Stamps) -> GapList:
    """Return the gaps of a strictly increasing clock."""
    if stamps.size < 3:
        return GapList(np.empty(0, dtype=np.intp), np.empty(0), float("nan"))
    period = typical_step(stamps)
    found = np.concatenate(
        [
            start + np.flatnonzero(np.diff(stamps[start : start + _BLOCK + 1]) > GAP * period)
            for start in range(0, stamps.size - 1, _BLOCK)
        ]
    )
    return GapList(found, (stamps[found + 1] - stamps[found]) / 1e9, period / 1e9)


def typical_step(stamps: Stamps) -> float:
    """Return the median interval of a clock in ns, of a sample of its intervals if it is long."""
    if stamps.size < 2:
        return float("nan")
    return float(np.median(_some_steps(stamps)))


def irregularity(stamps: Stamps) -> float:
    """Return the standard deviation of a clock's intervals over their mean."""
    if stamps.size < 2:
        return float("inf")
    steps = _some_steps(stamps)
    return float(np.std(steps) / np.mean(steps))


def _some_steps(stamps: Stamps) -> Stamps:
    count = stamps.size - 1
    if count <= _SAMPLED:
        return np.diff(stamps)
    places = np.linspace(0, count - 1, _SAMPLED).astype(np.intp)
    return stamps[places + 1] - stamps[places]


def gap_note(name: str, stamps: Stamps, epoch: int) -> list[str]:
    """Say how many gaps a clock has, and where the longest is."""
    found = gaps(stamps)
    if not found.starts.size:
        return []
    longest = int(np.argmax(found.lengths))
    at = seconds(stamps[found.starts[longest : longest + 1]], epoch)[0]
    count = found.starts.size
    return [
        Note(
            _GAPS,
            clock=name,
            count=count,
            s="s" if count > 1 else "",
            longest=float(found.lengths[longest]),
            at=float(at),
            period=float(found.period),
        )
    ]


def nan_note(name: str, values: Column, time: FloatArray) -> list[str]:
    """Say how many samples of a channel are NaN or infinite, and where the first is."""
    with np.errstate(all="ignore"):
        if np.isfinite(values.sum()):  # much faster than to look at each, nearly always enough
            return []
    bad = ~np.isfinite(values)
    count = int(np.count_nonzero(bad))
    if not count:
        return []
    readings = readings_of(values)
    if readings.every > 1:
        lost = ", {missing:d} of its readings are missing" if readings.missing else ""
        text = _SLOW + lost
        return [Note(text, channel=name, every=readings.every, missing=readings.missing)]
    at = time[int(np.argmax(bad))]
    return [
        Note(
            _NOT_FINITE,
            channel=name,
            count=count,
            size=values.size,
            at=float(at),
        )
    ]


def without_counts_of_rows(notes: Iterable[str]) -> tuple[str, ...]:
    """Return the notes on a table but those that count its rows: gaps, and empty cells.

    Where several clocks were written into one table they say nothing of any of them.
    """
    return tuple(
        note
        for note in notes
        if not isinstance(note, Note)
        or not any(text in note.template for text in (_GAPS, _NOT_FINITE, _SLOW))
    )


def rounding_note(name: str, values: Column, kind: str) -> list[str]:
    """Say where whole numbers are too large to be kept exactly, as a counter of nanoseconds is."""
    if kind[-2:] not in ("i8", "u8") or not values.size:
        return []
    largest = max(abs(np.nanmin(values)), abs(np.nanmax(values)))
    if not largest > _EXACT:
        return []
    return [
        f"channel '{name}': whole numbers up to {largest:.3g} are kept as floating point and are "
        f"rounded to multiples of {np.spacing(largest):g}"
    ]


def unwrapped_track(
    name: str, values: Column, kind: str, entry: ChannelEntry, time: FloatArray
) -> tuple[Column, list[str]]:
    """Report integers that wrapped around, and repair them where the map says so."""
    bits = entry.unwrap or _bits(values, kind)
    if not bits or values.size < 2:
        return values, []
    period = 2.0**bits
    jumps = np.flatnonzero(np.abs(np.diff(values)) > (0.5 if entry.unwrap else 0.75) * period)
    if not jumps.size:
        return values, []
    text = (
        f"channel '{name}': the raw {bits}-bit integer wraps around {_times(jumps.size)}, first at "
        f"{time[jumps[0] + 1]:.6g} s"
    )
    if entry.unwrap is None:
        return values, [f"{text}; not repaired ('unwrap: {bits}' in channels.yaml repairs it)"]
    return np.unwrap(values, period=period), [f"{text}; it was unwrapped"]


def _bits(values: Column, kind: str) -> int:
    """Return the width of the raw integers: known from the log, or 16 if they look like it."""
    code = kind.lstrip("<>=|")
    if code[:1] in {"i", "u"}:
        return 8 * int(code[1:]) if int(code[1:]) < 8 else 0
    if code and code[0] == "f":
        return 0
    finite = values[np.isfinite(values)]
    if not finite.size or np.any(finite != np.round(finite)):
        return 0
    low, high = float(finite.min()), float(finite.max())
    inside = low >= -32768 and high <= 65535 and high - low <= 65535
    return 16 if inside and high - low > 49152 else 0
