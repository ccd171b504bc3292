"""Apache Parquet files as tables."""

from __future__ import annotations

import json
import mmap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.extras import require
from eha_bench.recordings.budget import budget
from eha_bench.recordings.encodings.field_path import ArrayItem, Attribute, FieldPath, Step
from eha_bench.recordings.naming import among
from eha_bench.recordings.tables.parquet_pages import MissingPage, pages_of
from eha_bench.recordings.tables.table import TableSource

DESCRIPTION: Final = b"eha_bench"
"""Key of the file's metadata under which `export` says what the columns are."""

_NUMBER = 8
"""Bytes of a value."""


class ParquetSource(TableSource):
    """An Apache Parquet file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._described: dict[str, Any] = {}
        where = Place(file=self.path)
        require("pyarrow", "parquet", "a Parquet file", where=where, error=RecordingError)
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            self._file = pq.ParquetFile(path)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise RecordingError(
                f"the Parquet file is damaged or torn ({' '.join(str(error).split())[:200]})",
                where=Place(file=self.path),
                hint="its index is at the end, so a truncated file cannot be read",
            ) from error

        # made anew at every access, and as long as the table is wide
        self._schema = self._file.schema_arrow
        self._names = tuple(self._schema.names)
        self._rows = self._file.metadata.num_rows
        self._leaves = self._file.metadata.num_columns
        self._describe()

    def _describe(self) -> None:
        """Take what eha-bench wrote besides its columns; of another file there is nothing."""
        raw = (self._schema.metadata or {}).get(DESCRIPTION)
        if raw is None:
            return
        try:
            found = json.loads(raw)
            epoch = int(found["epoch_ns"])
            units = {str(name): str(unit) for name, unit in found["units"].items()}
            own_metadata = {str(key): str(value) for key, value in found["metadata"].items()}
        except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError):
            self._torn = True
            self._notes.append("the metadata that eha-bench wrote is damaged and ignored")
            return
        self.own_epoch = epoch if abs(epoch) < 2**62 else None
        self._described = {"units": units, "metadata": own_metadata}
        self._notes += [str(note)[:1000] for note in found.get("notes", [])[:100]]

    def units(self) -> Mapping[str, str]:
        """Units by column, of a file that eha-bench wrote."""
        return dict(self._described.get("units", {}))

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """What a recording of ours held as metadata."""
        own_metadata = self._described.get("metadata")
        return {"eha_bench": own_metadata} if own_metadata else {}

    @property
    def format(self) -> str:
        """`parquet`."""
        return "parquet"

    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self._names

    def has(self, name: str) -> bool:
        """Whether there is such a column, or a column that may hold such an element."""
        return name in self.names() or self._owner(name) in self.names()

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,); nulls are NaN.

        Args:
            name: a column, a field of a struct (`p.x`) or an element of a list (`p[1]`).

        Raises:
            RecordingError: it holds something else, or is damaged.
        """
        values = self._values(name)
        if values.dtype.kind not in "iufb":
            raise RecordingError(
                "the column does not hold numbers", where=Place(file=self.path, key=name)
            )
        return values

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers, dates, times of day or durations.

        Raises:
            RecordingError: it holds something else, or is damaged.
        """
        values = self._values(name)
        return values if values.dtype.kind in "mM" else self.column(name)

    @staticmethod
    def _owner(name: str) -> str:
        try:
            first = FieldPath.parse(name).steps[0]
        except ValueError:
            return name
        return first.name if isinstance(first, Attribute) else name

    def _values(self, name: str) -> NDArray[Any]:
        import pyarrow as pa
        import pyarrow.compute as pc

        where = Place(file=self.path, key=name)
        owner = name if name in self.names() else self._owner(name)
        steps = FieldPath.parse(name).steps[1:] if owner != name else ()
        stored = self._stored_path(owner, steps, where)
        self._hold(stored, name, where)
        try:
            column = self._file.read(columns=[stored]).column(owner)
            for step in steps:
                match step:
                    case Attribute(field):
                        column = pc.struct_field(column, field)
                    case ArrayItem(index):
                        column = pc.list_element(column, index)
            if pa.types.is_decimal(column.type):
                column = column.cast(pa.float64())
            if pa.types.is_time(column.type):
                column = column.cast(pa.time64("ns")).cast(pa.int64()).cast(pa.duration("ns"))
            found: NDArray[Any] = column.to_numpy()
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise self._damage_error(
                f"cannot be read ({' '.join(str(error).split())[:200]})", where
            ) from error
        if not found.size:
            raise RecordingError("the table is empty", where=where, hint="record it again")
        return found

    def _stored_path(self, owner: str, steps: Sequence[Step], where: Place) -> str:
        """Return the path under which the file stores a field or element of a column.

        Raises:
            RecordingError: there is no such field, or what is stored there is no number and no
                time: such values are not even looked at, a text may be as long as memory.
        """
        import pyarrow as pa

        places = self._schema.get_all_field_indices(owner)
        if len(places) > 1:
            raise RecordingError(
                f"{len(places)} columns have this name",
                where=where,
                hint="write the table again with a different name for each column",
            )
        kind = self._schema.field(owner).type
        path, in_structs = owner, True
        for step in steps:
            match step:
                case Attribute(field) if pa.types.is_struct(kind):
                    place = kind.get_field_index(field)
                    if place < 0:
                        known = [kind.field(k).name for k in range(kind.num_fields)]
                        raise RecordingError(
                            f"there is no field '{field}'",
                            where=where,
                            hint=among(field, known, "fields"),
                        )
                    kind = kind.field(place).type
                    path = f"{path}.{field}" if in_structs else path
                case ArrayItem() if _is_list(kind):
                    kind, in_structs = kind.value_type, False
                case Attribute() | ArrayItem():
                    raise RecordingError("the column holds no such elements", where=where)
                case _:
                    raise RecordingError("a table's elements have no names", where=where)
        if pa.types.is_dictionary(kind):
            kind = kind.value_type
        if not (pa.types.is_primitive(kind) or pa.types.is_decimal(kind) or kind == pa.null()):
            raise RecordingError("the column does not hold numbers", where=where)
        return path

    def _hold(self, path: str, owner: str, where: Place) -> None:
        """Hold what is stored under a path against the budget, and the index against the pages.

        Raises:
            RecordingError: the pages hold another number of values than the index at the end says.
            OverBudget: it would take too much.
        """
        chunks = self._chunks.get(path, [])
        values = max(self._rows, sum(chunk.values for chunk in chunks))
        size = sum(chunk.size for chunk in chunks)
        # a run of equal values or of nothing takes a few bytes of the file, however long it is
        budget().hold(_NUMBER * values + size, f"'{owner}'")
        size = 0
        for chunk in chunks:
            if not (self._rows or chunk.values or chunk.rows):
                continue  # a table without rows has no pages either
            try:
                found = pages_of(self._content, chunk.start, chunk.end)
            except MissingPage as error:
                raise self._damage_error(f"its pages are damaged: {error}", where) from error
            if found.values != chunk.values or (
                chunk.rows is not None and chunk.rows != chunk.values
            ):
                rows = chunk.values if chunk.rows is None else chunk.rows
                raise self._damage_error(
                    f"its pages hold {found.values} values, not the {rows} that the file's index "
                    "declares",
                    where,
                )
            size += found.size
        budget().hold(_NUMBER * values + size, f"'{owner}'")

    def _damage_error(self, what: str, where: Place) -> RecordingError:
        self._torn = True
        return RecordingError(what, where=where, hint="the file is damaged: record it again")

    @cached_property
    def _content(self) -> mmap.mmap:
        with Path(self.path).open("rb") as stream:
            return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)

    @cached_property
    def _chunks(self) -> dict[str, list[_Chunk]]:
        """What is stored under each path, over all row groups and all that a struct holds."""
        chunks: dict[str, list[_Chunk]] = {}
        schema = self._file.schema
        flat = [schema.column(place).max_repetition_level == 0 for place in range(self._leaves)]
        for number in range(self._file.metadata.num_row_groups):
            group = self._file.metadata.row_group(number)
            for place in range(group.num_columns):
                budget().tick()
                part = group.column(place)
                start = part.data_page_offset
                if part.dictionary_page_offset and 0 < part.dictionary_page_offset < start:
                    start = part.dictionary_page_offset
                chunk = _Chunk(
                    start,
                    start + max(part.total_compressed_size, 0),
                    max(part.num_values, 0),
                    max(part.total_uncompressed_size, 0),
                    group.num_rows if flat[place] else None,
                )
                steps = part.path_in_schema.split(".")
                for depth in range(1, len(steps) + 1):
                    chunks.setdefault(".".join(steps[:depth]), []).append(chunk)
        return chunks


@dataclass(frozen=True)
class _Chunk:
    """A leaf of the table in one row group, as the index at the file's end describes it.

    Attributes:
        start, end: where its pages lie.
        values: how many, nulls too.
        size: bytes once decompressed.
        rows: of the row group, each with one value; None where a value is a list.
    """

    start: int
    end: int
    values: int
    size: int
    rows: int | None


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    tests = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    return any(test(kind) for test in tests)
