"""MATLAB v5 files as tables; only plain numeric arrays are taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.encodings.field_path import ArrayItem, FieldPath
from eha_bench.recordings.file_bytes import map_file
from eha_bench.recordings.naming import among
from eha_bench.recordings.tables.mat5 import DamagedMat, read_mat5
from eha_bench.recordings.tables.table import TableSource


class MatSource(TableSource):
    """A MAT file: a variable, a field of a struct (`log.p`), or a column of a matrix (`y[0]`).

    Elements of struct arrays and cells are counted from 0 as well: `log.signals[1].values`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        where = Place(file=self.path)
        try:
            found = read_mat5(map_file(path).data)
        except DamagedMat as error:
            raise RecordingError(
                f"the MAT file is damaged ({error})", where=where, hint="save it again with '-v7'"
            ) from error
        self._columns = found.numbers
        self._others = found.others
        if not self._columns:
            reason = f"the MAT file is damaged or torn ({found.damage})" if found.damage else ""
            raise RecordingError(
                reason or "it holds no numeric arrays", where=where, hint="save it again"
            )
        if found.damage:
            self._torn = True
            self._notes.append(
                f"the file is damaged or torn ({found.damage}); what was before is read"
            )

    @property
    def format(self) -> str:
        """`mat`."""
        return "mat"

    def names(self) -> tuple[str, ...]:
        """Names of the arrays."""
        return tuple(self._columns)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, shape (n,)."""
        return self._columns[name]

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,)."""
        return self._checked_column(name)

    def has(self, name: str) -> bool:
        """Whether there is such an array, or a matrix with such a column."""
        try:
            self._checked_column(name)
        except RecordingError:
            return False
        return True

    def _checked_column(self, name: str) -> NDArray[Any]:
        if name in self._columns:
            return self._columns[name]
        if name in self._others:
            raise RecordingError(
                f"'{name}' holds {self._others[name]}, not real numbers",
                where=Place(file=self.path),
                hint=among(name, self._columns, "columns"),
            )
        try:
            steps = FieldPath.parse(name).steps
        except ValueError:
            steps = ()
        if len(steps) > 1 and isinstance(steps[-1], ArrayItem):
            matrix = self._columns.get(str(FieldPath(steps[:-1])))
            index = steps[-1].index
            if matrix is not None and matrix.ndim == 2 and index < matrix.shape[1]:
                return matrix[:, index]
        raise RecordingError(
            f"there is no column '{name}'",
            where=Place(file=self.path),
            hint=among(name, self._columns, "columns"),
        )
