"""Protobuf messages as columns; the descriptor is the one in the recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableSequence, Sequence, Set
from typing import Any

# protobuf ships neither types nor stubs
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, Message
from google.protobuf.message_factory import GetMessageClass

from eha_bench.recordings.encodings.decoder import Column, Decoder, Encoded, UnreadableTopic, number
from eha_bench.recordings.encodings.field_path import ArrayItem, Attribute, FieldPath, lists_names
from eha_bench.recordings.encodings.object_path import Objects
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.naming import among


class ProtobufDecoder(Decoder):
    """Parses each message with the recording's own descriptor and follows the paths."""

    def __init__(self, encoded: Encoded, paths: tuple[FieldPath, ...]) -> None:
        self._paths = paths
        self._found: set[int] = set()
        self._class = message_class(encoded)
        self._objects = _Protobuf()
        for path in paths:
            _check(self._class, path)

    def kinds(self) -> Mapping[int, str]:
        """Return no types: Protobuf's integers do not wrap at a fixed number of bits."""
        return {}

    def found_paths(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""
        return self._found

    def hint(self, path: FieldPath) -> str:
        """Say nothing: wrong fields are refused before, so that only elements can be missing."""
        del path
        return ""

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
                value = self._objects.follow(message, path)
                if value is not None:
                    self._found.add(index)
                columns[index][row] = number(value)


def message_class(encoded: Encoded) -> type[Message]:
    """Return the class of a topic's messages.

    Raises:
        UnreadableTopic: its descriptor cannot be read.
    """
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
    """Check that a path leads to a number, so that a wrong name is not read as zero."""
    message: Any = kind.DESCRIPTOR
    field: Any = None
    many = False
    for step in path.steps:
        if isinstance(step, Attribute):
            if many:
                raise UnreadableTopic(
                    f"'.{step.name}' of an array: say which element, e.g. [0].{step.name}"
                )
            if message is None:
                raise UnreadableTopic(f"'.{step.name}' of something that has no fields")
            known = list(message.fields_by_name)
            field = message.fields_by_name.get(step.name)
            if field is None:
                raise UnreadableTopic(
                    f"{message.full_name} has no field '{step.name}'; "
                    f"{among(step.name, known, 'fields')}"
                )
            many = is_repeated(field)
            message = field.message_type
            continue
        if not many:
            raise UnreadableTopic(f"'{path}' takes an element of something that is not an array")
        many = False
        if message is not None and message.GetOptions().map_entry:
            if isinstance(step, ArrayItem):
                raise UnreadableTopic(f"'{path}' takes a number of a map: give one of its keys")
            field = message.fields_by_name["value"]
            message = field.message_type
    if many:
        raise UnreadableTopic(f"'{path}' is not a number but an array: add an index, e.g. [0]")
    if message is not None:
        fields = ", ".join(message.fields_by_name) or "none"
        raise UnreadableTopic(
            f"'{path}' is not a number but a message: add one of its fields ({fields})"
        )
    if field.cpp_type == field.CPPTYPE_STRING:
        raise UnreadableTopic(f"'{path}' is not a number but text")


def is_repeated(field: Any) -> bool:
    """Whether a field is repeated; older versions of the library say it in another way."""
    repeated = getattr(field, "is_repeated", None)
    return bool(field.label == field.LABEL_REPEATED if repeated is None else repeated)


class _Protobuf(Objects):
    """Messages, repeated fields and maps."""

    def field(self, message: Any, name: str) -> Any:
        """Return a field; None where the message cannot have it, or says that it is unset."""
        field = (
            message.DESCRIPTOR.fields_by_name.get(name) if isinstance(message, Message) else None
        )
        if field is None:
            return None
        unset = field.has_presence and not field.has_default_value and not message.HasField(name)
        return None if unset else getattr(message, name)

    def labels(self, message: Any) -> Iterator[Sequence[Any]]:
        """Yield the lists of names."""
        for name in message.DESCRIPTOR.fields_by_name:
            value = getattr(message, name)
            if lists_names(name) and not isinstance(value, (str, bytes)):
                yield self.elements(value)

    def elements(self, value: Any) -> Sequence[Any]:
        """Return the elements of a repeated field."""
        return value if isinstance(value, MutableSequence) else ()
