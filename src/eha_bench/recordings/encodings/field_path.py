"""Where a number stands inside a message: `pose.position.z`, `velocity[0]`, `velocity[motor]`."""

from __future__ import annotations

import re
from dataclasses import dataclass

_NAME = re.compile(r"[^\W\d]\w*")
_INDEX = re.compile(r"\[([^\[\]]+)\]")


@dataclass(frozen=True)
class Attribute:
    """A field of a message."""

    name: str


@dataclass(frozen=True)
class ArrayItem:
    """An element of an array, counted from 0."""

    index: int


@dataclass(frozen=True)
class NamedElement:
    """The element of this name: its own field `name`, or at its place in a list of names.

    The list (`name`, `names`, `joint_names`, ...) stands in the same message or around it.
    """

    name: str


ALIASES = {"sec": "secs", "nanosec": "nsecs", "secs": "sec", "nsecs": "nanosec"}
"""A time's fields are named otherwise in ROS 1 and ROS 2; either name is understood."""

Step = Attribute | ArrayItem | NamedElement


def is_field_name(key: str) -> bool:
    """Whether a path may name a field by this key: letters of any script, digits and `_`."""
    return _NAME.fullmatch(key) is not None


def is_element_name(key: str) -> bool:
    """Whether a path may name an element by this key in brackets: `values[press a]`."""
    return (
        _INDEX.fullmatch(f"[{key}]") is not None
        and key == key.strip().strip("\"'")
        and not key.isdecimal()
        and bool(key)
    )


def lists_names(field: str) -> bool:
    """Whether a field of texts names the elements of arrays next to it: `name`, `joint_names`."""
    return field == "name" or field.endswith("names")


@dataclass(frozen=True)
class FieldPath:
    """Steps from a message to one of its numbers."""

    steps: tuple[Step, ...]

    @classmethod
    def parse(cls, text: str) -> FieldPath:
        """Return the path that `text` writes.

        Raises:
            ValueError: the text is not of the form `name.name[index].name`.
        """
        steps: list[Step] = []
        position = 0
        while position < len(text):
            if steps and text[position] == "[":
                match = _INDEX.match(text, position)
                if match is None:
                    break
                inside = match[1].strip().strip("\"'")
                steps.append(ArrayItem(int(inside)) if inside.isdecimal() else NamedElement(inside))
            else:
                if steps and text[position] != ".":
                    break
                match = _NAME.match(text, position + bool(steps))
                if match is None:
                    break
                steps.append(Attribute(match[0]))
            position = match.end()
        if position < len(text) or not steps:
            raise ValueError(
                f"'{text}' is not a field path such as velocity[0], pose.position.z "
                "or velocity[motor]"
            )
        return cls(tuple(steps))

    def __str__(self) -> str:
        """The path as it is written."""
        parts: list[str] = []
        for step in self.steps:
            match step:
                case Attribute(name):
                    parts.append(f".{name}" if parts else name)
                case ArrayItem(index):
                    parts.append(f"[{index}]")
                case NamedElement(name):
                    parts.append(f"[{name}]")
        return "".join(parts)
