"""MATLAB v5 files as tables; only plain numeric arrays are taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.encodings.field_path import Element, FieldPath
from eha_bench.recordings.file_bytes import map_file
from eha_bench.recordings.naming import among
from eha_bench.recordings.tables.mat_check import check_sizes
from eha_bench.recordings.tables.table import TableSource

_DEEPEST = 8
_MOST = 10_000


class MatSource(TableSource):
    """A MAT file: a variable, a field of a struct (`log.p`), or a column of a matrix (`y[0]`).

    Elements of struct arrays and cells are counted from 0 as well: `log.signals[1].values`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        from scipy.io import loadmat

        try:
            raw = map_file(path).data
            check_sizes(raw)
            content = loadmat(str(path), squeeze_me=True, struct_as_record=True)
        except NotImplementedError as error:
            raise RecordingError(
                "this version of MAT is not read",
                where=Place(file=self.path),
                hint="save it with save(..., '-v7')",
            ) from error
        except Exception as error:  # damaged files raise errors of many roots
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise RecordingError(
                f"the MAT file is damaged or torn ({reason})",
                where=Place(file=self.path),
                hint="save it again",
            ) from error
        self._columns: dict[str, NDArray[Any]] = {}
        self._others: dict[str, str] = {}
        for name, value in content.items():
            if not name.startswith("__"):
                self._collect(name, value, 0)
        if not self._columns:
            raise RecordingError("it holds no numeric arrays", where=Place(file=self.path))

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
        return self._checked(name)

    def has(self, name: str) -> bool:
        """Whether there is such an array, or a matrix with such a column."""
        try:
            self._checked(name)
        except RecordingError:
            return False
        return True

    def _checked(self, name: str) -> NDArray[Any]:
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
        if len(steps) > 1 and isinstance(steps[-1], Element):
            matrix = self._columns.get(str(FieldPath(steps[:-1])))
            index = steps[-1].index
            if matrix is not None and matrix.ndim == 2 and index < matrix.shape[1]:
                return matrix[:, index]
        raise RecordingError(
            f"there is no column '{name}'",
            where=Place(file=self.path),
            hint=among(name, self._columns, "columns"),
        )

    def _collect(self, name: str, value: Any, depth: int) -> None:
        """Collect numeric arrays, also from structs and cells inside each other."""
        if not isinstance(value, np.ndarray) or depth > _DEEPEST or len(self._columns) > _MOST:
            self._others[name] = "text" if isinstance(value, str) else "a single value"
        elif value.dtype.names and value.ndim == 0:
            for field in value.dtype.names:
                inner = value[field]
                self._collect(
                    f"{name}.{field}", inner.item() if inner.dtype == object else inner, depth + 1
                )
        elif value.dtype.names or value.dtype == object:
            for place, inner in enumerate(value.ravel(order="F")[:_MOST]):
                packed = np.array(inner) if isinstance(inner, np.void) else inner
                self._collect(f"{name}[{place}]", packed, depth + 1)
        elif value.dtype.kind in "iufb" and value.ndim in (1, 2) and value.size:
            self._columns[name] = value.astype(np.float64) if value.dtype.kind == "b" else value
        else:
            kinds = {"c": "complex numbers", "U": "text", "S": "text"}
            self._others[name] = kinds.get(value.dtype.kind, f"an array of {value.ndim} dimensions")
