"""JSON messages as columns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Set
from typing import Any

from eha_bench.recordings.decoder import Column, Decoder, UnreadableTopic, number
from eha_bench.recordings.field_path import ALIASES, Attribute, Element, FieldPath, NamedElement
from eha_bench.recordings.payloads import Payloads


class JsonDecoder(Decoder):
    """Parses each message and follows the paths; a field that is not there is NaN."""

    def __init__(self, paths: tuple[FieldPath, ...]) -> None:
        self._paths = paths
        self._found: set[int] = set()

    def kinds(self) -> Mapping[int, str]:
        """Return no types: JSON has only numbers."""
        return {}

    def found(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""
        return self._found

    def decode(self, payloads: Payloads, columns: list[Column]) -> None:
        """Write one value a message into each column.

        Raises:
            UnreadableTopic: a message is not JSON, or a value is not a number.
        """
        for row in range(payloads.count):
            try:
                message = json.loads(bytes(payloads.payload(row)))
            except (ValueError, RecursionError) as error:
                raise UnreadableTopic(f"a message is not JSON ({error})") from error
            for index, path in enumerate(self._paths):
                value = follow(message, path)
                if value is not None:
                    self._found.add(index)
                columns[index][row] = number(value)


def follow(message: Any, path: FieldPath) -> Any:
    """Return what a path leads to in nested dicts and lists; None if nothing is there."""
    here = message
    names: Any = None
    for step in path.steps:
        match step:
            case Attribute(name):
                if not isinstance(here, dict):
                    return None
                names = here.get("name")
                here = here.get(name, here.get(ALIASES.get(name, "")))
            case Element(index):
                here = here[index] if isinstance(here, list) and index < len(here) else None
            case NamedElement(name):
                index = names.index(name) if isinstance(names, list) and name in names else -1
                here = here[index] if isinstance(here, list) and 0 <= index < len(here) else None
    return here
