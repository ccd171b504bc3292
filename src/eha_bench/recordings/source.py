"""What every kind of log offers to the reader: topics, and their numbers as tracks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.channel_map import Clock
from eha_bench.recordings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.field_path import FieldPath
from eha_bench.recordings.track import Track


@dataclass(frozen=True)
class Topic:
    """A topic of a log; `encoded` is None for a column of a table, `skipped` says why not read."""

    name: str
    encoded: Encoded | None
    count: int | None = None
    skipped: str = ""


@dataclass(frozen=True)
class Wanted:
    """What is wanted of a topic."""

    fields: tuple[FieldPath, ...]
    clock: Clock


class Source(ABC):
    """An opened log."""

    @property
    @abstractmethod
    def path(self) -> str:
        """The file or folder, for messages."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What was found so far, one sentence each."""

    @abstractmethod
    def topics(self) -> tuple[Topic, ...]:
        """The topics of the log."""

    @abstractmethod
    def tracks(self, wanted: Mapping[str, Wanted]) -> dict[str, Track]:
        """Return the samples of the wanted topics, in file order.

        Raises:
            RecordingError: a topic cannot be decoded.
        """

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata by record name; later records of one name add to the earlier ones."""
        return {}

    def attachments(self) -> Mapping[str, bytes]:
        """Files inside the log, by name."""
        return {}

    def refuse(self, topic: str, error: UnreadableTopic) -> RecordingError:
        """Return the error that says why a topic cannot be decoded."""
        return RecordingError(
            f"the topic cannot be decoded: {error}",
            where=Place(file=self.path, topic=topic),
            hint="map another topic or field in channels.yaml",
        )
