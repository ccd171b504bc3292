"""From messages of one channel to columns of numbers, whatever their encoding."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eha_bench.recordings.field_path import FieldPath
from eha_bench.recordings.payloads import Payloads

Column = NDArray[np.float64]


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
    def found(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""

    @abstractmethod
    def decode(self, payloads: Payloads, columns: list[Column]) -> None:
        """Write one value a message into each column (one a path, each (n,)).

        Raises:
            UnreadableTopic: a message does not fit its definition.
        """


def make_decoder(encoded: Encoded, paths: tuple[FieldPath, ...]) -> Decoder:
    """Return the decoder of a topic for some of its numbers.

    Raises:
        UnreadableTopic: the encoding is not one that is read, the schema cannot be parsed, or a
            path does not lead to a number.
    """
    # imported here: each encoding brings its own library
    match encoded.encoding:
        case "cdr" | "ros1":
            from eha_bench.recordings.ros_decoder import RosDecoder

            return RosDecoder(encoded, paths)
        case "json":
            from eha_bench.recordings.json_decoder import JsonDecoder

            return JsonDecoder(paths)
        case "protobuf":
            from eha_bench.recordings.protobuf_decoder import ProtobufDecoder

            return ProtobufDecoder(encoded, paths)
        case other:
            raise UnreadableTopic(
                f"its messages are serialized as {other[:40]!r}; "
                f"only {', '.join(READ_ENCODINGS)} are read"
            )


def number(value: Any) -> float:
    """Return a decoded value as float; NaN where there is none.

    Raises:
        UnreadableTopic: it is not a number.
    """
    if value is None:
        return float("nan")
    if isinstance(value, (bool, int, float)):
        return float(value)
    raise UnreadableTopic(f"a value is {type(value).__name__}, not a number")
