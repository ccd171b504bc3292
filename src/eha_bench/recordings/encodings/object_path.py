"""Follows field paths in messages that are parsed into objects (JSON, Protobuf)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eha_bench.recordings.encodings.field_path import ArrayItem, Attribute, FieldPath, NamedElement


class Objects(ABC):
    """What it takes to look into parsed messages of one kind."""

    @abstractmethod
    def field(self, message: Any, name: str) -> Any:
        """Return a field of a message, None if it has none of this name."""

    @abstractmethod
    def labels(self, message: Any) -> Iterator[Sequence[Any]]:
        """Yield the lists of names that a message holds."""

    @abstractmethod
    def elements(self, value: Any) -> Sequence[Any]:
        """Return the elements of an array; none if it is something else."""

    def follow(self, message: Any, path: FieldPath) -> Any:
        """Return what a path leads to; None if nothing is there."""
        here = message
        around: list[Any] = []
        for step in path.steps:
            match step:
                case Attribute(name):
                    around.append(here)
                    here = self.field(here, name)
                case ArrayItem(index):
                    elements = self.elements(here)
                    here = elements[index] if index < len(elements) else None
                case NamedElement(name):
                    here = self._element_by_name(here, name, around)
            if here is None:
                return None
        return here

    def _element_by_name(self, value: Any, name: str, around: list[Any]) -> Any:
        """Return an element by a key, by its own name, or by a list of names around it."""
        if isinstance(value, Mapping):
            return value.get(name)
        elements = self.elements(value)
        for element in elements:
            if self.field(element, "name") == name:
                return element
        for message in reversed(around):
            for labels in self.labels(message):
                index = next((k for k, label in enumerate(labels) if label == name), len(elements))
                if index < len(elements):
                    return elements[index]
        return None
