"""Protobuf messages as columns; the descriptor is the one in the recording."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet  # type: ignore[import-untyped]
from google.protobuf.descriptor_pool import DescriptorPool  # type: ignore[import-untyped]
from google.protobuf.message import DecodeError, Message  # type: ignore[import-untyped]
from google.protobuf.message_factory import GetMessageClass  # type: ignore[import-untyped]

from eha_bench.recordings.decoder import Column, Decoder, Encoded, UnreadableTopic, number
from eha_bench.recordings.field_path import Attribute, Element, FieldPath, NamedElement
from eha_bench.recordings.payloads import Payloads


class ProtobufDecoder(Decoder):
    """Parses each message with the recording's own descriptor and follows the paths."""

    def __init__(self, encoded: Encoded, paths: tuple[FieldPath, ...]) -> None:
        self._paths = paths
        self._found: set[int] = set()
        self._class = _message_class(encoded)
        for path in paths:
            _check(self._class, path)

    def kinds(self) -> Mapping[int, str]:
        """Return no types: Protobuf's integers do not wrap at a fixed number of bits."""
        return {}

    def found(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""
        return self._found

    def decode(self, payloads: Payloads, columns: list[Column]) -> None:
        """Write one value a message into each column.

        Raises:
            UnreadableTopic: a message does not fit the descriptor.
        """
        for row in range(payloads.count):
            message = self._class()
            try:
                message.ParseFromString(bytes(payloads.payload(row)))
            except DecodeError as error:
                raise UnreadableTopic("a message does not fit its Protobuf descriptor") from error
            for index, path in enumerate(self._paths):
                value = _follow(message, path)
                if value is not None:
                    self._found.add(index)
                columns[index][row] = number(value)


def _message_class(encoded: Encoded) -> type[Message]:
    try:
        pool = DescriptorPool()
        files = {file.name: file for file in FileDescriptorSet.FromString(encoded.schema).file}
        _add(pool, files, list(files))
        found: type[Message] = GetMessageClass(pool.FindMessageTypeByName(encoded.schema_name))
        return found
    except Exception as error:  # the library raises errors of many roots
        raise UnreadableTopic(
            f"its Protobuf descriptor cannot be read ({type(error).__name__})"
        ) from error


def _add(pool: DescriptorPool, files: dict[str, FileDescriptorProto], names: list[str]) -> None:
    """Add files after those that they depend on."""
    added: set[str] = set()
    stack = names[::-1]
    started: set[str] = set()
    while stack:
        name = stack[-1]
        if name in added or name not in files:
            stack.pop()
            continue
        needed = [
            other for other in files[name].dependency if other not in added and other in files
        ]
        if needed and name not in started:
            started.add(name)
            stack.extend(needed)
            continue
        pool.Add(files[name])
        added.add(stack.pop())


def _check(kind: type[Message], path: FieldPath) -> None:
    """Check that a path's fields exist, so that a wrong name is not read as zero."""
    descriptor: Any = kind.DESCRIPTOR
    for step in path.steps:
        if isinstance(step, Attribute):
            if descriptor is None:
                raise UnreadableTopic(f"'{path}' asks for a field of a number")
            field = descriptor.fields_by_name.get(step.name)
            if field is None:
                listed = ", ".join(descriptor.fields_by_name) or "none"
                raise UnreadableTopic(
                    f"{descriptor.full_name} has no field '{step.name}'; its fields are {listed}"
                )
            descriptor = field.message_type
    if descriptor is not None:
        raise UnreadableTopic(f"'{path}' is not a number but a message")


def _follow(message: Any, path: FieldPath) -> Any:
    here = message
    names: Any = None
    for step in path.steps:
        match step:
            case Attribute(name):
                names = getattr(here, "name", None)
                here = getattr(here, name, None)
            case Element(index):
                here = here[index] if index < _length(here) else None
            case NamedElement(name):
                labels = list(names) if _length(names) and not isinstance(names, str) else []
                index = labels.index(name) if name in labels else -1
                here = here[index] if 0 <= index < _length(here) else None
    return here


def _length(value: Any) -> int:
    return len(value) if hasattr(value, "__len__") else 0
