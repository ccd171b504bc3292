"""points.jsonl: what a sweep has done so far, a line a point, so that it can be gone on with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from eha_bench.core.errors import InputError, Place
from eha_bench.sweeps.evaluation import PointResult

JOURNAL: Final = "points.jsonl"
SCHEMA_VERSION: Final = 1


class PointJournal:
    """An open points.jsonl; every point is on the disk when `add` returns."""

    def __init__(self, path: Path, digests: Mapping[str, str], *, resume: bool) -> None:
        """Open one; with `resume`, what is in it is kept in `done`.

        Raises:
            InputError: what is to be resumed is a sweep of something else, or no journal.
        """
        self._path = path
        self._header = {"schema_version": SCHEMA_VERSION, **digests}
        self.done: dict[int, PointResult] = {}
        if resume and path.is_file():
            self._read()

    def _read(self) -> None:
        lines = self._path.read_text(encoding="utf-8").splitlines()
        where = Place(file=str(self._path), line=1)
        try:
            found = json.loads(lines[0])
        except (IndexError, ValueError) as error:
            raise InputError("is not a journal of a sweep", where=where) from error
        changed = [
            key.removesuffix("_sha256")
            for key in self._header
            if found.get(key) != self._header[key]
        ]
        if changed:
            raise InputError(
                f"is of another {' and another '.join(changed)}, and cannot be resumed",
                where=where,
                hint="leave out --resume to start over, or name that sweep's folder with --out",
            )
        for line in lines[1:]:
            try:
                entry = json.loads(line)
                self.done[int(entry["point"])] = PointResult.from_dict(entry)
            except (ValueError, KeyError, TypeError):
                continue  # torn where it was interrupted: that point is done again

    def __enter__(self) -> Self:
        """Write again what is known, so that a torn line is gone."""
        self._file: IO[str] = self._path.open("w", encoding="utf-8")
        self._write(self._header)
        for number, result in self.done.items():
            self._write({"point": number, **result.to_dict()})
        self._file.flush()
        return self

    def add(self, number: int, result: PointResult) -> None:
        """Keep a point that is done."""
        self.done[number] = result
        self._write({"point": number, **result.to_dict()})
        self._file.flush()

    def _write(self, entry: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(entry, ensure_ascii=False, allow_nan=False) + "\n")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self._file.close()
