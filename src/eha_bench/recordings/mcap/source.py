"""An MCAP file as a source of tracks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from eha_bench.recordings.batch_decoder import MessageGroup, in_order
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.mcap.chunk_reader import ChunkReader
from eha_bench.recordings.mcap.demux import LOG_TIME, PUBLISH_TIME, Split
from eha_bench.recordings.mcap.file import BareMessages, Chunk, McapFile, open_mcap
from eha_bench.recordings.mcap.integrity import count_problems, data_problems, summary_problems
from eha_bench.recordings.mcap.parallel import ParallelReader
from eha_bench.recordings.naming import printable
from eha_bench.recordings.source import Source, TimeSpan, Topic, TopicRequest
from eha_bench.recordings.topic_reader import TopicReader, finished_tracks
from eha_bench.recordings.track import Arena, StampColumn, Track


class McapSource(Source):
    """An opened MCAP file."""

    def __init__(self, path: Path) -> None:
        self._file = open_mcap(path)
        self._reader = ChunkReader(self._file)
        self._wrong = list(summary_problems(self._file))
        self._wrong_attachments = [
            name for name, sound in self._file.attachment_checks() if not sound
        ]
        self._data_checked = False
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
        """What was found so far: a tear, damaged chunks, what is not as the file says."""
        attached = (
            f"the attachment {printable([name])} is damaged (its checksum is wrong): "
            "it was left out"
            for name in self._wrong_attachments
        )
        found = (
            *recovery_notes(self._file),
            *damage(self._file),
            *attached,
            *self._file.conflicts.values(),
            *self._wrong,
            *self._reader.notes,
        )
        return tuple(dict.fromkeys(found))

    @property
    def damaged(self) -> bool:
        """Whether it is torn, has lost something, or is not what it says of itself."""
        return (
            self._file.tear is not None
            or bool(self._file.holes)
            or self._reader.lost + self._reader.unlike > 0
            or bool(self._wrong or self._wrong_attachments or self._file.conflicts)
            or bool(recovery_notes(self._file))
        )

    def damaged_attachments(self) -> tuple[str, ...]:
        """Names of the attachments whose checksum is wrong."""
        return tuple(self._wrong_attachments)

    @property
    def format(self) -> str:
        """`mcap`."""
        return "mcap"

    def topics(self) -> tuple[Topic, ...]:
        """The topics of the file."""
        found: dict[str, Topic] = {}
        for channel in self._file.channels.values():
            encoded = self._encoding_of(channel.id)
            skipped = ""
            if channel.topic.endswith("/_service_event") or "/srv/" in encoded.schema_name:
                skipped = "it holds service events"
            found.setdefault(channel.topic, Topic(channel.topic, encoded, None, skipped))
        return tuple(found.values())

    def tracks(
        self, wanted: Mapping[str, TopicRequest], span: TimeSpan | None = None
    ) -> dict[str, Track]:
        """Return the samples of the wanted topics, in file order.

        Raises:
            RecordingError: a topic cannot be decoded.
        """
        ids = self._ids(wanted)
        tracks = self._together(ids, wanted, span)
        if tracks is None:
            readers = self._readers(wanted, {} if span else self._expected_counts(ids))
            for part in self._reader.splits(ids, span):
                self._collect(part, ids, readers)
                del part  # or there would be three chunks in memory
            tracks = finished_tracks(self, readers)
        if any(what.fields for what in wanted.values()):
            self._refuse_conflicts(ids)
        if span is None:
            self._check()
        return tracks

    def _check(self) -> None:
        """Compare all that was read with what the file says of itself."""
        if not self._data_checked:
            self._data_checked = True
            self._wrong += data_problems(self._file)
        starts = [part.start for part in self._file.parts if isinstance(part, BareMessages)]
        counted = self._reader.counted
        bare: Counter[int] | None = None
        if all(start in counted for start in starts):
            bare = Counter()
            for start in starts:
                bare.update(counted[start])
        self._wrong += [
            problem
            for problem in count_problems(self._file, counted, bare)
            if problem not in self._wrong
        ]

    def _refuse_conflicts(self, ids: Mapping[int, str]) -> None:
        """Refuse to read a channel that is declared twice: its messages may be of either."""
        for (channel, schema), text in self._file.conflicts.items():
            for number, topic in ids.items():
                if channel == number or schema == self._file.channels[number].schema_id:
                    raise self.refuse(topic, UnreadableTopic(text))

    def first_stamp(self, wanted: Mapping[str, TopicRequest]) -> int | None:
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

    def example(self, topic: str) -> bytes:
        """Return the first message of a topic; empty if there is none."""
        ids = [channel.id for channel in self._file.channels.values() if channel.topic == topic]
        for part in ChunkReader(self._file).splits(ids):
            for channel, payloads in part.messages:
                if channel in ids and payloads.count:
                    return bytes(payloads.payload(0))
        return b""

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata by record name; later records of one name add to the earlier ones."""
        return joined_metadata(self._file)

    def attachments(self) -> Mapping[str, bytes]:
        """Files inside the recording, by name; a name is only text and never a path."""
        found = {}
        for start, length in self._file.attachments:
            attachment = self._file.attachment(start, length)
            if attachment is not None and self._file.sound(start, length):
                found[attachment.name] = attachment.data
        return found

    def _ids(self, wanted: Mapping[str, TopicRequest]) -> dict[int, str]:
        return {c.id: c.topic for c in self._file.channels.values() if c.topic in wanted}

    def _together(
        self, ids: Mapping[int, str], wanted: Mapping[str, TopicRequest], span: TimeSpan | None
    ) -> dict[str, Track] | None:
        """Read on several cores, if nothing is out of the ordinary."""
        parts = self._reader.needed_parts(ids, span)
        chunks = [part for part in parts if isinstance(part, Chunk)]
        if len(chunks) < len(parts):
            return None
        return ParallelReader(chunks, ids, wanted, self._encoding_of, self._reader.open).tracks()

    def _readers(
        self, wanted: Mapping[str, TopicRequest], expected: Mapping[str, int]
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
                self._encoding_of,
                expected.get(topic, 0),
                arena,
                partial(follow, topic, what.clock),
            )
        return readers

    def _encoding_of(self, channel: int) -> Encoded:
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
            MessageGroup(channel, payloads, where, payloads.column(delta, "<i8"))
            for (channel, payloads), where in zip(members, rows, strict=True)
        ]
        try:
            reader.extend(batch)
        except UnreadableTopic as error:
            raise self.refuse(topic, error) from error

    def _expected_counts(self, ids: Mapping[int, str]) -> dict[str, int]:
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
            del part  # to open it is enough


RECOVERY = "eha_bench.recovery"
"""Metadata record that says what was wrong with the file that a recovered one was made from."""


def joined_metadata(file: McapFile) -> dict[str, dict[str, str]]:
    """Return metadata by record name; later records of one name add to the earlier ones."""
    found: dict[str, dict[str, str]] = {}
    for record in file.metadata:
        found.setdefault(record.name, {}).update(record.metadata)
    return found


def recovery_notes(file: McapFile) -> tuple[str, ...]:
    """Say what was wrong with the file that this one was recovered from."""
    found = (record.metadata for record in file.metadata if record.name == RECOVERY)
    return tuple(f"recovered from a damaged file: {note}" for one in found for note in one.values())


def damage(file: McapFile) -> tuple[str, ...]:
    """Say where a file is torn or has holes, and how much of it that is."""
    size = file.buffer.size
    holes = tuple(
        f"the recording has a hole from byte {start} to {stop} "
        f"({100 * (stop - start) / size:.2g} % of the file); what is on both sides was read"
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
