"""MDF files (ASAM MDF 4, and 3): channel groups with their own clocks, and CAN frames by a DBC."""

from __future__ import annotations

import html
import json
import mmap
import re
import weakref
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.channel_map import ChannelMap
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.tables.library import reading_with
from eha_bench.recordings.tables.mdf_blocks import stored_bytes
from eha_bench.recordings.track import Stamps

OWN: Final = "written by eha-bench"
"""How the comment of a file begins whose time has its zero where the recording had it."""
_OWN = re.compile(rf"{OWN}: (\{{.*?\}})\s*(?:</TX>|$)", re.DOTALL)
_MESSAGE = re.compile(r"message (?P<name>\w+)")
_MASTERS = (2, 3)
"""Channel types of a group's clock: measured, and counted."""


class MdfSource(GroupedTable):
    """An MDF file.

    A channel group shares a clock, which is its master channel. Raw CAN frames are decoded where
    `channels.yaml` names a DBC: each message is then a group, each signal a column of it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with reading_with("asammdf", "mdf", self.path):
            from asammdf import MDF
            from asammdf.blocks import mdf_v3, mdf_v4

            for kind in (mdf_v3.MDF3, mdf_v4.MDF4):
                _calm(kind)
            self._log = MDF(path)
            weakref.finalize(self, self._log.close)
            header = self._log.header
            self._start = int(getattr(header, "abs_time", 0) or 0)
            comment = str(getattr(header, "comment", "") or "")
            self._take(self._log)
            self._look_for_more(self._log)
        self._comment: dict[str, str] = {"comment": comment[:1000]} if comment else {}
        own = _OWN.search(html.unescape(comment))
        if own is not None:
            self.own_epoch = self._start
            self._comment = _metadata(own[1])
        self._decoded: Any = None
        if not self._series:
            raise RecordingError("it holds no numbers", where=Place(file=self.path))

    @property
    def format(self) -> str:
        """`mdf`."""
        return "mdf"

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """The comment of the file, or what a recording of ours held as metadata."""
        return {"mdf": self._comment} if self._comment else {}

    def in_columns(self, mapping: ChannelMap) -> ChannelMap:
        """Return the map by columns; CAN frames are decoded where it names a DBC.

        Raises:
            RecordingError: a DBC cannot be read, or nothing in the log fits it.
        """
        if mapping.dbc and self._decoded is None:
            self._decode(mapping.dbc)
        return super().in_columns(mapping)

    def _decode(self, files: tuple[str, ...]) -> None:
        with reading_with("asammdf", "mdf", self.path):
            pairs = [(file, 0) for file in files]  # 0: frames of every bus
            self._decoded = self._log.extract_bus_logging({"CAN": pairs})
            self._take(self._decoded)
        if not self._decoded.groups:
            raise RecordingError(
                f"no CAN frame of the log fits {', '.join(Path(file).name for file in files)}",
                where=Place(file=self.path),
                hint="check 'dbc' in channels.yaml",
            )
        self.forget_names()

    def _take(self, log: Any) -> None:
        """Keep the channels of a log."""
        taken: set[str] = {series.group for series in self._series}
        for number, group in enumerate(log.groups):
            name = _group_name(group, number)
            while name in taken:
                name = f"{name} ({number})"
            taken.add(name)
            rows = int(group.channel_group.cycles_nr)
            if not rows:
                continue
            master = log.masters_db.get(number)
            for index, channel in enumerate(group.channels):
                if index == master or channel.channel_type in _MASTERS:
                    continue
                read = partial(self._samples, log, number, index, rows)
                unit = str(getattr(channel, "unit", "") or "") or _converted_unit(channel)
                self._series.append(Series(name, channel.name, read, unit or None))
            if master is not None:
                self._clocks[name] = partial(self._stamps_of, log, number, rows)
            elif name:
                self._notes.append(f"the group '{name[:80]}' has no clock")

    def _look_for_more(self, log: Any) -> None:
        """Compare what the groups declare with what their data hold."""
        if not self._series or str(log.version) < "4":
            return
        with self._path.open("rb") as stream:
            content = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        for number, group in enumerate(log.groups):
            head = group.channel_group
            record = int(head.samples_byte_nr + head.invalidation_bytes_nr)
            if group.data_group.record_id_len or not record:
                continue  # records of several groups lie among each other
            stored = stored_bytes(content, int(group.data_group.data_block_addr))
            if stored is not None and stored // record > head.cycles_nr:
                self._torn = True
                self._notes.append(
                    f"the group '{_group_name(group, number)[:80]}' declares {head.cycles_nr} "
                    f"samples, its data hold {stored // record}: what is beyond the count was "
                    "not read"
                )

    def _samples(self, log: Any, group: int, index: int, rows: int) -> NDArray[Any]:
        """Return the physical values of a channel; NaN where they are marked as invalid."""
        budget().hold(64 * rows, "a channel")
        with reading_with("asammdf", "mdf", self.path):
            found = log.get(group=group, index=index, ignore_invalidation_bits=True)
            if found.samples.dtype.kind in "SUO":  # a table of words behind numbers
                found = log.get(group=group, index=index, raw=True, ignore_invalidation_bits=True)
        values: NDArray[Any] = found.samples
        if values.dtype.names is not None:
            raise RecordingError(
                f"'{found.name[:80]}' holds records, no numbers", where=Place(file=self.path)
            )
        if len(values) != rows:
            self._torn = True
            raise RecordingError(
                f"'{found.name[:80]}' holds {len(values)} samples, not the {rows} declared",
                where=Place(file=self.path),
                hint="the file may be cut: record or export it again",
            )
        invalid = found.invalidation_bits
        if invalid is not None and np.any(invalid):
            values = np.where(np.asarray(invalid, dtype=bool), np.nan, values.astype(np.float64))
            self._notes.append(
                f"'{found.name[:80]}': {int(np.count_nonzero(invalid))} samples are marked as "
                "invalid; they are NaN"
            )
        return values

    def _seconds_of(self, log: Any, group: int, rows: int) -> FloatArray:
        with reading_with("asammdf", "mdf", self.path):
            seconds = np.asarray(log.get_master(group), dtype=np.float64)
        if len(seconds) != rows or not np.all(np.abs(seconds) < 2**32):
            self._torn = True
            raise RecordingError(
                "the clock of a channel group is damaged", where=Place(file=self.path)
            )
        return seconds

    def _stamps_of(self, log: Any, group: int, rows: int) -> Stamps:
        seconds = self._seconds_of(log, group, rows)
        stamps: Stamps = np.rint(seconds * 1e9).astype(np.int64)
        self.exact_seconds[_group_name(log.groups[group], group)] = seconds
        return stamps + np.int64(self._start if 0 <= self._start < 2**62 else 0)


def _calm(kind: Any) -> None:
    """Let the library's destructor fail silently: it expects a log whose opening succeeded."""
    original = kind.__del__
    if original.__module__ == __name__:
        return

    def close(log: Any) -> None:
        with suppress(Exception):
            original(log)

    kind.__del__ = close


def _metadata(text: str) -> dict[str, str]:
    try:
        return {str(key): str(value) for key, value in json.loads(text).items()}
    except (ValueError, RecursionError, AttributeError):
        return {}


def _group_name(group: Any, number: int) -> str:
    """Return the name of a channel group: of its message, its own, its comment, or its number."""
    head = group.channel_group
    comment = str(getattr(head, "comment", "") or "").strip()
    acquired = str(getattr(head, "acq_name", "") or "").strip()
    message = _MESSAGE.search(comment)
    if message is not None and acquired.startswith("CAN"):
        return message["name"]
    name = acquired or comment.partition("\n")[0]
    return name[:200].strip() or f"group {number}"


def _converted_unit(channel: Any) -> str:
    conversion = getattr(channel, "conversion", None)
    return str(getattr(conversion, "unit", "") or "") if conversion is not None else ""
