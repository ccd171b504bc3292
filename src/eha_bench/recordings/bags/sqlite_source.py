"""One sqlite3 file of a rosbag2."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.bags.bag_file import BagFile
from eha_bench.recordings.bags.blobs import Batch, Connection, joined
from eha_bench.recordings.encodings.decoder import Encoded

_BATCH = 8192


class SqliteSource(BagFile):
    """An opened sqlite3 bag file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        try:
            self._connections = self._read_connections()
        except (sqlite3.Error, ValueError, TypeError) as error:
            raise RecordingError(
                f"this is not a rosbag2 database, or it is damaged ({error})",
                where=Place(file=str(path)),
                hint="recover it with 'sqlite3 FILE .recover'",
            ) from error

    @property
    def format(self) -> str:
        """`sqlite3`."""
        return "sqlite3"

    def _open(self) -> sqlite3.Connection:
        # immutable: a bag on a read-only disk has no room for a lock or a journal
        where = f"{self._path.absolute().as_uri()}?mode=ro&immutable=1"
        database = sqlite3.connect(where, uri=True)
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        return database

    def _read_connections(self) -> dict[int, Connection]:
        with closing(self._open()) as database:
            tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
            schemas = {}
            if "message_definitions" in tables:
                schemas = {
                    str(name): (str(encoding), str(text).encode())
                    for name, encoding, text in database.execute(
                        "SELECT topic_type, encoding, encoded_message_definition"
                        " FROM message_definitions"
                    )
                }
            found = {}
            for number, topic, kind, encoding in database.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                written, text = schemas.get(str(kind), ("", b""))
                encoded = Encoded(str(encoding), str(kind), written, text)
                found[int(number)] = Connection(int(number), str(topic), encoded)
            return found

    def _batches(self, topics: set[str]) -> Iterator[Batch]:
        """Yield the messages of some topics in order of their rows."""
        ids = [c.id for c in self._connections.values() if c.topic in topics]
        marks = ",".join("?" * len(ids))
        count = 0
        rows: list[tuple[int, int, bytes]] = []
        try:
            with closing(self._open()) as database:
                for topic, stamp, data in database.execute(
                    "SELECT topic_id, timestamp, data FROM messages"
                    f" WHERE topic_id IN ({marks}) ORDER BY id",
                    ids,
                ):
                    count += 1
                    rows.append((int(topic), int(stamp), bytes(data)))
                    if len(rows) == _BATCH:
                        yield joined(*map(list, zip(*rows, strict=True)))
                        rows.clear()
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
            self._damaged = True
            self._notes.append(
                f"the database is damaged after {count} messages ({error}); "
                "everything before was read"
            )
        if rows:
            yield joined(*map(list, zip(*rows, strict=True)))
