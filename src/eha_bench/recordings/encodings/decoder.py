"""From messages of one channel to columns of numbers, whatever their encoding."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Set
from dataclasses import dataclass
from typing import Any

from eha_bench.core.arrays import FloatArray
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.naming import printable

Column = FloatArray

READ_ENCODINGS = ("cdr", "ros1", "json", "protobuf")


class UnreadableTopic(Exception):
    """A topic that cannot be decoded; says why, without the topic's name."""


@dataclass(frozen=True)
class Encoded:
    """What a log says of a topic's messages.

    Attributes:
        encoding: `cdr`, `ros1`, `json`, `protobuf`.
        schema_name: name of the type.
        schema_encoding: `ros2msg`, `ros2idl`, `ros1msg`, `jsonschema`, `protobuf` or empty.
        schema: the definition.
    """

    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class Decoder(ABC):
    """Reads the wanted numbers out of messages; missing elements are NaN."""

    @abstractmethod
    def kinds(self) -> Mapping[int, str]:
        """Return the NumPy types that the paths were seen with, by their number."""

    @abstractmethod
    def found_paths(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""

    @abstractmethod
    def hint(self, path: FieldPath) -> str:
        """Return what the messages have instead of a path that none of them has, or nothing."""

    @abstractmethod
    def decode(self, payloads: Payloads, columns: list[Column]) -> None:
        """Write one value a message into each column (one a path, each (n,)).

        Raises:
            UnreadableTopic: a message does not fit its definition.
        """


def number(value: Any) -> float:
    """Return a decoded value as float; NaN where there is none.

    Raises:
        UnreadableTopic: it is not a number.
    """
    if value is None:
        return float("nan")
    if isinstance(value, (bool, int, float)):
        try:
            return float(value)
        except OverflowError as error:
            raise UnreadableTopic("a value is too large for a number") from error
    raise UnreadableTopic(f"a value is not a number but {_type_name(value)}")


def _type_name(value: Any) -> str:
    """Return what the author of a log would call a value."""
    match value:
        case str():
            return f"the text {printable([value[:40]])!r}"
        case bytes():
            return "bytes"
        case Mapping():
            return "a message: add one of its fields"
        case Collection():
            return "an array: add an index, e.g. [0]"
        case _:
            return type(value).__name__
