"""Reads a foreign log by its channel map."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.recording import RESAMPLED, Recording
from eha_bench.core.sensor import Sensor
from eha_bench.recordings import sample
from eha_bench.recordings.align import Aligned, align
from eha_bench.recordings.channel_map import ChannelMap, Clock
from eha_bench.recordings.computed import with_computed
from eha_bench.recordings.encodings.decoder import READ_ENCODINGS
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.naming import among, printable
from eha_bench.recordings.series import (
    nan_note,
    rounding_note,
    seconds,
    seconds_in_place,
    unwrapped_track,
)
from eha_bench.recordings.shared_memory import SharedMemory
from eha_bench.recordings.source import Source, TimeSpan, Topic, TopicRequest
from eha_bench.recordings.tables.table import TableSource
from eha_bench.recordings.track import Column, Stamps, Track, beyond_range, freeze

_SECOND = 1_000_000_000


def read_mapped(
    source: Source, mapping: ChannelMap, span: TimeSpan, *, described_itself: bool = False
) -> Recording:
    """Return a source's channels as the map says.

    `described_itself` says that the map is the source's own.

    Raises:
        RecordingError: as `read`.
    """
    computed, read = mapping.computed, _read(source, mapping, span)
    aligned = align(read.mapping, read.tracks, read.keys, source.path)
    epoch = int(aligned.stamps[0]) if read.zero is None else read.zero
    exact = None
    if isinstance(source, TableSource):
        epoch = _table_epoch(source, epoch, described_itself=described_itself)
        exact = _exact(source, read.tracks, aligned.stamps, epoch)
    recording = _recording(source, read, aligned, epoch, exact)
    if span.bounded:
        recording = _within(recording, span, source.path)
    where = Place(file=source.path)
    return with_computed(recording, computed, where) if computed else recording


def read_topics(source: Source, mapping: ChannelMap) -> tuple[Recording, ...]:
    """Return a source's channels at their own stamps: a recording for each topic, zero in common.

    Topics that tick together are one recording, and so is all of a map that computes channels,
    which takes values of the same instants.

    Raises:
        RecordingError: as `read`.
    """
    whole = TimeSpan()
    if mapping.computed:
        return (read_mapped(source, mapping, whole),)
    read = _read(source, mapping, whole)
    together: list[list[str]] = []
    for topic, track in read.tracks.items():
        for group in together:
            if np.array_equal(track.stamps, read.tracks[group[0]].stamps):
                group.append(topic)
                break
        else:
            together.append([topic])
    if len(together) == 1:
        return (read_mapped(source, mapping, whole),)
    parts = []
    for number, group in enumerate(together):
        keys = {name: key for name, key in read.keys.items() if key[0] in group}
        channels = {name: read.mapping.channels[name] for name in keys}
        base = read.mapping.base if read.mapping.base in channels else None
        own = read.mapping.model_copy(update={"channels": channels, "base": base})
        tracks = {topic: read.tracks[topic] for topic in group}
        parts.append(replace(read, mapping=own, keys=keys, tracks=tracks))
        if number:
            parts[-1] = replace(parts[-1], notes=[])
    aligned = [align(part.mapping, part.tracks, part.keys, source.path) for part in parts]
    epoch = min(int(item.stamps[0]) for item in aligned)
    return tuple(
        _recording(source, part, item, epoch) for part, item in zip(parts, aligned, strict=True)
    )


@dataclass(frozen=True)
class _SourceRead:
    """What was read of a source, before it meets a clock.

    Attributes:
        mapping: of what the source holds. tracks: by topic. keys: channel -> (topic, column).
        zero: stamp of time zero where only a span is read. notes: one sentence each.
        sensors: how good they are, by channel.
    """

    mapping: ChannelMap
    tracks: Mapping[str, Track]
    keys: Mapping[str, tuple[str, str]]
    zero: int | None
    notes: list[str]
    sensors: Mapping[str, Sensor]


def _read(source: Source, mapping: ChannelMap, span: TimeSpan) -> _SourceRead:
    strangers = mapping.strangers()
    sensors = {name: mapping.sensor(name) for name in mapping.channels}
    mapping = mapping.read
    with _saying_what_is_torn(source):
        if isinstance(source, TableSource):
            mapping = source.in_columns(mapping)
        mapping, left_out = _of_kind(source, mapping)
        keys, wanted = _keys_and_requests(source, mapping)
        tracks, zero = _tracks(source, mapping, wanted, span)
    _refuse_lost(source, tracks)
    beyond: list[str] = []
    if not isinstance(source, TableSource) and mapping.clock is not Clock.HEADER:
        found = (beyond_range(topic, track.stamps) for topic, track in tracks.items())
        beyond = [note for note in found if note]
    notes = [*source.notes, *source.skipped_notes(), *beyond, *strangers, *left_out]
    return _SourceRead(mapping, tracks, keys, zero, notes, sensors)


def _recording(
    source: Source,
    read: _SourceRead,
    aligned: Aligned,
    epoch: int,
    exact: FloatArray | None = None,
) -> Recording:
    """Return channels on one clock in SI."""
    time = _time(aligned.stamps, epoch) if exact is None else exact
    notes = [*read.notes, *aligned.notes]
    values: dict[str, Column] = {}
    memory = SharedMemory(aligned.columns)
    for name, entry in read.mapping.channels.items():
        topic, column = read.keys[name]
        raw = aligned.columns.pop(name)
        shared = memory.leave(name)
        kind = read.tracks[topic].kinds.get(column, "")
        notes += rounding_note(name, raw, kind)
        plain, found = unwrapped_track(name, raw, kind, entry, time)
        notes += found
        if shared and np.may_share_memory(plain, raw):
            plain = plain.copy()
        factor, offset = read.mapping.to_si(name)
        values[name] = _affine(_affine(plain, entry.scale, entry.offset), factor, offset)
        notes += nan_note(name, values[name], time)
    for array in (time, *values.values()):
        freeze(array)
    return Recording(
        time,
        values,
        {name: read.mapping.si_unit(name) for name in values},
        epoch_ns=epoch,
        metadata=_metadata(source) | _of_sensors(read.sensors) | _of_clock(read, aligned),
        attachments=source.attachments(),
        notes=tuple(notes),
        source=source.path,
        damaged=source.damaged_attachments(),
        origin=source.origin,
    )


def _of_clock(read: _SourceRead, aligned: Aligned) -> dict[str, str]:
    """Return which channels were resampled, as metadata; `time` where a rate made the clock."""
    found = {*aligned.resampled, *(["time"] if read.mapping.sample_rate is not None else [])}
    return {RESAMPLED: json.dumps(sorted(found), ensure_ascii=False)} if found else {}


def _within(recording: Recording, span: TimeSpan, path: str) -> Recording:
    """Return the part of a recording in a span, in the same memory."""
    kept = slice(*np.searchsorted(recording.time, (span.start, span.stop)))
    time = recording.time[kept]
    if not time.size:
        raise RecordingError(f"it has no samples from {span}", where=Place(file=path))
    values = {name: array[kept] for name, array in recording.values.items()}
    return replace(recording, time=time, values=values)


def _of_sensors(sensors: Mapping[str, Sensor]) -> dict[str, str]:
    """Return how good the sensors are, as metadata."""
    found: dict[str, str] = {}
    for name, sensor in sensors.items():
        found |= sensor.to_metadata(name)
    return found


def _table_epoch(source: TableSource, first: int, *, described_itself: bool) -> int:
    """Return time zero in ns: of a table's first sample, but for one that has its zero elsewhere.

    A time that starts below zero has its zero at an event; one that we wrote keeps what it had.
    """
    if source.own_epoch is not None:
        return source.own_epoch
    if first < 0 or (described_itself and first < _SECOND):
        return 0
    return first


def _exact(
    source: TableSource, tracks: Mapping[str, Track], stamps: Stamps, epoch: int
) -> FloatArray | None:
    """Return the times as they stand in the table, if nothing was done to them; None otherwise."""
    group = next(iter(tracks))
    seconds = source.exact_seconds.get(group)
    if seconds is None or len(tracks) > 1 or seconds.size != stamps.size:
        return None
    steps = (seconds - seconds[0]) * 1e9 - (stamps - stamps[0])
    if not np.all(np.abs(steps) <= 1.0):
        return None  # samples were sorted or left out
    kept = epoch in (0, source.own_epoch)
    return seconds.copy() if kept else seconds - seconds[0]


@contextmanager
def _saying_what_is_torn(source: Source) -> Iterator[None]:
    """Let an error about a damaged source say so: what it lacks may have been behind the damage."""
    try:
        yield
    except RecordingError as error:
        if type(error) is not RecordingError or not source.damaged:
            raise
        unsaid = [
            note for note in source.notes if error.what not in note and note not in error.what
        ]
        if not unsaid:
            raise
        raise RecordingError(
            f"{error.what}; {unsaid[0]}", where=error.where, hint=error.hint
        ) from error


def _refuse_lost(source: Source, tracks: Mapping[str, Track]) -> None:
    """Refuse a topic of which damage left nothing; one that never had messages is reported later.

    Raises:
        RecordingError: there is such a topic.
    """
    for topic, track in tracks.items():
        if not len(track) and source.damaged and source.notes:
            raise RecordingError(
                f"no message of the topic can be read: {source.notes[0]}",
                where=Place(file=source.path, topic=printable([topic])),
                hint="record it again, or see 'eha-bench info' for all that is wrong with it",
            )


def _of_kind(source: Source, mapping: ChannelMap) -> tuple[ChannelMap, list[str]]:
    """Return what of the map a source may hold, and a note on the channels of another log.

    Raises:
        RecordingError: it is all for the other kind of log.
    """
    tables = isinstance(source, TableSource)
    others = mapping.of_kind(tables=not tables)
    if not others:
        return mapping, []
    if len(others) == len(mapping.channels):
        raise RecordingError(
            "the channel map names topics, but the recording is a table with columns"
            if tables
            else "the channel map names columns, but the recording has topics",
            where=Place(file=source.path),
            hint="use topic and field for logs, column for CSV, Parquet and MAT",
        )
    kinds = "topics of a log, and this is a table" if tables else "columns, and this is not a table"
    names = ", ".join(others)
    return mapping.part(tables=tables), [f"the channel map has {names} from {kinds}: left out"]


def _tracks(
    source: Source, mapping: ChannelMap, wanted: Mapping[str, TopicRequest], span: TimeSpan
) -> tuple[dict[str, Track], int | None]:
    """Return the tracks, and the stamp of time zero where only a span is read."""
    if isinstance(source, TableSource):
        columns = tuple(entry.column or "" for entry in mapping.channels.values())
        return source.table(mapping, columns), None
    if not span.bounded:
        return source.tracks(wanted), None
    zero = None
    if all(what.clock is Clock.LOG for what in wanted.values()):
        zero = source.first_stamp(wanted)
    tracks = source.tracks(wanted, span.after(zero) if zero is not None else None)
    if zero is None:
        firsts = [int(track.stamps[0]) for track in tracks.values() if len(track)]
        zero = min(firsts, default=None)
    return tracks, zero


def _time(stamps: Stamps, epoch: int) -> FloatArray:
    """Return stamps in s; they are not needed afterwards, so their memory is used again."""
    if stamps.base is not None or not stamps.flags.writeable:
        return seconds(stamps, epoch)
    time = seconds_in_place(stamps, epoch)
    stamps.setflags(write=False)
    return time


def _affine(values: Column, factor: float, offset: float) -> Column:
    """Scale in place; a log of hours needs no second copy."""
    if factor == 1.0 and offset == 0.0:
        return values
    with np.errstate(over="ignore"):  # what is too large becomes infinite, which is noted
        values *= factor
        if offset:
            values += offset
    return values


def _keys_and_requests(
    source: Source, mapping: ChannelMap
) -> tuple[dict[str, tuple[str, str]], dict[str, TopicRequest]]:
    """Return channel -> (topic, column), and what to read of each topic."""
    topics = {topic.name: topic for topic in source.topics()}
    keys: dict[str, tuple[str, str]] = {}
    fields: dict[str, dict[str, FieldPath]] = {}
    clocks: dict[str, Clock] = {}
    for name, entry in mapping.channels.items():
        if entry.topic is None or entry.field is None:
            column = entry.column or ""
            group = source.group_of(column) if isinstance(source, TableSource) else source.path
            keys[name] = (group, column)
            continue
        topic = topics.get(entry.topic)
        if topic is None or topic.skipped:
            raise _missing_topic(source, name, entry.topic, topics)
        path = FieldPath.parse(entry.field)
        keys[name] = (entry.topic, str(path))
        fields.setdefault(entry.topic, {})[str(path)] = path
        clock = entry.clock or mapping.clock
        if clocks.setdefault(entry.topic, clock) is not clock:
            raise RecordingError(
                f"channel '{name}' asks for clock {clock.value}, another channel of the same topic "
                f"for {clocks[entry.topic].value}",
                where=Place(file=source.path, topic=entry.topic),
                hint="give a topic one clock",
            )
    return keys, {
        topic: TopicRequest(tuple(paths.values()), clocks[topic]) for topic, paths in fields.items()
    }


def _missing_topic(
    source: Source, channel: str, topic: str, topics: Mapping[str, Topic]
) -> RecordingError:
    found = topics.get(topic)
    if found is not None:
        return RecordingError(
            f"channel '{channel}' cannot be read: {found.skipped}",
            where=Place(file=source.path, topic=topic),
            hint="map another topic in channels.yaml",
        )
    return RecordingError(
        f"the topic of channel '{channel}' is not in the recording",
        where=Place(file=source.path, topic=topic),
        hint=among(topic, topics, "topics"),
    )


def _metadata(source: Source) -> dict[str, str]:
    """Metadata of a foreign log; keys carry the record's name where there are several."""
    records = source.metadata()
    if sample.is_own(records):
        return dict(records.get(sample.METADATA, {}))
    return {
        (f"{name}.{key}" if len(records) > 1 else key): value
        for name, record in records.items()
        for key, value in record.items()
    }


def unmapped_error(source: Source) -> RecordingError:
    """Return the error for a log without a channel map."""
    topics = source.topics()
    for topic in topics:
        encoding = topic.encoded.encoding if topic.encoded else ""
        if topic.encoded and encoding not in READ_ENCODINGS:
            return RecordingError(
                f"its messages are serialized as '{printable([encoding])}', which is not read",
                where=Place(file=source.path, topic=printable([topic.name])),
                hint=f"only {', '.join(READ_ENCODINGS)} are read",
            )
    if not topics:
        return RecordingError(
            "the recording is empty: it has no topics",
            where=Place(file=source.path),
            hint="record it again, or give another file",
        )
    return RecordingError(
        "this recording was not written by eha-bench, and no channel map says what it holds",
        where=Place(file=source.path),
        hint=f"give a channels.yaml that maps its topics: {printable(t.name for t in topics)}",
    )
