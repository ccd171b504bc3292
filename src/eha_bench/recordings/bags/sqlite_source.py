"""One sqlite3 file of a rosbag2."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.bags.bag_file import BagFile
from eha_bench.recordings.bags.blobs import Batch, Connection, batch_of
from eha_bench.recordings.budget import OverBudget, budget
from eha_bench.recordings.encodings.decoder import Encoded
from eha_bench.recordings.naming import printable

_BATCH = 8192
_ROW = 200
"""Bytes that a message takes besides its data."""
_STEPS = 10_000
"""Instructions of SQLite between two looks at the budget."""


class SqliteSource(BagFile):
    """An opened sqlite3 bag file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._budget = budget()
        self._spent: OverBudget | None = None
        try:
            self._connections = self._read_connections()
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            if self._spent is not None:
                raise self._spent from error
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
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA cell_size_check = ON")
        database.set_progress_handler(self._interrupted, _STEPS)
        return database

    def _interrupted(self) -> bool:
        """Whether a query has to stop: SQLite calls this while it works."""
        try:
            self._budget.tick()
        except OverBudget as error:
            self._spent = error
            return True
        return False

    def _check_tables(self, database: sqlite3.Connection) -> set[str]:
        """Return the names of the tables; refuse what would run something when it is read.

        Raises:
            ValueError: a table is a view, a virtual one, or computes its columns.
        """
        kinds = {
            str(name): (str(kind), str(text or ""))
            for name, kind, text in database.execute(
                "SELECT name, type, sql FROM sqlite_master WHERE type IN ('table', 'view')"
            )
        }
        for name in ("topics", "messages", "message_definitions"):
            kind, text = kinds.get(name, ("table", ""))
            if kind != "table" or not re.match(r"\s*(create\s+table|$)", text, re.IGNORECASE):
                raise ValueError(f"its '{name}' is a {kind}, which is not read")
            columns = database.execute(f"PRAGMA table_xinfo({name})").fetchall()
            if any(column[6] for column in columns):
                raise ValueError(f"its '{name}' computes its columns, which is not read")
        return set(kinds)

    def _read_connections(self) -> dict[int, Connection]:
        with closing(self._open()) as database:
            tables = self._check_tables(database)
            schemas = {}
            if "message_definitions" in tables:
                schemas = {
                    str(name): (str(encoding), str(text).encode())
                    for name, encoding, text in database.execute(
                        "SELECT topic_type, encoding, encoded_message_definition"
                        " FROM message_definitions"
                    )
                }
            found: dict[int, Connection] = {}
            declared: dict[str, Encoded] = {}
            for number, topic, kind, encoding in database.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                written, text = schemas.get(str(kind), ("", b""))
                encoded = Encoded(str(encoding), str(kind), written, text)
                if declared.setdefault(str(topic), encoded) != encoded:
                    self._damaged = True
                    self._conflicts.add(str(topic))
                    known = declared[str(topic)].schema_name
                    self._notes.append(
                        f"topic '{printable([str(topic)])}' is declared twice, "
                        f"as '{printable([known])}' and '{printable([str(kind)])}': "
                        "its messages are not read"
                    )
                found[int(number)] = Connection(int(number), str(topic), encoded)
            strangers = database.execute(
                "SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics)"
            ).fetchone()[0]
            if strangers:
                self._damaged = True
                self._notes.append(f"{strangers} messages belong to no topic; they are left out")
            return found

    def _batches(self, topics: set[str]) -> Iterator[Batch]:
        """Yield the messages of some topics in order of their rows."""
        ids = [c.id for c in self._connections.values() if c.topic in topics]
        marks = ",".join("?" * len(ids))
        count = held = 0
        rows: list[tuple[int, int, bytes]] = []
        try:
            with closing(self._open()) as database:
                for topic, stamp, data in database.execute(
                    "SELECT topic_id, timestamp, data FROM messages"
                    f" WHERE topic_id IN ({marks}) ORDER BY id",
                    ids,
                ):
                    count += 1
                    rows.append(_row(topic, stamp, data, count))
                    held += len(data) + _ROW
                    if len(rows) == _BATCH or 4 * held > self._budget.memory:
                        self._budget.hold(2 * held, "a message")
                        held = 0
                        yield batch_of(*map(list, zip(*rows, strict=True)))
                        rows.clear()
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
            if self._spent is not None:
                raise self._spent from error
            self._damaged = True
            self._notes.append(
                f"the database is damaged after {count} messages ({error}); "
                "everything before was read"
            )
        if rows:
            yield batch_of(*map(list, zip(*rows, strict=True)))


def _row(topic: Any, stamp: Any, data: Any, number: int) -> tuple[int, int, bytes]:
    """Return a message; SQLite keeps any type in any column.

    Raises:
        ValueError: its time is not a whole number, or its data no bytes.
    """
    if not isinstance(stamp, int) or not isinstance(data, bytes):
        raise ValueError(f"message {number} has no time or no data")
    return int(topic), stamp, data
