"""Message definitions of ROS 1 and ROS 2 as trees of types; text is parsed, nothing is executed.

Sources: https://wiki.ros.org/msg and https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Set
from dataclasses import dataclass
from functools import cache
from typing import Any


class DefinitionError(Exception):
    """The text is not a message definition that can be read; says why."""


@dataclass(frozen=True)
class Primitive:
    """A number or bool; `code` is NumPy's, e.g. `f8`."""

    code: str

    @property
    def size(self) -> int:
        """Size in bytes."""
        return int(self.code[1:])


@dataclass(frozen=True)
class Text:
    """A string with its length before it; wide strings have two bytes a character."""

    wide: bool = False


@dataclass(frozen=True)
class Nested:
    """A message inside a message, by name `package/Type`."""

    name: str


@dataclass(frozen=True)
class Array:
    """A fixed number of elements."""

    element: Primitive | Text | Nested
    length: int


@dataclass(frozen=True)
class Sequence:
    """A number of elements that stands before them."""

    element: Primitive | Text | Nested


Type = Primitive | Text | Nested | Array | Sequence
Fields = tuple[tuple[str, Type], ...]
Definitions = Mapping[str, Fields]

_PRIMITIVES = {
    "bool": "u1", "byte": "u1", "octet": "u1", "char": "u1",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_FIELD = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?"
    r"(?P<array>\[(?:(?:<=)?\s*\d+)?\s*\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)$"
)
_SEPARATOR = re.compile(r"^={20,}\s*$", re.MULTILINE)
_PREPROCESSOR = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
_ENUMERATION = re.compile(r"\benum\s+(\w+)")
_COMPUTED = re.compile(r"<<|>>\s*[\d(]|\bconst\b[^;=]*=[^;\"']*[*/%(~^&|]|\d{20}")
_LONGEST_IDL = 1 << 18
_TIME: Fields = (("sec", Primitive("i4")), ("nanosec", Primitive("u4")))
_ROS1_TIME: Fields = (("secs", Primitive("u4")), ("nsecs", Primitive("u4")))
_ROS1_DURATION: Fields = (("secs", Primitive("i4")), ("nsecs", Primitive("i4")))


def short_name(name: str) -> str:
    """Return `package/Type` for `package/msg/Type`."""
    parts = name.strip().split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name.strip()


def parse_msg(name: str, text: str, *, ros1: bool = False) -> Definitions:
    """Return the definitions of a concatenated `.msg` text, the first being that of `name`.

    Raises:
        DefinitionError: a line is not a field, or the text defines a service.
    """
    sections = _SEPARATOR.split(text.replace("\r\n", "\n"))
    definitions: dict[str, Fields] = {}
    for number, section in enumerate(sections):
        body = section.strip()
        title = name
        if number or body.startswith("MSG:"):
            first, _, body = body.partition("\n")
            if not first.startswith("MSG:"):
                raise DefinitionError(f"'{first[:60]}' where 'MSG: package/Type' is expected")
            title = first[4:]
        definitions[short_name(title)] = _fields(short_name(title), body, ros1)
    if ros1:
        definitions.update({"time": _ROS1_TIME, "duration": _ROS1_DURATION})
    return definitions


def _fields(owner: str, body: str, ros1: bool) -> Fields:
    fields: list[tuple[str, Type]] = []
    for raw in body.split("\n"):
        line = raw.partition("#")[0].strip()
        if not line or line.startswith("@"):
            continue
        if line == "---":
            raise DefinitionError("it defines a service, not a message")
        match = _FIELD.match(line)
        if match is None:
            raise DefinitionError(f"'{line[:60]}' is not a field")
        if match["rest"].startswith("=") and not match["array"]:
            continue  # a constant takes no space in a message
        fields.append((match["name"], _type(owner, match["type"], match["array"] or "", ros1)))
    if not fields and not ros1:
        # ROS 2 gives an empty message one byte, since IDL has no empty structure
        fields.append(("structure_needs_at_least_one_member", Primitive("u1")))
    return tuple(fields)


def _type(owner: str, name: str, array: str, ros1: bool) -> Type:
    element: Primitive | Text | Nested
    if name in _PRIMITIVES:
        element = Primitive("i1" if ros1 and name == "byte" else _PRIMITIVES[name])
    elif name in {"string", "wstring"}:
        element = Text(wide=name == "wstring")
    elif ros1 and name in {"time", "duration"}:
        element = Nested(name)
    elif name == "Header":
        element = Nested("std_msgs/Header")
    else:
        package = owner.split("/", maxsplit=1)[0]
        element = Nested(short_name(name if "/" in name else f"{package}/{name}"))
    if not array:
        return element
    digits = re.sub(r"\D", "", array)
    return Array(element, int(digits)) if digits and "<=" not in array else Sequence(element)


def parse_idl(text: str) -> Definitions:
    """Return the definitions of a ROS 2 IDL text, one file or several with rules between.

    Raises:
        DefinitionError: the text cannot be parsed.
    """
    from rosbags.typesys import get_types_from_idl

    if len(text) > _LONGEST_IDL:
        raise DefinitionError(f"its IDL has {len(text)} characters, more than {_LONGEST_IDL}")
    if _COMPUTED.search(text):
        # the parser works such constants out, however large they are
        raise DefinitionError("its IDL computes a constant, which is not read")
    types: dict[str, Any] = {}
    enumerations: set[str] = set()
    try:
        for section in _SEPARATOR.split(text.replace("\r\n", "\n")):
            body = section.strip()
            body = body.partition("\n")[2] if body[:4] == "IDL:" else body
            body = _PREPROCESSOR.sub("", body)
            if body.strip():
                types.update(get_types_from_idl(body))
                enumerations.update(_ENUMERATION.findall(body))
    except Exception as error:  # the parser has no common error root
        raise DefinitionError(f"its IDL cannot be parsed ({type(error).__name__})") from error
    return _from_rosbags(types, enumerations)


@cache
def standard() -> Definitions:
    """Return the definitions that every ROS 2 has, for logs that carry none."""
    from rosbags.typesys import Stores, get_typestore

    return {
        **_from_rosbags(get_typestore(Stores.LATEST).fielddefs),
        "builtin_interfaces/Time": _TIME,
        "builtin_interfaces/Duration": _TIME,
    }


def resolve(definitions: Definitions, name: str) -> Fields:
    """Return the fields of a message type, from the log or from the standard ones.

    Raises:
        DefinitionError: it is not defined.
    """
    fields = definitions.get(name)
    if fields is None:
        fields = standard().get(name)
    if fields is None:
        what = f"type '{name}' is not defined in the recording" if name else "it has no schema"
        raise DefinitionError(what)
    return fields


def _from_rosbags(types: Mapping[str, Any], enumerations: Set[str] = frozenset()) -> Definitions:
    return {
        short_name(name): tuple((field, _convert(kind, enumerations)) for field, kind in fields)
        for name, (_, fields) in types.items()
    }


def _convert(description: Any, enumerations: Set[str]) -> Type:
    node, content = description
    match node.name:
        case "BASE":
            base = content[0]
            if base in {"string", "wstring"}:
                return Text(wide=base == "wstring")
            if base not in _PRIMITIVES:
                raise DefinitionError(f"type '{base}' is not supported")
            return Primitive(_PRIMITIVES[base])
        case "NAME" if content.split("/")[-1] in enumerations:
            return Primitive("u4")
        case "NAME":
            return Nested(short_name(content))
        case kind:
            element = _convert(content[0], enumerations)
            if isinstance(element, (Array, Sequence)):
                raise DefinitionError("an array of arrays is not supported")
            return Array(element, content[1]) if kind == "ARRAY" else Sequence(element)
