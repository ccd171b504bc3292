"""Readings of a size that no sensor has: marks of invalid samples, or a column of another scale."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.errors import Place, RecordingError
from eha_bench.core.finite import LARGEST
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording

_HARDLY_ELSE = 0.9
"""Share of a channel's readings that are not zero, from which it is no sensor's at all."""


def without_marks(recording: Recording) -> Recording:
    """Return a recording whose few readings beyond all sensors are missing, with a note of each.

    Loggers mark samples that are invalid by the largest number there is. A channel with hardly any
    other reading is left as it is: `refuse_beyond_sensors` says so where it is needed.
    """
    values, notes = {}, []
    for name, column in recording.values.items():
        beyond = _beyond(column)
        if not beyond.any() or _is_hardly_else(column, beyond):
            continue
        values[name] = np.where(beyond, np.nan, column)
        unit = recording.unit(name)
        text = "readings of '{channel}' beyond all sensors ({value:.3g}{unit}), taken as missing: "
        notes.append(
            Note(
                text + "{count:d}",
                channel=name,
                value=float(column[int(np.argmax(beyond))]),
                unit=f" {unit}" if unit else "",
                count=int(beyond.sum()),
            )
        )
    if not values:
        return recording
    return replace(recording.with_values(values), notes=(*recording.notes, *notes))


def refuse_beyond_sensors(recording: Recording, names: Iterable[str], where: Place) -> None:
    """Refuse channels that hold readings whose squares are no numbers any more.

    Raises:
        RecordingError: a channel has one.
    """
    for name in names:
        if name not in recording:
            continue
        beyond = _beyond(recording[name])
        if beyond.any():
            first = int(np.argmax(beyond))
            read = f"{recording[name][first]:.3g} {recording.unit(name)}".rstrip()
            raise RecordingError(
                f"'{name}' reads {read}, as no sensor does",
                where=where._replace(time=float(recording.time[first])),
                hint="check its column, unit and scale in channels.yaml",
            )


def _beyond(column: FloatArray) -> BoolArray:
    """Return where a channel is finite and beyond all sensors, (n,)."""
    return np.asarray(np.isfinite(column) & (np.abs(column) > LARGEST))


def _is_hardly_else(column: FloatArray, beyond: BoolArray) -> bool:
    read = np.count_nonzero(np.isfinite(column) & (column != 0.0))
    return bool(np.count_nonzero(beyond) >= _HARDLY_ELSE * read)
