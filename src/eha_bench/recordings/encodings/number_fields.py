"""Which numbers the messages of a topic hold, as field paths: for `info` and `channels`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.decoders import make_decoder
from eha_bench.recordings.encodings.definitions import (
    Array,
    DefinitionError,
    Definitions,
    Nested,
    Primitive,
    Sequence,
    Text,
    Type,
    resolve,
    short_name,
)
from eha_bench.recordings.encodings.field_path import (
    FieldPath,
    is_element_name,
    is_field_name,
)
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.encodings.ros_decoder import definitions_of

_MOST = 64
_DEEPEST = 6
_ELEMENTS = 8
"""Elements of an array that are named; those that no message has are left out later."""
_STAMPS = ("header", "stamp", "timestamp")


def number_fields(encoded: Encoded, example: bytes) -> tuple[str, ...]:
    """Return the paths of a topic's numbers that its first message has, 64 at most.

    Raises:
        UnreadableTopic: the schema or the message cannot be read.
    """
    match encoded.encoding:
        case "cdr" | "ros1":
            found = _ros(encoded)
        case "json":
            found = _json(example)
        case "protobuf":
            found = _protobuf(encoded)
        case _:
            found = iter(())
    paths = list(islice(found, _MOST))
    if not paths or not example:
        return ()
    decoder = make_decoder(encoded, tuple(FieldPath.parse(path) for path in paths))
    message = Payloads(np.frombuffer(example, dtype=np.uint8), 1, len(example))
    decoder.decode(message, [np.empty(1) for _ in paths])
    there = decoder.found_paths()
    return tuple(path for number, path in enumerate(paths) if number in there)


def unnamed_keys(encoded: Encoded, example: bytes) -> tuple[str, ...]:
    """Return the keys of a topic's first JSON message that no field path can name."""
    if encoded.encoding != "json":
        return ()
    try:
        message = json.loads(example)
    except (ValueError, RecursionError):
        return ()
    if not isinstance(message, dict):
        return ()
    return tuple(key for key in message if not is_field_name(key))


def _ros(encoded: Encoded) -> Iterator[str]:
    definitions = definitions_of(encoded)
    name = short_name(encoded.schema_name.replace("::", "/"))
    try:
        yield from _of_type(definitions, Nested(name), "", 0)
    except DefinitionError as error:
        raise UnreadableTopic(str(error)) from error


def _of_type(definitions: Definitions, kind: Type, path: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        return
    match kind:
        case Primitive():
            if not path.endswith("structure_needs_at_least_one_member"):
                yield path
        case Nested(name):
            for field, inner in resolve(definitions, name):
                if depth == 0 and field in _STAMPS:
                    continue
                yield from _of_type(definitions, inner, f"{path}.{field}".strip("."), depth + 1)
        case Array(element, length) if not isinstance(element, Text):
            for index in range(min(length, _ELEMENTS)):
                yield from _of_type(definitions, element, f"{path}[{index}]", depth + 1)
        case Sequence(element) if not isinstance(element, Text):
            for index in range(_ELEMENTS):
                yield from _of_type(definitions, element, f"{path}[{index}]", depth + 1)
        case _:
            return


def _json(example: bytes) -> Iterator[str]:
    try:
        yield from _of_value(json.loads(example), "", 0)
    except (ValueError, RecursionError) as error:
        raise UnreadableTopic(f"a message is not JSON ({error})") from error


def _of_value(value: Any, path: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        return
    match value:
        case bool() | int() | float():
            yield path
        case dict():
            for key, inner in value.items():
                if is_field_name(key):
                    yield from _of_value(inner, f"{path}.{key}".strip("."), depth + 1)
                elif path and is_element_name(key):
                    yield from _of_value(inner, f"{path}[{key}]", depth + 1)
        case list():
            for index, inner in enumerate(value[:_ELEMENTS]):
                yield from _of_value(inner, f"{path}[{index}]", depth + 1)
        case _:
            return


def _protobuf(encoded: Encoded) -> Iterator[str]:
    from eha_bench.recordings.encodings.protobuf_decoder import message_class

    yield from _of_descriptor(message_class(encoded).DESCRIPTOR, "", 0)


def _of_descriptor(descriptor: Any, path: str, depth: int) -> Iterator[str]:
    from eha_bench.recordings.encodings.protobuf_decoder import is_repeated

    for field in descriptor.fields:
        if depth > _DEEPEST or (depth == 0 and field.name in _STAMPS):
            continue
        inner = field.message_type
        if inner is not None and inner.GetOptions().map_entry:
            continue
        names = [f"{path}.{field.name}".strip(".")]
        if is_repeated(field):
            names = [f"{names[0]}[{index}]" for index in range(_ELEMENTS)]
        for name in names:
            if inner is not None:
                yield from _of_descriptor(inner, name, depth + 1)
            elif field.cpp_type != field.CPPTYPE_STRING:
                yield name
