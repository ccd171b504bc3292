"""The index of a history: one row a run and one a score, in SQLite, appended to.

It is made from the result files and can be made again from them at any time. Runs that are in it
stay in it when their folder is deleted, so that a history outlives its recordings.
"""

from __future__ import annotations

import math
import sqlite3
import statistics
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.output_folder import writable
from eha_bench.core.result import Result, Status
from eha_bench.core.score import Measure

VERSION: Final = 3
RESULT_NAME: Final = "result.json"

_TABLES: Final = f"""
PRAGMA user_version = {VERSION};
CREATE TABLE runs (
  id INTEGER PRIMARY KEY, path TEXT NOT NULL UNIQUE, bytes INTEGER NOT NULL,
  changed INTEGER NOT NULL, started TEXT NOT NULL, suite TEXT NOT NULL, target TEXT NOT NULL,
  status TEXT NOT NULL, revision TEXT NOT NULL, host TEXT NOT NULL, version TEXT NOT NULL,
  suite_sha256 TEXT NOT NULL, model_sha256 TEXT NOT NULL, controller_sha256 TEXT NOT NULL,
  oil_temperature REAL
);
CREATE TABLE scores (
  run INTEGER NOT NULL REFERENCES runs (id), trial TEXT NOT NULL, metric TEXT NOT NULL,
  channel TEXT NOT NULL, unit TEXT NOT NULL, value REAL, repeats INTEGER NOT NULL,
  bound TEXT NOT NULL, matters TEXT NOT NULL, spread REAL, open TEXT NOT NULL DEFAULT ''
);
"""
_SECOND_VERSION: Final = """
ALTER TABLE runs ADD COLUMN oil_temperature REAL;
ALTER TABLE scores ADD COLUMN spread REAL;
"""
_THIRD_VERSION: Final = f"""
ALTER TABLE scores ADD COLUMN open TEXT NOT NULL DEFAULT '';
PRAGMA user_version = {VERSION};
"""
_OF_MEDIAN: Final = 1.2533  # its standard deviation over that of a mean, of normal values
_HALF_WIDTHS: Final = 2.0 * 1.959963984540054


@dataclass(frozen=True)
class Night:
    """One run: where its result is (relative to the folder that is watched), and what was run.

    `started` is when it was recorded (of recordings that were scored later, not when they were);
    `oil_temperature` in K is None where it was not logged.
    """

    id: int
    path: str
    started: str
    suite: str
    target: str
    status: str
    revision: str
    host: str
    version: str
    suite_sha256: str
    model_sha256: str
    controller_sha256: str
    oil_temperature: float | None


@dataclass(frozen=True)
class Entry:
    """The median of one metric over the repeats of one run, SI; NaN if it was not scored.

    `bound` is the acceptance limit in SI, "" for none; `spread` the median's standard deviation by
    the repeats' own intervals and scatter, NaN where unknown; `open` the side on which a sensor's
    end cut values off: `above`, `below`, `both` or "".
    """

    run: int
    trial: str
    metric: str
    channel: str
    unit: str
    value: float
    repeats: int
    bound: str
    matters: str
    spread: float
    open: str = ""


@dataclass(frozen=True)
class Index:
    """What an index holds, and what could not be read on the way."""

    nights: tuple[Night, ...]
    entries: tuple[Entry, ...]
    problems: tuple[str, ...]

    def without(self, paths: Collection[str]) -> Index:
        """Return it without the nights whose results have these paths."""
        left = {night.id for night in self.nights if night.path in paths}
        if not left:
            return self
        return Index(
            tuple(night for night in self.nights if night.id not in left),
            tuple(entry for entry in self.entries if entry.run not in left),
            self.problems,
        )


def update(file: Path, folder: Path, *, rebuild: bool = False) -> Index:
    """Bring an index up to date with the results below a folder, and return it.

    Args:
        file: the index; made where there is none.
        folder: watched folder; every result.json below it is a run.
        rebuild: make it again from the results.

    Raises:
        InputError: the folder is not there, the file is not an index, or cannot be written.
    """
    if not folder.is_dir():
        raise InputError(
            "no such folder",
            where=Place(file=str(folder)),
            hint="give a folder of result folders, e.g. reports/SUITE",
        )
    writable(file.parent)
    if not file.exists() and next(folder.rglob(RESULT_NAME), None) is None:
        return Index((), (), ())  # and no empty index is left behind
    if rebuild:
        file.unlink(missing_ok=True)
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        with closing(sqlite3.connect(file)) as database, database:
            _prepare(database, file)
            problems = _append(database, folder)
            return Index(tuple(_nights(database)), tuple(_entries(database)), tuple(problems))
    except sqlite3.OperationalError as error:
        raise InputError(
            f"the index cannot be used ({error})",
            where=Place(file=str(file)),
            hint="end what else uses it, or name another folder with --out",
        ) from error
    except sqlite3.DatabaseError as error:
        raise InputError(
            f"not an index of a history ({error})",
            where=Place(file=str(file)),
            hint="recreate it with --rebuild",
        ) from error


def _prepare(database: sqlite3.Connection, file: Path) -> None:
    version = database.execute("PRAGMA user_version").fetchone()[0]
    if version == 0 and not database.execute("SELECT name FROM sqlite_master").fetchall():
        database.executescript(_TABLES)
    elif version in (1, 2):  # runs whose results are gone are in it: they stay
        database.executescript((_SECOND_VERSION if version == 1 else "") + _THIRD_VERSION)
    elif version != VERSION:
        raise InputError(
            f"an index of version {version}, not {VERSION}",
            where=Place(file=str(file)),
            hint="recreate it with --rebuild",
        )


def _append(database: sqlite3.Connection, folder: Path) -> list[str]:
    known = {
        path: (size, changed, key)
        for key, path, size, changed in database.execute(
            "SELECT id, path, bytes, changed FROM runs"
        )
    }
    problems = []
    for path in _results(folder):
        name = path.relative_to(folder).as_posix()
        about = path.stat()
        stamp = (about.st_size, about.st_mtime_ns)
        if name in known and known[name][:2] == stamp:
            continue
        if name in known:  # the folder was used again: the run that was in it is no more
            database.execute("DELETE FROM scores WHERE run = ?", (known[name][2],))
            database.execute("DELETE FROM runs WHERE id = ?", (known[name][2],))
        try:
            result = Result.read(path)
        except EhaBenchError as error:
            problems.append(str(error))
            continue
        _add(database, name, stamp, result)
    return problems


def _results(folder: Path) -> list[Path]:
    """Return the results below a folder; those within a result belong to it, as an A/B run's do."""
    found = sorted(folder.rglob(RESULT_NAME))
    owners = {path.parent for path in found} - {folder}
    return [path for path in found if owners.isdisjoint(path.parent.parents)]


def _add(database: sqlite3.Connection, name: str, stamp: tuple[int, int], result: Result) -> None:
    origin = result.provenance
    keys = ("revision", "host", "version", "suite_sha256", "model_sha256", "controller_sha256")
    started = (
        origin.get("recorded")
        or origin.get("started")
        or datetime.fromtimestamp(stamp[1] / 1e9, UTC).isoformat()
    )
    row = (
        name, *stamp, started, result.suite, result.target, result.status.value,
        *(origin.get(key, "") for key in keys), _number(origin.get("oil_temperature", "")),
    )  # fmt: skip
    key = database.execute(
        f"INSERT INTO runs VALUES (NULL, {', '.join('?' * len(row))})", row
    ).lastrowid
    database.executemany(
        "INSERT INTO scores VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [(key, *entry) for entry in _scores(result)],
    )


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _scores(
    result: Result,
) -> Iterator[tuple[str, str, str, str, float | None, int, str, str, float | None, str]]:
    grouped: dict[tuple[str, str, str, str], list[Measure]] = {}
    about: dict[tuple[str, str, str, str], tuple[str, str]] = {}
    for trial in result.trials:
        if trial.status not in (Status.PASSED, Status.FAILED):
            continue
        for score in trial.scores:
            key = (trial.id, score.metric, score.channel, score.unit)
            found = grouped.setdefault(key, [])
            about.setdefault(key, (score.limit_in_si or score.limit, score.matters))
            if math.isfinite(score.value):
                found.append(score.measure)
    for key, measures in grouped.items():
        value = statistics.median(m.value for m in measures) if measures else None
        side = Measure(math.nan).censored_like(measures).open
        yield (*key, value, len(measures), *about[key], _median_spread(measures), side)


def _median_spread(measures: list[Measure]) -> float | None:
    """Return the standard deviation of the median of repeats; None where nothing tells it."""
    widths = [m.high - m.low for m in measures if math.isfinite(m.high - m.low)]
    own = math.sqrt(sum(w * w for w in widths) / len(widths)) / _HALF_WIDTHS if widths else 0.0
    count = len(measures)
    scatter = statistics.stdev(m.value for m in measures) if count > 2 else 0.0
    factor = _OF_MEDIAN if count > 2 else 1.0
    found = factor * max(own, scatter) / math.sqrt(max(1, count))
    return found if found > 0.0 else None


def _nights(database: sqlite3.Connection) -> Iterator[Night]:
    rows = database.execute(
        "SELECT id, path, started, suite, target, status, revision, host, version, suite_sha256,"
        " model_sha256, controller_sha256, oil_temperature FROM runs"
    )
    # by the instant: time zones differ
    yield from sorted((Night(*row) for row in rows), key=lambda n: (_instant(n.started), n.path))


def _instant(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return 0.0
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _entries(database: sqlite3.Connection) -> Iterator[Entry]:
    rows = database.execute(
        "SELECT run, trial, metric, channel, unit, value, repeats, bound, matters, spread,"
        " open FROM scores"
    )
    for run, trial, metric, channel, unit, value, repeats, bound, matters, spread, side in rows:
        number = math.nan if value is None else value
        own = math.nan if spread is None else spread
        yield Entry(run, trial, metric, channel, unit, number, repeats, bound, matters, own, side)
