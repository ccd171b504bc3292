"""HDF5 files, and MAT v7.3, which is HDF5: datasets as columns, groups as groups."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.tables.library import reading_with
from eha_bench.recordings.tables.times import NotATime, parse_times

_UNITS = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")
_MOST = 10_000
"""No file is expected to hold more datasets than these."""
_DEEPEST = 32


class Hdf5Source(GroupedTable):
    """An HDF5 file: a dataset (`rig/pressure_a`), a column of one (`y[0]`), a field of a compound.

    What lies in one group shares a clock. Nothing outside of the file is opened: links to other
    files, external and virtual datasets are left out.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._left_out: dict[str, str] = {}
        self._attributes: dict[str, str] = {}
        self._records: tuple[str, NDArray[Any]] = ("", np.empty(0))
        with reading_with("h5py", "hdf5", self.path):
            import h5py

            self._file = h5py.File(path, "r")
            weakref.finalize(self, self._file.close)
            for name, dataset in self._datasets(self._file, "", 0):
                self._keep(name, dataset)
            self._attributes = dict(_texts(self._file.attrs))
        if self._left_out:
            listed = ", ".join(f"{name} ({why})" for name, why in list(self._left_out.items())[:8])
            self._notes.append(f"left out: {listed}")
        if not self._series:
            raise RecordingError("it holds no numbers", where=Place(file=self.path))

    @property
    def format(self) -> str:
        """`hdf5`."""
        return "hdf5"

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The attributes of the file."""
        return {"hdf5": self._attributes} if self._attributes else {}

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers or texts.

        Raises:
            RecordingError: it holds something else.
        """
        values = self._values(name)
        if values.dtype.kind not in "OSU":
            return super().clock(name)
        cells = np.array(
            [v.decode("utf-8", "replace") if isinstance(v, bytes) else v for v in values.tolist()],
            dtype=object,
        )
        try:
            return parse_times(cells)
        except NotATime as error:
            raise RecordingError(
                f"'{str(cells[error.row])[:40]}' is neither a number nor a time",
                where=Place(file=self.path, key=name),
                hint="write dates as 2025-03-01T12:00:00.5",
            ) from None

    def _datasets(self, group: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
        """Yield (path, dataset) of all that lies in the file itself."""
        import h5py

        for number, name in enumerate(group):
            if depth > _DEEPEST or number > _MOST or len(self._series) > _MOST:
                raise RecordingError(
                    f"it holds more than {_MOST} datasets, or groups nested over {_DEEPEST} deep",
                    where=Place(file=self.path),
                )
            here = f"{path}/{name}" if path else name
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                self._left_out[here] = "a link"
                continue
            item = group[name]
            if isinstance(item, h5py.Group):
                yield from self._datasets(item, here, depth + 1)
            elif isinstance(item, h5py.Dataset):
                yield here, item

    def _keep(self, path: str, dataset: Any) -> None:
        """Keep a dataset that holds columns."""
        why = _unfit(dataset)
        if why:
            self._left_out[path] = why
            return
        group, _, name = path.rpartition("/")
        unit = next((text for key, text in _texts(dataset.attrs) if key in _UNITS), None)
        if dataset.dtype.names is None:
            self._series.append(Series(group, name, partial(self._read, path, dataset, ""), unit))
            return
        for field in dataset.dtype.names:
            if dataset.dtype[field].kind in "iufb":
                read = partial(self._read, path, dataset, field)
                self._series.append(Series(path, field, read))

    def _read(self, path: str, dataset: Any, field: str) -> NDArray[Any]:
        budget().hold(dataset.size * dataset.dtype.itemsize, f"'{path[:80]}'")
        with reading_with("h5py", "hdf5", self.path):
            if not field:
                return _column(np.asarray(dataset[()]))
            if self._records[0] != path:  # one field after the other takes as long as all of them
                self._records = (path, np.asarray(dataset[()]))
            return _column(self._records[1][field])


class Mat73Source(Hdf5Source):
    """A MAT file of version 7.3: variables, fields of structs (`log.p`), columns (`y[0]`)."""

    @property
    def format(self) -> str:
        """`mat`."""
        return "mat"

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Return nothing: MATLAB keeps no text with its variables."""
        return {}

    def _keep(self, path: str, dataset: Any) -> None:
        import h5py

        if path.startswith("#"):
            return  # what cells and struct arrays refer to; they are followed from there
        name = path.replace("/", ".")
        kind = dataset.attrs.get("MATLAB_class", b"")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        if h5py.check_ref_dtype(dataset.dtype) is h5py.Reference:
            self._keep_references(name, dataset)
            return
        why = _unfit(dataset) or {"char": "text", "cell": "an empty cell"}.get(kind, "")
        if dataset.attrs.get("MATLAB_empty", 0):
            why = "empty"
        if why:
            self._left_out[name] = why
        elif dataset.dtype.names is not None:
            self._left_out[name] = "complex numbers"
        else:
            self._series.append(Series("", name, partial(self._read_matrix, name, dataset)))

    def _keep_references(self, name: str, dataset: Any) -> None:
        """Keep the elements of a cell or a struct array: `c[0]`, `log.signals[1].values`."""
        import h5py

        if dataset.size > _MOST:
            self._left_out[name] = f"{dataset.size} cells"
            return
        for index, reference in enumerate(np.ravel(dataset[()]).tolist()):
            target = self._file[reference] if reference else None
            if not isinstance(target, h5py.Dataset):
                continue
            # a field of a struct array: the number stands behind the array, not the field
            stem, dot, field = name.rpartition(".")
            is_field = dot and "MATLAB_class" not in dataset.attrs
            here = f"{stem}[{index}].{field}" if is_field else f"{name}[{index}]"
            if not _unfit(target) and target.attrs.get("MATLAB_class", b"") != b"char":
                self._series.append(Series("", here, partial(self._read_matrix, here, target)))

    def _read_matrix(self, name: str, dataset: Any) -> NDArray[Any]:
        # MATLAB counts the other way round: its rows are the file's last dimension
        return self._read(name, dataset, "").T


def _unfit(dataset: Any) -> str:
    """Return why a dataset holds no columns, empty if it does."""
    if dataset.external or dataset.is_virtual:
        return "its data are in another file"
    if not dataset.shape or dataset.size == 0:
        return "a single value" if dataset.shape == () else "empty"
    if dataset.dtype.names is None and dataset.dtype.kind not in "iufbOS":
        return f"of type {dataset.dtype}"
    if len([size for size in dataset.shape if size > 1]) > 2:
        return f"an array of {len(dataset.shape)} dimensions"
    if dataset.id.get_storage_size() == 0:
        return "declared, but never written"
    return ""


def _column(values: NDArray[Any]) -> NDArray[Any]:
    """Return (n,) or (n, m): dimensions of length 1 are left out, unless there is but one value."""
    if values.ndim == 1:
        return values
    squeezed = values.squeeze()
    return squeezed if squeezed.ndim else values.reshape(1)


def _texts(attributes: Any) -> Iterator[tuple[str, str]]:
    """Yield the attributes that are texts or numbers."""
    for key in list(attributes)[:1000]:
        value = attributes[key]
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, (str, int, float, np.integer, np.floating)):
            yield key, str(value)[:1000]
