"""ULog files of PX4: topics with fields, each message with its own time."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.budget import budget
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.tables.library import reading_with
from eha_bench.recordings.track import Stamps

_FILE_HEAD: Final = 16
_HEAD: Final = struct.Struct("<HB")
"""Of a message: its length and kind."""
_SUBSCRIBED: Final = struct.Struct("<BH")
"""Which instance of a topic has which number; its name follows."""
_SUBSCRIPTION: Final = ord("A")
_KINDS: Final = frozenset(b"BFIMPQADRLCSO")
_TIMES = 8
"""Messages take so many times their size in the file while they are read."""


class UlogSource(GroupedTable):
    """A ULog file: `topic: actuator_outputs, field: "output[0]"`; a second instance is `..._1`."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        budget().hold(_TIMES * path.stat().st_size, "the log")
        self._refuse_doubles(path)
        with reading_with("pyulog", "ulog", self.path):
            from pyulog import ULog

            log = ULog(str(path))
            for data in log.data_list:
                group = f"{data.name}_{data.multi_id}" if data.multi_id else data.name
                self._keep(group, data.data)
            self._info = {str(key): str(value)[:1000] for key, value in log.msg_info_dict.items()}
            dropouts = [dropout.duration for dropout in log.dropouts]
            if log.file_corruption:
                self._torn = True
                self._notes.append("the log is damaged; what pyulog could read of it was read")
        if dropouts:
            self._notes.append(
                f"the logger lost messages {len(dropouts)} times, {sum(dropouts)} ms in total"
            )
        if not self._series:
            raise RecordingError("the log holds no messages", where=Place(file=self.path))

    @property
    def format(self) -> str:
        """`ulog`."""
        return "ulog"

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """What the log says of its system."""
        return {"ulog": self._info} if self._info else {}

    def _refuse_doubles(self, path: Path) -> None:
        """Refuse a log that gives two topics one number: the library would mix their messages."""
        topics: dict[int, bytes] = {}
        size = path.stat().st_size
        with (
            path.open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as log,
        ):
            place = _FILE_HEAD
            while place + _HEAD.size <= size:
                length, kind = _HEAD.unpack_from(log, place)
                place += _HEAD.size
                if kind not in _KINDS:
                    return  # damaged from here on, which the library finds as well
                if kind == _SUBSCRIPTION and _SUBSCRIBED.size <= length <= size - place:
                    instance, number = _SUBSCRIBED.unpack_from(log, place)
                    named = log[place + _SUBSCRIBED.size : place + length] + bytes([instance])
                    if topics.setdefault(number, named) != named:
                        one, other = (
                            text[:-1].decode("utf-8", "replace")[:80]
                            for text in (topics[number], named)
                        )
                        raise RecordingError(
                            f"topic {number} is declared twice, as '{one}' and '{other}'",
                            where=Place(file=self.path),
                            hint="the file is damaged: its messages cannot be told apart",
                        )
                place += length
                budget().tick()

    def _keep(self, group: str, fields: Mapping[str, NDArray[Any]]) -> None:
        stamps = fields.get("timestamp")
        if stamps is None or not len(stamps):
            return
        self._clocks[group] = partial(_nanoseconds, stamps, group)
        for name, values in fields.items():
            if name != "timestamp" and values.dtype.kind in "iufb":
                self._series.append(Series(group, name, partial(_as_they_are, values)))


def _as_they_are(values: NDArray[Any]) -> NDArray[Any]:
    return values


def _nanoseconds(stamps: NDArray[Any], group: str) -> Stamps:
    """Return stamps in microseconds as nanoseconds."""
    if stamps.max() >= 2**62 // 1000:
        raise RecordingError(f"topic '{group[:80]}' has a time out of range")
    return stamps.astype(np.int64) * np.int64(1000)
