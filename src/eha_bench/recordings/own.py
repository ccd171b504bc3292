"""Reads eha_bench's own recordings: what the fields are stands in the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings import sample
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.series import nan_note
from eha_bench.recordings.source import Source, TimeSpan, TopicRequest
from eha_bench.recordings.track import freeze


def read_own(source: Source, span: TimeSpan) -> Recording:
    """Return a recording as it was written.

    Raises:
        RecordingError: it is of a later version, it has no samples, or it is damaged.
    """
    where = Place(file=source.path)
    parts = [part for part in source.parts if sample.is_own(part.metadata())]
    if len(parts) > 1:
        names = ", ".join(Path(part.path).name for part in parts)
        raise RecordingError(
            f"the folder holds {len(parts)} recordings of eha-bench ({names})",
            where=where,
            hint="give one of them",
        )
    records = source.metadata()
    version = records[sample.FORMAT].get("version", "")
    if version != sample.VERSION:
        raise RecordingError(
            f"it is written in version {version[:20]} of the format, known is {sample.VERSION}",
            where=where,
            hint="update eha-bench",
        )
    fields = records[sample.FIELDS]
    units = records.get(sample.UNITS, {})
    try:
        epoch_ns = int(records[sample.FORMAT].get("epoch_ns", "0"))
        paths = tuple(FieldPath.parse(field) for field in (sample.TIME, *fields))
    except ValueError as error:
        raise RecordingError(f"its metadata is damaged ({error})", where=where) from error
    if sample.TOPIC not in {topic.name for topic in source.topics()}:
        raise RecordingError(
            f"the recording is empty: it has no topic {sample.TOPIC}",
            where=where,
            hint="run the trial again",
        )
    needed = span.after(epoch_ns) if span.bounded and epoch_ns > 0 else None
    track = source.tracks({sample.TOPIC: TopicRequest(paths, None)}, needed)[sample.TOPIC]
    if not track.columns[sample.TIME].size:
        raise RecordingError(
            "the recording is empty: it has no samples", where=where, hint="run the trial again"
        )
    notes = records.get(sample.NOTES, {})
    definition = next(topic.encoded for topic in source.topics() if topic.name == sample.TOPIC)
    problem = sample.description_problem(records, definition.schema if definition else b"")
    time = track.columns.pop(sample.TIME)
    values = {name: track.columns.pop(field) for field, name in fields.items()}
    if span.bounded:
        kept = slice(*np.searchsorted(time, (span.start, span.stop)))
        time = time[kept]
        values = {name: column[kept] for name, column in values.items()}
        if not time.size:
            raise RecordingError(f"it has no samples from {span}", where=where)
    found = [*source.notes, *([problem] if problem else [])]
    for name, column in values.items():
        found += nan_note(name, column, time)
        freeze(column)
    freeze(time)
    earlier = tuple(notes[key] for key in sorted(notes, key=lambda key: (len(key), key)))
    return Recording(
        time,
        values,
        {name: units.get(name, "") for name in values},
        epoch_ns=epoch_ns,
        metadata=records.get(sample.METADATA, {}),
        attachments=source.attachments(),
        notes=(*earlier, *(note for note in found if note not in earlier)),
        source=source.path,
        damaged=source.damaged_attachments(),
        origin=source.origin,
    )
