"""An MCAP file as a source of tracks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from eha_bench.recordings.batch_decoder import Part, in_order
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.mcap.chunk_reader import ChunkReader
from eha_bench.recordings.mcap.demux import LOG_TIME, PUBLISH_TIME, Split
from eha_bench.recordings.mcap.file import (
    Chunk,
    McapFile,
    add_channel,
    add_schema,
    open_mcap,
)
from eha_bench.recordings.mcap.parallel import ParallelReader
from eha_bench.recordings.source import Source, Span, Topic, Wanted
from eha_bench.recordings.topic_reader import TopicReader, finished
from eha_bench.recordings.track import Arena, StampColumn, Track

_SCHEMA, _CHANNEL = 3, 4


class McapSource(Source):
    """An opened MCAP file."""

    def __init__(self, path: Path) -> None:
        self._file = open_mcap(path)
        self._reader = ChunkReader(self._file)
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
    def reader(self) -> ChunkReader:
        """What opens the chunks."""
        return self._reader

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far: a tear, damaged chunks, chunks out of order."""
        return tuple(dict.fromkeys((*damage(self._file), *self._reader.notes)))

    @property
    def damaged(self) -> bool:
        """Whether it is torn, has a hole, or has lost a chunk."""
        return self._file.tear is not None or bool(self._file.holes) or self._reader.lost > 0

    @property
    def format(self) -> str:
        """`mcap`."""
        return "mcap"

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

    def tracks(self, wanted: Mapping[str, Wanted], span: Span | None = None) -> dict[str, Track]:
        """Return the samples of the wanted topics, in file order.

        Raises:
            RecordingError: a topic cannot be decoded.
        """
        ids = self._ids(wanted)
        together = self._together(ids, wanted, span)
        if together is not None:
            return together
        readers = self._readers(wanted, {} if span else self._expected(ids))
        for part in self._reader.splits(ids, span):
            self._collect(part, ids, readers)
            del part  # or there would be three chunks in memory
        return finished(self, readers)

    def first_stamp(self, wanted: Mapping[str, Wanted]) -> int | None:
        """Return the log time in ns of the first wanted message, None if only a full scan tells."""
        if not all(isinstance(part, Chunk) and part.channels for part in self._file.parts):
            return None
        ids = self._ids(wanted)
        for part in self._reader.splits(ids):
            stamps = [
                int(payloads.column(LOG_TIME, "<i8").min())
                for channel, payloads in part.messages
                if channel in ids
            ]
            if stamps:
                return min(stamps)
        return None

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

    def _ids(self, wanted: Mapping[str, Wanted]) -> dict[int, str]:
        return {c.id: c.topic for c in self._file.channels.values() if c.topic in wanted}

    def _together(
        self, ids: Mapping[int, str], wanted: Mapping[str, Wanted], span: Span | None
    ) -> dict[str, Track] | None:
        """Read on several cores, if nothing is out of the ordinary."""
        parts = self._reader.needed(ids, span)
        chunks = [part for part in parts if isinstance(part, Chunk)]
        if len(chunks) < len(parts):
            return None
        return ParallelReader(chunks, ids, wanted, self._encoded, self._reader.open).tracks()

    def _readers(
        self, wanted: Mapping[str, Wanted], expected: Mapping[str, int]
    ) -> dict[str, TopicReader]:
        most = max(expected.values(), default=0)
        leading: list[str] = []
        readers: dict[str, TopicReader] = {}

        def follow(topic: str, clock: Clock | None) -> StampColumn | None:
            """Make the first of the busiest topics the one whose stamps others may share."""
            if not leading:
                if expected.get(topic, 0) == most:
                    leading.append(topic)
                return None
            first = readers[leading[0]]
            return first.stamps if first.clock is clock else None

        arena = Arena(sum(expected.get(t, 0) * len(what.fields) for t, what in wanted.items()))
        for topic, what in wanted.items():
            readers[topic] = TopicReader(
                topic,
                what,
                self._encoded,
                expected.get(topic, 0),
                arena,
                partial(follow, topic, what.clock),
            )
        return readers

    def _encoded(self, channel: int) -> Encoded:
        record = self._file.channels[channel]
        schema = self._file.schemas.get(record.schema_id)
        return Encoded(
            record.message_encoding,
            schema.name if schema else "",
            schema.encoding if schema else "",
            schema.data if schema else b"",
        )

    def _collect(
        self, part: Split, ids: Mapping[int, str], readers: Mapping[str, TopicReader]
    ) -> None:
        groups: dict[str, list[tuple[int, Payloads]]] = {}
        for channel, payloads in part.messages:
            if channel in ids:
                groups.setdefault(ids[channel], []).append((channel, payloads))
        for topic, members in groups.items():
            self._extend(readers[topic], topic, members)

    def _extend(self, reader: TopicReader, topic: str, members: list[tuple[int, Payloads]]) -> None:
        delta = PUBLISH_TIME if reader.clock is Clock.PUBLISH else LOG_TIME
        rows = in_order([payloads for _, payloads in members])
        batch = [
            Part(channel, payloads, where, payloads.column(delta, "<i8"))
            for (channel, payloads), where in zip(members, rows, strict=True)
        ]
        try:
            reader.extend(batch)
        except UnreadableTopic as error:
            raise self.refuse(topic, error) from error

    def _expected(self, ids: Mapping[int, str]) -> dict[str, int]:
        """Count messages by topic as the chunks' indexes have it, to take memory once.

        Where the last chunk is torn and has none, there is room for another one like the largest.
        """
        expected: dict[str, int] = {}
        largest: dict[str, int] = {}
        unknown = False
        for part in self._file.parts:
            if not isinstance(part, Chunk):
                continue
            unknown |= part.channels is None
            for channel, count in (part.channels or {}).items():
                if channel in ids:
                    topic = ids[channel]
                    expected[topic] = expected.get(topic, 0) + count
                    largest[topic] = max(largest.get(topic, 0), count)
        return {topic: count + unknown * largest[topic] for topic, count in expected.items()}

    def _collect_channels(self) -> None:
        """Open every chunk for its schemas and channels, where no summary repeats them."""
        for part in self._reader.splits(None):
            for opcode, start, length in part.others:
                if opcode == _SCHEMA:
                    add_schema(self._file, start, length, part.buffer)
                elif opcode == _CHANNEL:
                    add_channel(self._file, start, length, part.buffer)


def damage(file: McapFile) -> tuple[str, ...]:
    """Say where a file is torn or has holes, and how much of it that is."""
    size = file.buffer.size
    holes = tuple(
        f"the recording has a hole from byte {start} to {stop} "
        f"({100 * (stop - start) / size:.2g} % of the file); what stands on both sides was read"
        for start, stop in file.holes
    )
    if file.tear is None:
        return holes
    lost = file.buffer.size - file.tear
    if not lost:
        return (*holes, "the recording was not closed (no footer); everything in it was read")
    share = 100 * lost / file.buffer.size
    return (
        *holes,
        f"the recording is torn at byte {file.tear} ({file.reason}): the last {lost} bytes "
        f"({share:.2g} % of the file) are not whole; everything before was read",
    )
