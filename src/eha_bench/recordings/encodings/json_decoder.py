"""JSON messages as columns."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any

from eha_bench.recordings.encodings.decoder import Column, Decoder, UnreadableTopic, number
from eha_bench.recordings.encodings.field_path import ALIASES, Attribute, FieldPath, lists_names
from eha_bench.recordings.encodings.object_path import Objects
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.naming import among


class JsonDecoder(Decoder):
    """Parses each message and follows the paths; a field that is not there is NaN."""

    def __init__(self, paths: tuple[FieldPath, ...]) -> None:
        self._paths = paths
        self._found: set[int] = set()
        self._objects = _Json()
        self._example: Any = None

    def kinds(self) -> Mapping[int, str]:
        """Return no types: JSON has only numbers."""
        return {}

    def found_paths(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""
        return self._found

    def hint(self, path: FieldPath) -> str:
        """Say which keys stand where the path leaves the first message."""
        here = self._example
        for count, step in enumerate(path.steps):
            if isinstance(here, dict) and isinstance(step, Attribute):
                if self._objects.field(here, step.name) is None:
                    return among(step.name, map(str, here), "fields")
            elif isinstance(here, list) and not isinstance(step, Attribute):
                return f"the first message has {len(here)} elements there"
            here = self._objects.follow(self._example, FieldPath(path.steps[: count + 1]))
        return ""

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
            if self._example is None:
                self._example = message
            for index, path in enumerate(self._paths):
                value = self._objects.follow(message, path)
                if value is not None:
                    self._found.add(index)
                columns[index][row] = number(value)


class _Json(Objects):
    """Nested dicts and lists."""

    def field(self, message: Any, name: str) -> Any:
        """Return a value by its key; a time's fields go by either name."""
        if not isinstance(message, dict):
            return None
        return message[name] if name in message else message.get(ALIASES.get(name, ""))

    def labels(self, message: Any) -> Iterator[Sequence[Any]]:
        """Yield the lists of names."""
        for name, value in message.items() if isinstance(message, dict) else ():
            if lists_names(name) and isinstance(value, list):
                yield value

    def elements(self, value: Any) -> Sequence[Any]:
        """Return a list's elements."""
        return value if isinstance(value, list) else ()
