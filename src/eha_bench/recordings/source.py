"""What every kind of log offers to the reader: topics, and their numbers as tracks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.naming import printable
from eha_bench.recordings.track import Track

HOLDS_DATES = "holds dates"
"""What is said of a column that is no number, and may be the clock."""
IN_PAIRS = "its columns come in pairs of X and Y"
"""What is said of a table in which an X stands before each column: the time of that one alone."""


@dataclass(frozen=True)
class Topic:
    """A topic of a log; `encoded` is None for a column of a table, `skipped` says why not read."""

    name: str
    encoded: Encoded | None
    count: int | None = None
    skipped: str = ""


@dataclass(frozen=True)
class TopicRequest:
    """What is wanted of a topic; without a clock its track has no stamps."""

    fields: tuple[FieldPath, ...]
    clock: Clock | None


@dataclass(frozen=True)
class TimeSpan:
    """Part of a recording, start <= time < stop; in s on its clock, or in ns since 1970."""

    start: float = -math.inf
    stop: float = math.inf

    @property
    def bounded(self) -> bool:
        """Whether it is less than everything."""
        return math.isfinite(self.start) or math.isfinite(self.stop)

    def after(self, zero: int) -> TimeSpan:
        """Return a span in s after `zero` (ns) as a span in ns, rounded outwards."""
        return TimeSpan(zero + self.start * 1e9 - 1e3, zero + self.stop * 1e9 + 1e3)

    def __str__(self) -> str:
        """As a person writes it."""
        return f"{self.start:.6g} s to {self.stop:.6g} s"


class Source(ABC):
    """An opened log."""

    @property
    @abstractmethod
    def path(self) -> str:
        """The file or folder, for messages."""

    @property
    def origin(self) -> str:
        """Where that is, from the root."""
        return str(Path(self.path).absolute())

    @property
    def parts(self) -> tuple[Source, ...]:
        """The files that it is split over; itself if it is one file."""
        return (self,)

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What was found so far, one sentence each."""

    @property
    @abstractmethod
    def damaged(self) -> bool:
        """Whether something of it was lost, as far as it was read."""

    @property
    @abstractmethod
    def format(self) -> str:
        """Name of the format."""

    @abstractmethod
    def topics(self) -> tuple[Topic, ...]:
        """The topics of the log."""

    @abstractmethod
    def tracks(
        self, wanted: Mapping[str, TopicRequest], span: TimeSpan | None = None
    ) -> dict[str, Track]:
        """Return the samples of the wanted topics, in file order.

        Args:
            wanted: fields and clock by topic.
            span: what is needed, in ns of the log's clock. More may be returned; at least one
                sample before and after it comes along where there is one, to interpolate from.

        Raises:
            RecordingError: a topic cannot be decoded.
        """

    def first_stamp(self, wanted: Mapping[str, TopicRequest]) -> int | None:
        """Return the log time in ns of the first wanted message, if it is cheap to know."""
        del wanted
        return None

    def example(self, topic: str) -> bytes:
        """Return the first message of a topic; empty if there is none, or the log has no topics."""
        del topic
        return b""

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata by record name; later records of one name add to the earlier ones."""
        return {}

    def attachments(self) -> Mapping[str, bytes]:
        """Files inside the log, by name."""
        return {}

    def damaged_attachments(self) -> tuple[str, ...]:
        """Names of the files inside the log that are damaged, and left out."""
        return ()

    def skipped_notes(self) -> tuple[str, ...]:
        """Say which topics are left out because of what they are."""
        names = [topic.name for topic in self.topics() if topic.skipped]
        return (f"skipped topics with service events: {printable(names)}",) if names else ()

    def refuse(self, topic: str, error: UnreadableTopic) -> RecordingError:
        """Return the error that says why a topic cannot be decoded."""
        return RecordingError(
            f"the topic cannot be decoded: {error}",
            where=Place(file=self.path, topic=printable([topic])),
            hint="map another topic or field in channels.yaml",
        )
