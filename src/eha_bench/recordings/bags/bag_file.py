"""What the bags that are one file have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.bags.blobs import Batch, Connection, collect
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import UnreadableTopic
from eha_bench.recordings.source import Source, TimeSpan, Topic, TopicRequest
from eha_bench.recordings.track import Track


class BagFile(Source):
    """A file of messages by connection; what is found damaged is noted while it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notes: list[str] = []
        self._damaged = False
        self._connections: dict[int, Connection] = {}
        self._conflicts: set[str] = set()

    @property
    def path(self) -> str:
        """The file, for messages."""
        return str(self._path)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far: a tear, what is damaged."""
        return tuple(dict.fromkeys(self._notes))

    @property
    def damaged(self) -> bool:
        """Whether something of it was lost."""
        return self._damaged

    def topics(self) -> tuple[Topic, ...]:
        """The topics of the file."""
        found: dict[str, Topic] = {}
        for one in self._connections.values():
            skipped = "it holds service events" if "/srv/" in one.encoded.schema_name else ""
            found.setdefault(one.topic, Topic(one.topic, one.encoded, None, skipped))
        return tuple(found.values())

    def tracks(
        self, wanted: Mapping[str, TopicRequest], span: TimeSpan | None = None
    ) -> dict[str, Track]:
        """Return the samples of the wanted topics, in order of the log.

        Raises:
            RecordingError: a topic cannot be decoded, or the publisher's clock is asked for.
        """
        del span  # all of it has to be decoded anyway
        for topic, what in wanted.items():
            if what.clock is Clock.PUBLISH:
                raise RecordingError(
                    f"a {self.format} bag does not hold the time of publishing",
                    where=Place(file=self.path, topic=topic),
                    hint="use clock: log or header",
                )
        tracks = collect(self, wanted, self._connections, self._batches(set(wanted)))
        for topic, what in wanted.items():
            if what.fields and topic in self._conflicts:
                raise self.refuse(topic, UnreadableTopic("its connection is declared twice"))
        return tracks

    def example(self, topic: str) -> bytes:
        """Return the first message of a topic; empty if there is none."""
        ids = [one.id for one in self._connections.values() if one.topic == topic]
        for batch in self._batches({topic}):
            for part in batch.parts(ids):
                return bytes(part.payloads.payload(0))
        return b""

    @abstractmethod
    def _batches(self, topics: set[str]) -> Iterator[Batch]:
        """Yield the messages, at least those of some topics, in order of the log."""
