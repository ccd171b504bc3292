"""An MCAP file as a source of tracks: chunk by chunk, only those that hold a wanted topic."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.decompress import DamagedChunk, decompress, decompress_torn
from eha_bench.recordings.demux import LOG_TIME, PUBLISH_TIME, Split, split
from eha_bench.recordings.mcap_file import (
    Chunk,
    McapFile,
    Stretch,
    add_channel,
    add_schema,
    open_mcap,
)
from eha_bench.recordings.payloads import Payloads
from eha_bench.recordings.source import Source, Topic, Wanted
from eha_bench.recordings.topic_reader import Part, TopicReader, in_order
from eha_bench.recordings.track import Track

_SCHEMA, _CHANNEL = 3, 4


class McapSource(Source):
    """An opened MCAP file."""

    def __init__(self, path: Path) -> None:
        self._file = open_mcap(path)
        self._notes: list[str] = []
        if not self._file.summary_channels:
            self._collect_channels()

    @property
    def path(self) -> str:
        """The file, for messages."""
        return str(self._file.path)

    @property
    def file(self) -> McapFile:
        """The scanned file."""
        return self._file

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far: a tear, damaged chunks, chunks out of order."""
        return tuple(dict.fromkeys((*_tear_note(self._file), *self._notes)))

    def topics(self) -> tuple[Topic, ...]:
        """The topics of the file."""
        found: dict[str, Topic] = {}
        for channel in self._file.channels.values():
            encoded = self._encoded(channel.id)
            skipped = ""
            if channel.topic.endswith("/_service_event") or "/srv/" in encoded.schema_name:
                skipped = "it holds service events"
            found.setdefault(channel.topic, Topic(channel.topic, encoded, None, skipped))
        return tuple(found.values())

    def tracks(self, wanted: Mapping[str, Wanted]) -> dict[str, Track]:
        """Return the samples of the wanted topics, in file order.

        Raises:
            RecordingError: a topic cannot be decoded.
        """
        ids = {c.id: c.topic for c in self._file.channels.values() if c.topic in wanted}
        expected = self._expected(ids)
        readers = {
            topic: TopicReader(topic, what, expected.get(topic, 0))
            for topic, what in wanted.items()
        }
        for part in self._splits(set(ids)):
            groups: dict[str, list[tuple[int, Payloads]]] = {}
            for channel, payloads in part.messages:
                if channel in ids:
                    groups.setdefault(ids[channel], []).append((channel, payloads))
            for topic, members in groups.items():
                self._extend(readers[topic], topic, members)
        return {topic: reader.finish() for topic, reader in readers.items()}

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata by record name; later records of one name add to the earlier ones."""
        found: dict[str, dict[str, str]] = {}
        for record in self._file.metadata:
            found.setdefault(record.name, {}).update(record.metadata)
        return found

    def attachments(self) -> Mapping[str, bytes]:
        """Files inside the recording, by name; a name is only text and never a path."""
        found = {}
        for start, length in self._file.attachments:
            attachment = self._file.attachment(start, length)
            if attachment is not None:
                found[attachment.name] = attachment.data
        return found

    def _encoded(self, channel: int) -> Encoded:
        record = self._file.channels[channel]
        schema = self._file.schemas.get(record.schema_id)
        return Encoded(
            record.message_encoding,
            schema.name if schema else "",
            schema.encoding if schema else "",
            schema.data if schema else b"",
        )

    def _extend(self, reader: TopicReader, topic: str, members: list[tuple[int, Payloads]]) -> None:
        delta = PUBLISH_TIME if reader.clock is Clock.PUBLISH else LOG_TIME
        rows = in_order([payloads for _, payloads in members])
        batch = [
            Part(channel, payloads, where, payloads.column(delta, "<i8"))
            for (channel, payloads), where in zip(members, rows, strict=True)
        ]
        try:
            reader.extend(batch, self._encoded)
        except UnreadableTopic as error:
            raise self.refuse(topic, error) from error

    def _expected(self, ids: Mapping[int, str]) -> dict[str, int]:
        """Count messages by topic as the chunks' indexes have it, to take memory once."""
        expected: dict[str, int] = {}
        for part in self._file.parts:
            if isinstance(part, Chunk):
                for channel, count in (part.channels or {}).items():
                    if channel in ids:
                        expected[ids[channel]] = expected.get(ids[channel], 0) + count
        return expected

    def _splits(self, ids: set[int] | None) -> Iterator[Split]:
        """Yield the records of every part that may hold a wanted channel."""
        for part in self._in_order():
            if not isinstance(part, Chunk):
                yield split(self._file.buffer, part.start, part.stop)
            elif ids is None or part.channels is None or not ids.isdisjoint(part.channels):
                opened = self._open(part)
                if opened is not None:
                    yield opened

    def _open(self, chunk: Chunk) -> Split | None:
        data = self._file.buffer.data[chunk.data_start : chunk.data_start + chunk.data_size]
        if chunk.torn:
            buffer = decompress_torn(data, chunk.compression)
            return split(buffer, 0, buffer.size)
        try:
            buffer = decompress(data, chunk.compression, chunk.uncompressed_size, chunk.crc)
        except DamagedChunk as error:
            self._notes.append(f"the chunk at byte {chunk.offset} is lost: {error}")
            return None
        found = split(buffer, 0, buffer.size)
        if found.end < buffer.size:
            self._notes.append(
                f"the chunk at byte {chunk.offset} holds {buffer.size - found.end} bytes "
                "that are no records"
            )
        return found

    def _in_order(self) -> list[Chunk | Stretch]:
        """Return the parts by time, if chunks were written out of order but do not overlap."""
        parts = self._file.parts
        chunks = [part for part in parts if isinstance(part, Chunk) and not part.torn]
        if len(chunks) < 2 or len(chunks) != len(parts):
            return list(parts)
        ordered = sorted(chunks, key=lambda chunk: chunk.start_time)
        apart = all(a.end_time <= b.start_time for a, b in pairwise(ordered))
        if ordered == chunks or not apart:
            return list(parts)
        self._notes.append("its chunks are not in order of time; they were read in order")
        return list(ordered)

    def _collect_channels(self) -> None:
        """Open every chunk for its schemas and channels, where no summary repeats them."""
        for part in self._file.parts:
            if isinstance(part, Chunk) and not (
                part.channels and part.channels.keys() <= self._file.channels.keys()
            ):
                opened = self._open(part)
                if opened is None:
                    continue
                for opcode, start, length in opened.others:
                    if opcode == _SCHEMA:
                        add_schema(self._file, start, length, opened.buffer)
                    elif opcode == _CHANNEL:
                        add_channel(self._file, start, length, opened.buffer)


def _tear_note(file: McapFile) -> tuple[str, ...]:
    if file.tear is None:
        return ()
    lost = file.buffer.size - file.tear
    if not lost:
        return ("the recording was not closed (no footer); everything in it was read",)
    share = 100 * lost / file.buffer.size
    return (
        f"the recording is torn at byte {file.tear} ({file.reason}): the last {lost} bytes "
        f"({share:.2g} % of the file) are not whole; everything before was read",
    )
