"""`read`: any recording, whatever its format, as a `Recording`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eha_bench.core.errors import MissingChannelError, Place, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings import sample
from eha_bench.recordings.align import align
from eha_bench.recordings.channel_map import ChannelMap, Clock, load_channel_map
from eha_bench.recordings.field_path import FieldPath
from eha_bench.recordings.formats import open_source
from eha_bench.recordings.own import read_own
from eha_bench.recordings.series import nan_note, seconds, unwrapped
from eha_bench.recordings.source import Source, Topic, Wanted
from eha_bench.recordings.table import TableSource


def read(
    path: str | Path,
    *,
    channels: str | Path | ChannelMap | Mapping[str, object] | None = None,
) -> Recording:
    """Return a recording in SI on one clock, time zero at its first sample.

    Args:
        path: MCAP, ROS 1 bag, rosbag2 folder or one of its files, CSV, Parquet or MAT v5.
        channels: a `channels.yaml`, or its content; None for eha-bench's own recordings.

    Raises:
        RecordingError: missing, empty, damaged, no recording, or its time does not increase.
        MissingChannelError: a mapped topic or column is not there.
        InputError: the channel map is wrong.
    """
    mapping = load_channel_map(channels) if channels is not None else None
    source = open_source(Path(path))
    if mapping is not None:
        return read_mapped(source, mapping)
    if isinstance(source, TableSource):
        return read_mapped(source, source.own_map())
    if sample.is_own(source.metadata()):
        return read_own(source)
    raise _unmapped(source)


def read_mapped(source: Source, mapping: ChannelMap) -> Recording:
    """Return a source's channels as the map says."""
    where = Place(file=source.path)
    if isinstance(source, TableSource) != mapping.is_table:
        raise RecordingError(
            "the channel map names columns, but the recording has topics"
            if mapping.is_table
            else "the channel map names topics, but the recording is a table with columns",
            where=where,
            hint="use topic and field for logs, column for CSV, Parquet and MAT",
        )
    keys, wanted = _wanted(source, mapping)
    if isinstance(source, TableSource):
        tracks = source.table(
            mapping, tuple(entry.column or "" for entry in mapping.channels.values())
        )
    else:
        tracks = source.tracks(wanted)
    aligned = align(mapping, tracks, keys, source.path)
    stamps = aligned.stamps
    epoch = int(stamps[0])
    if isinstance(source, TableSource) and epoch < 0:
        epoch = 0  # a table's time that starts below zero has its zero at an event: keep it
    time = seconds(stamps, epoch)
    notes = [*source.notes, *_skipped_notes(source), *aligned.notes]
    values = {}
    for name, entry in mapping.channels.items():
        topic, column = keys[name]
        raw = aligned.columns.pop(name)
        kind = tracks[topic].kinds.get(column, "")
        raw, found = unwrapped(name, raw, kind, entry, time)
        notes += found
        factor, offset = mapping.to_si(name)
        values[name] = _affine(_affine(raw, entry.scale, entry.offset), factor, offset)
        notes += nan_note(name, values[name], time)
    return Recording(
        time,
        values,
        {name: mapping.si_unit(name) for name in values},
        epoch_ns=epoch,
        metadata=_foreign_metadata(source),
        attachments=source.attachments(),
        notes=tuple(notes),
        source=source.path,
    )


def _affine(values: np.ndarray, factor: float, offset: float) -> np.ndarray:
    if factor == 1.0 and offset == 0.0:
        return values
    return values * factor + offset if offset else values * factor


def _wanted(
    source: Source, mapping: ChannelMap
) -> tuple[dict[str, tuple[str, str]], dict[str, Wanted]]:
    """Return channel -> (topic, column), and what to read of each topic."""
    topics = {topic.name: topic for topic in source.topics()}
    keys: dict[str, tuple[str, str]] = {}
    fields: dict[str, dict[str, FieldPath]] = {}
    clocks: dict[str, Clock] = {}
    for name, entry in mapping.channels.items():
        if entry.topic is None or entry.field is None:
            keys[name] = (source.path, entry.column or "")
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
        topic: Wanted(tuple(paths.values()), clocks[topic]) for topic, paths in fields.items()
    }


def _missing_topic(
    source: Source, channel: str, topic: str, topics: Mapping[str, Topic]
) -> MissingChannelError | RecordingError:
    found = topics.get(topic)
    if found is not None:
        return RecordingError(
            f"channel '{channel}' cannot be read: {found.skipped}",
            where=Place(file=source.path, topic=topic),
            hint="map another topic in channels.yaml",
        )
    listed = ", ".join(topics) or "none"
    return RecordingError(
        f"the topic of channel '{channel}' is not in the recording",
        where=Place(file=source.path, topic=topic),
        hint=f"its topics are: {listed}",
    )


def _skipped_notes(source: Source) -> list[str]:
    skipped = [topic.name for topic in source.topics() if topic.skipped]
    return [f"skipped topics with service events: {', '.join(skipped)}"] if skipped else []


def _foreign_metadata(source: Source) -> dict[str, str]:
    """Metadata of somebody else's log; keys carry the record's name where there are several."""
    records = source.metadata()
    if sample.is_own(records):
        return dict(records.get(sample.METADATA, {}))
    return {
        (f"{name}.{key}" if len(records) > 1 else key): value
        for name, record in records.items()
        for key, value in record.items()
    }


def _unmapped(source: Source) -> RecordingError:
    topics = source.topics()
    for topic in topics:
        encoding = topic.encoded.encoding if topic.encoded else ""
        if topic.encoded and encoding not in {"cdr", "ros1", "json", "protobuf"}:
            return RecordingError(
                f"its messages are serialized as '{encoding}', which is not read",
                where=Place(file=source.path, topic=topic.name),
                hint="only cdr, ros1, json and protobuf are read",
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
        hint=f"give a channels.yaml that maps its topics: {', '.join(t.name for t in topics)}",
    )
