"""Chooses the decoder of a topic by how its messages are serialized."""

from __future__ import annotations

from eha_bench.recordings.encodings.decoder import READ_ENCODINGS, Decoder, Encoded, UnreadableTopic
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.json_decoder import JsonDecoder
from eha_bench.recordings.encodings.ros_decoder import RosDecoder


def make_decoder(encoded: Encoded, paths: tuple[FieldPath, ...]) -> Decoder:
    """Return the decoder of a topic for some of its numbers.

    Raises:
        UnreadableTopic: the encoding is not one that is read, the schema cannot be parsed, or a
            path does not lead to a number.
    """
    match encoded.encoding:
        case "cdr" | "ros1":
            return RosDecoder(encoded, paths)
        case "json":
            return JsonDecoder(paths)
        case "protobuf":
            # imported here, since it brings its own library
            from eha_bench.recordings.encodings.protobuf_decoder import ProtobufDecoder

            return ProtobufDecoder(encoded, paths)
        case other:
            raise UnreadableTopic(
                f"its messages are serialized as {other[:40]!r}; "
                f"only {', '.join(READ_ENCODINGS)} are read"
            )
