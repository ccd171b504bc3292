"""Carries topics of different rates onto one clock, and says how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.note import Note
from eha_bench.recordings.channel_map import ChannelMap, Gaps, Method, TimeRange
from eha_bench.recordings.series import (
    BRIDGED,
    gap_note,
    gaps,
    irregularity,
    ordered_track,
    seconds,
    typical_step,
)
from eha_bench.recordings.track import Column, Stamps, Track

_SLOWER = 0.75
_SAME_TICK = 0.05
"""A command stamped this share of a period after a tick still belongs to that tick."""


@dataclass(frozen=True)
class Aligned:
    """Channels on one clock, still in raw units.

    Attributes:
        stamps: (n,) nanoseconds.
        columns: channel -> (n,) raw values; NaN where its topic had no samples.
        notes: how it was done.
        resampled: channels that were carried from a clock of their own.
    """

    stamps: Stamps
    columns: dict[str, Column]
    notes: list[str]
    resampled: frozenset[str] = frozenset()


def align(
    mapping: ChannelMap, tracks: Mapping[str, Track], keys: Mapping[str, tuple[str, str]], path: str
) -> Aligned:
    """Return all channels on the clock of the base topic.

    Args:
        mapping: the channel map.
        tracks: samples by topic.
        keys: channel -> (topic, column of its track).
        path: the recording, for messages.

    Raises:
        RecordingError: a topic is empty, its stamps do not increase, or no time is common to all.
    """
    notes: list[str] = []
    clean: dict[str, Track] = {}
    for topic in dict.fromkeys(topic for topic, _ in keys.values()):
        where = Place(file=path, topic="" if topic == path else topic)
        if not len(tracks[topic]):
            raise RecordingError(
                "the topic has no messages", where=where, hint="map another topic in channels.yaml"
            )
        clean[topic], found = ordered_track(tracks[topic], mapping.repair, where)
        notes += found
    base = _base(mapping, clean, keys)
    stamps, cut = _clock(mapping, clean, keys, base, path)
    notes += cut
    epoch = int(stamps[0])
    notes += gap_note("time" if base == path else f"topic '{base}'", stamps, epoch)
    columns: dict[str, Column] = {}
    resampled: set[str] = set()
    for topic, track in clean.items():
        names = [name for name, (owner, _) in keys.items() if owner == topic]
        rows = _same_ticks(track.stamps, stamps)
        if rows is not None:
            for name in names:
                columns[name] = track.columns[keys[name][1]][rows]
            continue
        resampled.update(names)
        notes += _method_notes(mapping, topic, track, names, base, stamps)
        if any(mapping.method(name) is Method.LINEAR for name in names):
            notes += gap_note(f"topic '{topic}'", track.stamps, epoch)
        for name in names:
            column = track.columns[keys[name][1]]
            resample = _hold if mapping.method(name) is Method.HOLD else _linear
            columns[name] = resample(track.stamps, column, stamps, mapping.repair.gaps)
    return Aligned(stamps, {name: columns[name] for name in keys}, notes, frozenset(resampled))


def _base(
    mapping: ChannelMap, tracks: Mapping[str, Track], keys: Mapping[str, tuple[str, str]]
) -> str:
    """Return the topic whose ticks are the common clock: asked for, or with the most numbers.

    Numbers are samples times channels, so that the least is lost or made up. Among equals the more
    regular topic wins, then the first; one that holds only commands is taken last.
    """
    if mapping.base is not None:
        return keys[mapping.base][0]

    def rank(topic: str) -> tuple[bool, int, float]:
        names = [name for name, (owner, _) in keys.items() if owner == topic]
        measured = any(mapping.method(name) is Method.LINEAR for name in names)
        numbers = len(names) * len(tracks[topic])
        return measured, numbers, -irregularity(tracks[topic].stamps)

    return max(tracks, key=rank)


def _clock(
    mapping: ChannelMap,
    tracks: Mapping[str, Track],
    keys: Mapping[str, tuple[str, str]],
    base: str,
    path: str,
) -> tuple[Stamps, list[str]]:
    """Return the base topic's stamps in the range that all topics cover."""
    stamps = tracks[base].stamps
    if mapping.range is TimeRange.ALL:
        return stamps, []
    begin, end = int(stamps[0]), int(stamps[-1])
    period = typical_step(stamps) if stamps.size > 1 else 0.0
    first, last = base, base
    for topic, track in tracks.items():
        names = [name for name, (owner, _) in keys.items() if owner == topic]
        held = all(mapping.method(name) is Method.HOLD for name in names)
        slack = int(_SAME_TICK * period) if held else 0
        if track.stamps[0] - slack > begin:
            begin, first = int(track.stamps[0]) - slack, topic
        # a command holds after its last message; a measurement does not
        if not held and track.stamps[-1] < end:
            end, last = int(track.stamps[-1]), topic
    # a slice, not a mask: the whole clock stays the same array
    kept = stamps[np.searchsorted(stamps, begin) : np.searchsorted(stamps, end, side="right")]
    kept = stamps if kept.size == stamps.size else kept
    if not kept.size:
        raise RecordingError(
            f"topics '{first}' and '{last}' have no time in common",
            where=Place(file=path),
            hint="check the clock in channels.yaml, or say 'range: all' to keep all with NaN",
        )
    notes = []
    if kept.size < stamps.size:
        early = (int(kept[0]) - int(stamps[0])) / 1e9
        late = (int(stamps[-1]) - int(kept[-1])) / 1e9
        cuts = [f"{early:.6g} s at the start (topic '{first}' starts later)"] if early else []
        cuts += [f"{late:.6g} s at the end (topic '{last}' ends earlier)"] if late else []
        notes.append(
            f"cut to the time that all topics cover: {' and '.join(cuts)}; "
            "'range: all' keeps it with NaN"
        )
    return kept, notes


def _same_ticks(own: Stamps, stamps: Stamps) -> slice | None:
    """Return which of a topic's samples are those of the clock, None if it ticks otherwise."""
    if own is stamps:
        return slice(None)
    start = int(np.searchsorted(own, stamps[0]))
    place = slice(start, start + stamps.size)
    return place if np.array_equal(own[place], stamps) else None


def _method_notes(
    mapping: ChannelMap, topic: str, track: Track, names: list[str], base: str, stamps: Stamps
) -> list[str]:
    how = {Method.LINEAR: "interpolated linearly", Method.HOLD: "held until the next message"}
    step = typical_step(track.stamps) / 1e9
    notes: list[str] = []
    for method, text in how.items():
        affected = [name for name in names if mapping.method(name) is method]
        if affected:
            notes.append(
                Note(
                    "topic '{topic}' (every {step:.6g} s) was carried onto the clock of '{base}': "
                    "{channels} {how}",
                    topic=topic,
                    step=step,
                    base=base,
                    channels=", ".join(affected),
                    how=text,
                )
            )
    if step * 1e9 < _SLOWER * typical_step(stamps):
        notes.append(
            f"topic '{topic}' ticks faster than the clock of '{base}', so that samples of it were "
            f"left out; 'base: {names[0]}' keeps them"
        )
    return notes


def _linear(own: Stamps, values: Column, stamps: Stamps, policy: Gaps) -> Column:
    """Interpolate; NaN outside of the samples and, by default, inside long gaps."""
    epoch = int(own[0])
    result = np.interp(
        seconds(stamps, epoch), seconds(own, epoch), values, left=np.nan, right=np.nan
    )
    # where stamps agree there is nothing to interpolate: keep the sample bit for bit
    place = np.searchsorted(own, stamps)
    inside = place < own.size
    exact = np.zeros(stamps.size, dtype=bool)
    exact[inside] = own[place[inside]] == stamps[inside]
    result[exact] = values[place[exact]]
    if policy is Gaps.NAN:
        found = gaps(own)
        long = found.starts[found.lengths > BRIDGED * found.period]
        before = np.clip(place - 1, 0, own.size - 1)
        result[np.isin(before, long) & ~exact] = np.nan
    return result


def _hold(own: Stamps, values: Column, stamps: Stamps, policy: Gaps) -> Column:
    """Keep each command until the next one; NaN before the first."""
    del policy
    period = typical_step(stamps) if stamps.size > 1 else 0.0
    late = stamps + np.int64(_SAME_TICK * period)
    place = np.searchsorted(own, late, side="right") - 1
    result: FloatArray = np.where(place >= 0, values[np.maximum(place, 0)], np.nan)
    return result
