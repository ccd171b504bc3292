"""The wide message that eha_bench writes every tick: schema, layout, and the records around it.

One message a tick with all channels is several times smaller and faster than a topic a channel.
`time` is stored as it is, next to the stamps in nanoseconds, so that it survives bit for bit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import RecordingError
from eha_bench.recordings.checksum import crc32
from eha_bench.recordings.mcap.demux import MESSAGE, MESSAGE_HEAD

VERSION: Final = "1"
TOPIC: Final = "/eha_bench/sample"
SCHEMA_NAME: Final = "eha_bench_msgs/msg/Sample"

FORMAT: Final = "eha_bench.format"
FIELDS: Final = "eha_bench.fields"
UNITS: Final = "eha_bench.units"
METADATA: Final = "eha_bench.metadata"
NOTES: Final = "eha_bench.notes"

CHECK: Final = "crc32"

TIME: Final = "time"
NANOSECONDS: Final = 1_000_000_000
_FIELD: Final = re.compile(r"^float64 (\w+) # (.*?)(?:: .*| since .*)?$", re.MULTILINE)
_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
# encapsulation (little-endian CDR), stamp, frame_id "" with its length, padding to 8 bytes
_CDR_HEAD: Final = 20


@dataclass(frozen=True)
class WideMessage:
    """The fields of the wide message.

    Attributes:
        channels: channel names, in order.
        fields: ROS field names, one a channel.
        units: SI units, one a channel.
    """

    channels: tuple[str, ...]
    fields: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def of(cls, units: Mapping[str, str]) -> WideMessage:
        """Return the message that holds channels with these SI units."""
        taken = {"header", TIME}
        fields = []
        for name in units:
            field = _field_name(name)
            unique, number = field, 2
            while unique in taken:
                unique, number = f"{field}_{number}", number + 1
            taken.add(unique)
            fields.append(unique)
        return cls(tuple(units), tuple(fields), tuple(units.values()))

    @property
    def schema(self) -> bytes:
        """The ros2msg definition with its dependencies; units stand in comments."""
        lines = [
            "# One tick of a trial: all channels at one time, SI units.",
            "std_msgs/Header header",
            f"float64 {TIME} # s since the recording's epoch",
        ]
        for channel, field, unit in zip(self.channels, self.fields, self.units, strict=True):
            known = CHANNELS.get(channel)
            meaning = known.description if known else f"channel {channel}"
            lines.append(f"float64 {field} # {_comment(f'{unit or 1}: {meaning}')}")
        return ("\n".join(lines) + "\n" + _HEADER).encode()

    @property
    def declared_units(self) -> dict[str, str]:
        """The units that the definition gives, by field."""
        return {
            field: _comment(unit or "1")
            for field, unit in zip(self.fields, self.units, strict=True)
        }

    @property
    def record(self) -> np.dtype[np.void]:
        """One MCAP message record: frame, stamps, CDR payload; packed."""
        return np.dtype(
            [
                ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
                ("log_time", "<u8"), ("publish_time", "<u8"),
                ("cdr", "<u4"), ("sec", "<i4"), ("nanosec", "<u4"), ("frame_id", "<u4"),
                ("padding", "<u4"), (TIME, "<f8"), ("values", "<f8", (len(self.channels),)),
            ]
        )  # fmt: skip

    def records(self, count: int, channel: int) -> np.ndarray:
        """Return `count` records with everything filled in that never changes."""
        records = np.zeros(count, dtype=self.record)
        records["opcode"] = MESSAGE
        records["length"] = MESSAGE_HEAD + _CDR_HEAD + 8 * (1 + len(self.channels))
        records["channel"] = channel
        records["cdr"] = 0x0100  # bytes 00 01 00 00: plain CDR, little-endian
        records["frame_id"] = 1  # an empty string is its closing zero alone
        return records

    def metadata(self, epoch_ns: int) -> dict[str, dict[str, str]]:
        """Return the metadata records that say what the fields are, by record name."""
        fields = dict(zip(self.fields, self.channels, strict=True))
        units = dict(zip(self.channels, self.units, strict=True))
        described = {"version": VERSION, "epoch_ns": str(epoch_ns)}
        check = checksum(described, fields, units)
        return {FORMAT: {**described, CHECK: check}, FIELDS: fields, UNITS: units}


def checksum(*records: Mapping[str, str]) -> str:
    """Return the CRC-32 of what names and units are, for a file that was never closed."""
    return f"{crc32(repr([list(record.items()) for record in records]).encode()):08x}"


def description_problem(records: Mapping[str, Mapping[str, str]], schema: bytes) -> str:
    """Say whether names and units of the channels are damaged; empty if they are not.

    They stand in the metadata and once more in the message's definition, which is compared.
    """
    fields, units = records.get(FIELDS, {}), records.get(UNITS, {})
    described = {key: value for key, value in records[FORMAT].items() if key != CHECK}
    check = records[FORMAT].get(CHECK)
    strange = described.keys() - {"version", "epoch_ns"}
    if strange or (check is not None and check != checksum(described, fields, units)):
        return "the names or units of its channels are damaged (their checksum is wrong)"
    if list(fields.values()) != list(units):
        return "the names of its channels are damaged: they are not those that have a unit"
    written = WideMessage(tuple(units), tuple(fields), tuple(units.values())).declared_units
    found = dict(_FIELD.findall(schema.decode("utf-8", "replace")))
    if {name: found.get(name) for name in written} != written:
        return "the names or units of its channels are damaged: the message's definition has others"
    return ""


def is_own(records: Mapping[str, Mapping[str, str]]) -> bool:
    """Whether the metadata records of an MCAP file are those of eha_bench."""
    return FORMAT in records and FIELDS in records


def log_times(time: np.ndarray, epoch_ns: int) -> np.ndarray:
    """Return stamps in ns since 1970, shape (n,) uint64; shifted up where they would be negative.

    Raises:
        RecordingError: the time is too far away for a stamp.
    """
    relative = np.rint(np.asarray(time, dtype=np.float64) * 1e9)
    low, high = (float(relative.min()), float(relative.max())) if relative.size else (0.0, 0.0)
    base = epoch_ns if epoch_ns + low >= 0 else -int(low)
    if not (abs(low) < 2**62 and abs(high) < 2**62 and 0 <= base < 2**62):
        raise RecordingError(f"a time of {high / 1e9:.6g} s after {epoch_ns} ns has no stamp")
    return (relative.astype(np.int64) + np.int64(base)).astype(np.uint64)


def stamp(records: np.ndarray, stamps: np.ndarray) -> None:
    """Write stamps (n,) uint64 ns into records as log time, publish time and header.stamp."""
    records["log_time"] = stamps
    records["publish_time"] = stamps
    # header.stamp has 31 bits of seconds: it wraps in 2038, the other stamps do not
    records["sec"] = (stamps // NANOSECONDS).astype(np.uint32).view(np.int32)
    records["nanosec"] = stamps % NANOSECONDS


def checked_units(units: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Return the unit of each channel.

    Raises:
        RecordingError: a channel is called `time`, which is the name of the clock.
    """
    if TIME in names:
        raise RecordingError("a channel cannot be called 'time'")
    return {name: units.get(name, "") for name in names}


def _field_name(channel: str) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", channel.lower()).strip("_")
    return name if name[:1].isalpha() else f"channel_{name}".rstrip("_")


def _comment(text: str) -> str:
    return " ".join(text.split())
