"""Apache Parquet files as tables."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.encodings.field_path import Attribute, Element, FieldPath
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
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            self._file = pq.ParquetFile(path)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise RecordingError(
                f"the Parquet file is damaged or torn ({' '.join(str(error).split())[:200]})",
                where=Place(file=self.path),
                hint="its index stands at the end, so a torn file cannot be read",
            ) from error

        self._describe()

    def _describe(self) -> None:
        """Take what eha-bench wrote beside its columns; of another file there is nothing."""
        raw = (self._file.schema_arrow.metadata or {}).get(DESCRIPTION)
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
        return tuple(self._file.schema_arrow.names)

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
        # a run of equal values or of nothing takes a few bytes of the file, however long it is
        budget().hold(_NUMBER * self._file.metadata.num_rows, f"'{name}'")
        try:
            column = self._file.read(columns=[owner]).column(owner)
            for step in FieldPath.parse(name).steps[1:] if owner != name else ():
                match step:
                    case Attribute(field):
                        column = pc.struct_field(column, field)
                    case Element(index):
                        column = pc.list_element(column, index)
                    case _:
                        raise RecordingError("a table's elements have no names", where=where)
            if pa.types.is_decimal(column.type):
                column = column.cast(pa.float64())
            if pa.types.is_time(column.type):
                column = column.cast(pa.time64("ns")).cast(pa.int64()).cast(pa.duration("ns"))
            values: NDArray[Any] = column.to_numpy()
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise RecordingError(
                f"cannot be read ({' '.join(str(error).split())[:200]})", where=where
            ) from error
        if not values.size:
            raise RecordingError("the table is empty", where=where, hint="record it again")
        return values
