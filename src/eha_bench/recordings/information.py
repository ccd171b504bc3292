"""`info`: what a recording holds, and how healthy it is, without a channel map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.errors import RecordingError
from eha_bench.recordings import sample
from eha_bench.recordings.budget import OutOfTime, budget, spending
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import READ_ENCODINGS, UnreadableTopic
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.number_fields import number_fields, unnamed_keys
from eha_bench.recordings.opening import open_source
from eha_bench.recordings.series import gaps, irregularity, typical_step
from eha_bench.recordings.source import Source, Topic, TopicRequest
from eha_bench.recordings.tables.self_description import named_unit
from eha_bench.recordings.tables.table import TableSource
from eha_bench.recordings.track import Stamps, beyond_range
from eha_bench.recordings.values import ValueInformation

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class TopicInformation:
    """One topic, or one column of a table.

    Attributes:
        name: topic or column.
        type: message type, or the column's NumPy type.
        encoding: `cdr`, `ros1`, `json`, ...; empty for a column.
        count: number of messages or rows.
        rate: messages per second by the median interval; NaN if there are fewer than two.
        jitter: standard deviation of the intervals over their mean; NaN if there are fewer.
        gaps: intervals longer than 1.5 median intervals.
        longest_gap: s, 0 if there is none.
        steps_back: how often the stamps step back in time.
        duplicates: how many stamps repeat the one before.
        first, last: s after the recording's start; NaN without messages.
        readable: empty, or why it cannot be read.
        values: of its numbers, as far as they were looked at.
        group: of a column, what it shares its clock with; empty where the file has one for all.
    """

    name: str
    type: str
    encoding: str
    count: int
    rate: float = float("nan")
    jitter: float = float("nan")
    gaps: int = 0
    longest_gap: float = 0.0
    steps_back: int = 0
    duplicates: int = 0
    first: float = float("nan")
    last: float = float("nan")
    readable: str = ""
    values: tuple[ValueInformation, ...] = ()
    group: str = ""


@dataclass(frozen=True)
class RecordingInformation:
    """What a recording holds.

    Attributes:
        path: the file or folder.
        format: `mcap`, `rosbag1`, `rosbag2`, `sqlite3`, `csv`, `parquet`, `mat`,
            `hdf5`, `mdf`, `tdms`, `ulog`, `json`, `jsonl`.
        own: whether eha-bench wrote it, so that it needs no channel map.
        size: bytes.
        start_ns: first message, ns since 1970 (0 for a table).
        duration: s from the first to the last message.
        topics: topics or columns.
        channels: channel -> unit, of our own recordings.
        metadata: text by record and key.
        attachments: size in bytes by name.
        health: `good`, or `damaged` if something is lost.
        notes: what was found, one sentence each.
        unseen: topics or columns whose values were not looked at, since there are too many.
        schema_version: version of this description.
    """

    path: str
    format: str
    own: bool
    size: int
    start_ns: int
    duration: float
    topics: tuple[TopicInformation, ...]
    channels: Mapping[str, str]
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Mapping[str, int]
    health: str
    notes: tuple[str, ...]
    unseen: int = 0
    schema_version: int = SCHEMA_VERSION

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain data for JSON; NaN becomes None."""
        return {key: _plain(value) for key, value in asdict(self).items()}


_MOST_VISITS = 4_000_000
"""Topics whose values are looked at, times topics of the file: each look goes through all."""
_MOST_NOTED = 100
"""Topics whose keys are looked at: one with strange keys is rarely alone."""
_MOST_COLUMNS = 10_000
"""Columns of a table whose values are looked at."""


def info(path: str | Path) -> RecordingInformation:
    """Return what a recording holds: topics, types, rates, gaps, metadata, health.

    Raises:
        RecordingError: missing, empty, or no recording.
    """
    with spending(Path(path)):
        return _information_of(Path(path))


def _information_of(file: Path) -> RecordingInformation:
    source = open_source(file)
    if isinstance(source, TableSource):
        return _of_table(file, source)
    topics = source.topics()
    tracks = source.tracks({topic.name: TopicRequest((), Clock.LOG) for topic in topics})
    own = sample.is_own(source.metadata())
    stamps = {name: track.stamps for name, track in tracks.items()}
    filled = [topic for topic in topics if stamps[topic.name].size]
    values: dict[str, tuple[ValueInformation, ...]] = {}
    late: tuple[str, ...] = ()
    for topic in filled[: max(1, _MOST_VISITS // max(len(topics), 1))]:
        try:
            values[topic.name] = _values_of(source, topic, own=own)
        except OutOfTime as error:
            late = (error.what,)
            break
    unseen = len(filled) - len(values)
    start = min((int(times.min()) for times in stamps.values() if times.size), default=0)
    end = max((int(times.max()) for times in stamps.values() if times.size), default=start)
    records = source.metadata()
    problem = _description_problem(source, records)
    beyond = [note for name, times in stamps.items() if (note := beyond_range(name, times))]
    notes = (
        *source.notes,
        *beyond,
        *source.skipped_notes(),
        *_unnamed_notes(source, filled),
        *([problem] if problem else []),
        *late,
        *([f"the values of {unseen} of {len(topics)} topics were not read"] * bool(unseen)),
    )
    return RecordingInformation(
        path=str(file),
        format=source.format,
        own=own,
        size=_size(file),
        start_ns=start,
        duration=(end - start) / 1e9,
        topics=tuple(
            replace(_of_topic(topic, stamps[topic.name], start), values=values.get(topic.name, ()))
            for topic in topics
        ),
        channels=dict(records.get(sample.UNITS, {})),
        metadata={name: dict(record) for name, record in records.items()},
        attachments={name: len(data) for name, data in source.attachments().items()},
        health="damaged" if source.damaged or problem or beyond else "good",
        notes=notes,
        unseen=unseen,
    )


def _values_of(source: Source, topic: Topic, *, own: bool) -> tuple[ValueInformation, ...]:
    """Look at all numbers of a topic; at none where decoding fails, which is reported later."""
    if topic.encoded is None or topic.skipped:
        return ()
    records = source.metadata()
    names = records.get(sample.FIELDS, {}) if own and topic.name == sample.TOPIC else {}
    units = records.get(sample.UNITS, {}) if names else {}
    try:
        fields = tuple(names) or number_fields(topic.encoded, source.example(topic.name))
        paths = tuple(FieldPath.parse(field) for field in fields)
        track = source.tracks({topic.name: TopicRequest(paths, Clock.LOG)})[topic.name]
    except OutOfTime:
        raise
    except (UnreadableTopic, RecordingError, ValueError):
        return ()
    return tuple(
        ValueInformation.of(names.get(field, field), units.get(names.get(field, ""), ""), column)
        for field, column in track.columns.items()
    )


def _unnamed_notes(source: Source, topics: Sequence[Topic]) -> Iterator[str]:
    """Say which values of JSON messages no field path can name, so that none is missed."""
    for topic in topics[:_MOST_NOTED]:
        if topic.encoded is None or topic.skipped or topic.encoded.encoding != "json":
            continue
        keys = unnamed_keys(topic.encoded, source.example(topic.name))
        if keys:
            shown = ", ".join(f"'{key[:40]}'" for key in keys[:5])
            yield (
                f"{topic.name}: what stands under {shown} cannot be read, as a field path has "
                "letters, digits and _ only"
            )


def _description_problem(source: Source, records: Mapping[str, Mapping[str, str]]) -> str:
    if not sample.is_own(records):
        return ""
    own = next((topic.encoded for topic in source.topics() if topic.name == sample.TOPIC), None)
    return sample.description_problem(records, own.schema) if own else ""


def _of_topic(topic: Topic, stamps: Stamps, start: int) -> TopicInformation:
    encoded = topic.encoded
    encoding = encoded.encoding if encoded else ""
    readable = topic.skipped
    if not readable and encoding not in READ_ENCODINGS:
        readable = f"its messages are serialized as '{encoding}'"
    described = TopicInformation(
        name=topic.name,
        type=encoded.schema_name if encoded else "",
        encoding=encoding,
        count=int(stamps.size),
        readable=readable,
    )
    if not stamps.size:
        return described
    steps = np.diff(stamps)
    ordered = stamps if (steps > 0).all() else np.unique(stamps)
    found = gaps(ordered)
    step = typical_step(ordered) / 1e9
    return replace(
        described,
        rate=1.0 / step if step > 0 else float("nan"),
        jitter=irregularity(ordered) if ordered.size > 1 else float("nan"),
        gaps=int(found.starts.size),
        longest_gap=float(found.lengths.max(initial=0.0)),
        steps_back=int(np.count_nonzero(steps < 0)),
        duplicates=int(np.count_nonzero(steps == 0)),
        first=(int(stamps[0]) - start) / 1e9,
        last=(int(stamps[-1]) - start) / 1e9,
    )


def _of_table(file: Path, source: TableSource) -> RecordingInformation:
    columns = []
    units, names = source.units(), source.names()
    late: tuple[str, ...] = ()
    for name in names[:_MOST_COLUMNS]:
        try:
            budget().tick()
            column = source.column(name)
            unit = units.get(name) or named_unit(name)[1] or ""
            looked_at = column if column.ndim == 1 else np.empty(0)
            columns.append(
                TopicInformation(
                    name,
                    str(column.dtype),
                    "",
                    int(column.shape[0]),
                    values=(ValueInformation.of(name, unit, looked_at),),
                    group=_group_of(source, name),
                )
            )
        except OutOfTime as error:
            late = (error.what,)
            break
        except RecordingError as error:
            columns.append(TopicInformation(name, "", "", 0, readable=error.what))
    unseen = len(names) - len(columns)
    return RecordingInformation(
        path=str(file),
        format=source.format,
        own=False,
        size=_size(file),
        start_ns=0,
        duration=float("nan"),
        topics=tuple(columns),
        channels={},
        metadata=source.metadata(),
        attachments={},
        health="damaged" if source.damaged else "good",
        notes=(
            *source.notes,
            *late,
            *([f"{unseen} of its {len(names)} columns were not looked at"] * (unseen > 0)),
        ),
        unseen=unseen,
    )


def _group_of(source: TableSource, name: str) -> str:
    group = source.group_of(name)
    return "" if group == source.path else group


def _size(path: Path) -> int:
    if path.is_dir():
        return sum(inner.stat().st_size for inner in path.iterdir() if inner.is_file())
    return path.stat().st_size


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value
