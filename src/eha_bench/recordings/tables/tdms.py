"""TDMS files of LabVIEW: channels in groups, with the clock of a waveform or a column of times."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.tables.library import reading_with
from eha_bench.recordings.track import Stamps

_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units", "Units")


class TdmsSource(GroupedTable):
    """A TDMS file; waveforms know their rate, other channels need a column of times."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading_with("nptdms", "tdms", self.path):
            from nptdms import TdmsFile

            stream = path.open("rb")  # the library leaves its own open where it fails
            weakref.finalize(self, stream.close)
            self._size = path.stat().st_size
            self._file = TdmsFile.open(stream, raw_timestamps=False)
            for group in self._file.groups():
                clocks: dict[tuple[Any, ...], str] = {}
                for channel in group.channels():
                    self._keep(group.name, channel, clocks)
            self._properties = {
                str(key): str(value)[:1000] for key, value in self._file.properties.items()
            }
            self._look_for_damage()
        if not self._series:
            raise RecordingError("it holds no numbers", where=Place(file=self.path))

    @property
    def format(self) -> str:
        """`tdms`."""
        return "tdms"

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The properties of the file."""
        return {"tdms": self._properties} if self._properties else {}

    def _look_for_damage(self) -> None:
        status = self._file.file_status
        if status.incomplete_final_segment:
            self._torn = True
            self._notes.append("its last segment was not finished; what of it is whole was read")
            return
        for path, item in (status.channel_statuses or {}).items():
            if item.expected_length != item.read_length:
                self._torn = True
                self._notes.append(
                    f"its last segment declares {item.expected_length} samples of {path[:80]} and "
                    f"holds {item.read_length}: its counts are damaged, and values may be another "
                    "channel's"
                )

    def _keep(self, group: str, channel: Any, clocks: dict[tuple[Any, ...], str]) -> None:
        dtype = channel.dtype
        if dtype is not None and len(channel) * np.dtype(dtype).itemsize > self._size:
            # nothing in a TDMS is compressed
            raise RecordingError(
                f"'{channel.name[:80]}' declares {len(channel)} samples, more than it can hold",
                where=Place(file=self.path),
                hint="the file is damaged: record it again",
            )
        if not len(channel) or dtype is None or np.dtype(dtype).kind not in "iufbM":
            return
        properties = channel.properties
        unit = next((str(properties[key]) for key in _UNITS if properties.get(key)), None)
        increment = properties.get("wf_increment")
        shared = group
        if isinstance(increment, (int, float)) and 0 < increment < 1e9:
            key = (
                float(increment),
                float(properties.get("wf_start_offset", 0.0) or 0.0),
                str(properties.get("wf_start_time", "")),
                len(channel),
            )
            # waveforms of one group may tick at different rates
            shared = clocks.setdefault(key, f"{group} ({len(clocks) + 1})" if clocks else group)
            self._clocks[shared] = partial(_waveform, channel)
        read = partial(self._read, channel)
        self._series.append(Series(group, channel.name, read, unit, shared))

    def _read(self, channel: Any) -> NDArray[Any]:
        size = np.dtype(channel.dtype).itemsize * len(channel)
        budget().hold(size, f"'{channel.name[:80]}'")
        with reading_with("nptdms", "tdms", self.path):
            values: NDArray[Any] = np.asarray(channel[:])
        if len(values) != len(channel):
            self._torn = True
            raise RecordingError(
                f"'{channel.name[:80]}' holds {len(values)} samples, not {len(channel)}",
                where=Place(file=self.path),
            )
        return values


def _waveform(channel: Any) -> Stamps:
    """Return the stamps of a waveform by its start, offset and increment."""
    properties = channel.properties
    start = properties.get("wf_start_time")
    epoch = 0
    if isinstance(start, np.datetime64) and not np.isnat(start):
        epoch = int(start.astype("datetime64[ns]").astype(np.int64))
    offset = float(properties.get("wf_start_offset", 0.0) or 0.0)
    seconds = offset + float(properties["wf_increment"]) * np.arange(len(channel))
    if not np.all(np.abs(seconds[[0, -1]]) < 1e9) or abs(epoch) > 2**62:
        raise RecordingError(f"the waveform '{channel.name[:80]}' has a time out of range")
    stamps: Stamps = np.rint(seconds * 1e9).astype(np.int64) + np.int64(max(epoch, 0))
    return stamps
