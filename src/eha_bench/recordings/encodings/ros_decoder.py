"""ROS messages (CDR and ROS 1) as columns: one layout serves every message of the same shape."""

from __future__ import annotations

from collections.abc import Mapping, Set

import numpy as np

from eha_bench.core.arrays import BoolArray, IndexArray
from eha_bench.recordings.decompress import DamagedChunk
from eha_bench.recordings.encodings.decoder import Column, Decoder, Encoded, UnreadableTopic
from eha_bench.recordings.encodings.definitions import (
    DefinitionError,
    Definitions,
    parse_idl,
    parse_msg,
    short_name,
)
from eha_bench.recordings.encodings.field_path import FieldPath, NamedElement
from eha_bench.recordings.encodings.packed_messages import are_packed, unpacked_messages
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.encodings.ros_layout import MessageLayout, layout_of
from eha_bench.recordings.encodings.ros_path import check_path
from eha_bench.recordings.encodings.ros_walker import PayloadError
from eha_bench.recordings.naming import printable

_MOST_LAYOUTS = 8
_BLOCK = 2048
"""Messages that all fields are taken from before the next ones: they are still in the cache."""


class RosDecoder(Decoder):
    """Finds the layout of a message once and reads all of the same shape at one go."""

    def __init__(self, encoded: Encoded, paths: tuple[FieldPath, ...]) -> None:
        self._ros1 = encoded.encoding == "ros1"
        self._name = short_name(encoded.schema_name.replace("::", "/"))
        self._paths = paths
        self._layouts: dict[int, list[MessageLayout]] = {}
        self._kinds: dict[int, str] = {}
        self._definitions = definitions_of(encoded)
        try:
            for path in paths:
                check_path(self._definitions, self._name, path)
        except DefinitionError as error:
            raise UnreadableTopic(str(error)) from error

    def kinds(self) -> Mapping[int, str]:
        """Return the NumPy types that the paths were seen with, by their number."""
        return self._kinds

    def found_paths(self) -> Set[int]:
        """Return the numbers of the paths that led to something in at least one message."""
        return self._kinds.keys()

    def hint(self, path: FieldPath) -> str:
        """Say how the elements are called, where one was asked for by name."""
        if not any(isinstance(step, NamedElement) for step in path.steps):
            return ""
        names = {name for known in self._layouts.values() for one in known for name in one.names}
        return f"the names in it are {printable(sorted(names)) or 'none'}"

    def decode(self, payloads: Payloads, columns: list[Column]) -> None:
        """Write one value a message into each column.

        Raises:
            UnreadableTopic: a message does not fit its definition.
        """
        if not self._ros1 and are_packed(payloads):
            self._decode_packed(payloads, columns)
            return
        rows: IndexArray | None = None
        left = payloads
        known = self._layouts.setdefault(payloads.size, [])
        for attempt in range(_MOST_LAYOUTS):
            if attempt >= len(known):
                known.append(self._layout(left, 0))
            fits = _fitting(left, known[attempt])
            if fits is None:
                self._fill(left, known[attempt], columns, rows)
                return
            if fits.any():
                index = np.flatnonzero(fits)
                self._fill(
                    left.rows(index),
                    known[attempt],
                    columns,
                    index if rows is None else rows[index],
                )
            index = np.flatnonzero(~fits)
            left = left.rows(index)
            rows = index if rows is None else rows[index]
        # arrays of ever changing length: no two messages have one shape, so take them one by one
        for row in range(left.count):
            one = left.rows(np.array([row]))
            target = np.array([row if rows is None else rows[row]])
            self._fill(one, self._layout(one, 0), columns, target)

    def _decode_packed(self, payloads: Payloads, columns: list[Column]) -> None:
        try:
            for rows, plain in unpacked_messages(payloads):
                targets = [np.empty(plain.count) for _ in columns]
                self.decode(plain, targets)
                for column, target in zip(columns, targets, strict=True):
                    column[rows] = target
        except DamagedChunk as error:
            raise UnreadableTopic(f"a message is damaged: {error}") from error

    def _layout(self, payloads: Payloads, row: int) -> MessageLayout:
        try:
            layout = layout_of(
                payloads.payload(row), self._definitions, self._name, self._paths, ros1=self._ros1
            )
        except (PayloadError, DefinitionError) as error:
            raise UnreadableTopic(
                f"a message does not fit its type {self._name}: {error}"
            ) from error
        for index, leaf in enumerate(layout.leaves):
            if leaf is not None:
                self._kinds.setdefault(index, leaf.code)
        return layout

    @staticmethod
    def _fill(
        payloads: Payloads,
        layout: MessageLayout,
        columns: list[Column],
        rows: IndexArray | None,
    ) -> None:
        fields = [
            np.full(payloads.count, np.nan)
            if leaf is None
            else payloads.column(leaf.offset, leaf.code)
            for leaf in layout.leaves
        ]
        for start in range(0, payloads.count, _BLOCK):
            block = slice(start, start + _BLOCK)
            place = block if rows is None else rows[block]
            for column, values in zip(columns, fields, strict=True):
                column[place] = values[block]


def definitions_of(encoded: Encoded) -> Definitions:
    """Return the message definitions that a schema holds (none for a schema that is empty).

    Raises:
        UnreadableTopic: the schema cannot be parsed.
    """
    try:
        text = encoded.schema.decode("utf-8")
        match encoded.schema_encoding:
            case "ros2msg" | "ros1msg" | "":
                ros1 = encoded.encoding == "ros1"
                if not text.strip() and not ros1:
                    return {}
                return parse_msg(encoded.schema_name, text, ros1=ros1)
            case "ros2idl" | "omgidl":
                return parse_idl(text)
            case other:
                raise UnreadableTopic(f"its schema is written as '{other}', which is not read")
    except (UnicodeDecodeError, DefinitionError) as error:
        raise UnreadableTopic(f"its schema cannot be read: {error}") from error


def _fitting(payloads: Payloads, layout: MessageLayout) -> BoolArray | None:
    """Return which messages have the layout's guards; None if all have."""
    fits: BoolArray | None = None
    for offset, code, value in layout.words:
        same = payloads.column(offset, code) == value
        if np.count_nonzero(same) != payloads.count:
            fits = same if fits is None else fits & same
    return fits
