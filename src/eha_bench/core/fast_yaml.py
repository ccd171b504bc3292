"""Plain YAML 1.2 text read by libyaml, with the line of every key and item.

libyaml reads thirty times as fast as Python can. What it is not taken at its word for, and every
mistake, is left to ruamel.yaml: whatever this reads, ruamel.yaml reads the same.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

WORDS = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_MAYBE_NUMBER = frozenset("-+.0123456789<=")
_WHOLE = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_REAL = re.compile(r"[-+]?(?:0|[1-9][0-9]*)(?:\.[0-9]+(?:[eE][-+]?[0-9]+)?|[eE][-+]?[0-9]+)")
_TYPED = re.compile(
    r"[-+]?[0-9][0-9_]*\.[0-9_]*(?:[eE][-+]?[0-9]+)?|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+"
    r"|[-+]?\.[0-9_]+(?:[eE][-+][0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
    r"|[-+]?0b[0-1_]+|[-+]?0o?[0-7_]+|[-+]?[0-9_]+|[-+]?0x[0-9a-fA-F_]+"
    r"|[0-9]{4}-[0-9]{2}-[0-9]{2}"
    r"|[0-9]{4}-[0-9]{2}?-[0-9]{2}?(?:[Tt]|[ \t]+)[0-9]{1,2}:.*"
    r"|<<|="
)
"""What is not text in YAML 1.2, or may be none."""
_UNLIKE = re.compile(
    "[\t\r\x85\u2028\u2029\ufeff]|[|>][-+0-9]*#|^(?:%|---|\\.\\.\\.)"
    # a block of text that begins with lines of spaces
    "|[|>][-+0-9]* *\n(?: *\n)* +(?:\n|\\Z)",
    re.MULTILINE,
)
"""What libyaml takes otherwise, as YAML 1.1 or by being lenient; and what parts documents."""


class NeedsFullParser(Exception):
    """The text holds something that is left to ruamel.yaml."""


class LineNumbers:
    """Where the keys or items of a collection stand, as ruamel.yaml says it."""

    def __init__(self) -> None:
        self.of: dict[Any, int] = {}

    def key(self, key: Any) -> tuple[int, int]:
        """Return the 0-based line of a key."""
        return self.of[key], 0

    item = key


class LinedDict(dict[Any, Any]):
    """A mapping; `lc` knows the lines of its keys."""

    def __init__(self) -> None:
        super().__init__()
        self.lc = LineNumbers()


class LinedList(list[Any]):
    """A sequence; `lc` knows the lines of its items."""

    def __init__(self) -> None:
        super().__init__()
        self.lc = LineNumbers()


def parse(text: str, deepest: int) -> Any:
    """Return the content of one plain document.

    Raises:
        NeedsFullParser: it is not plain, nests deeper than `deepest`, is not YAML, or there is no
            libyaml.
    """
    if _UNLIKE.search(text):
        raise NeedsFullParser
    try:
        from yaml import YAMLError
        from yaml.cyaml import CParser
    except ImportError:
        raise NeedsFullParser from None
    try:
        return _Document(deepest).read(CParser(text).get_event)
    except (YAMLError, ValueError):
        raise NeedsFullParser from None


_NO_KEY = object()
_PLAIN = frozenset({None, ""})
_BLOCKS = frozenset({"|", ">"})


class _Document:
    """Puts together what the parser tells, piece by piece; nothing here is recursive."""

    def __init__(self, deepest: int) -> None:
        self._deepest = deepest
        self._anchors: dict[str, Any] = {}
        self._top = LinedList()
        self._holder: Any = self._top  # the innermost collection, and the key that awaits a value
        self._key: Any = _NO_KEY
        self._around: list[tuple[Any, Any]] = []

    def read(self, next_event: Callable[[], Any]) -> Any:
        """Return the one document that the events tell."""
        from yaml import events

        handlers = {
            events.ScalarEvent: self._scalar,
            events.MappingStartEvent: self._open,
            events.SequenceStartEvent: self._open,
            events.MappingEndEvent: self._close,
            events.SequenceEndEvent: self._close,
            events.AliasEvent: self._alias,
        }
        for expected in (events.StreamStartEvent, events.DocumentStartEvent):
            if type(next_event()) is not expected:
                raise NeedsFullParser  # nothing is in it
        event = next_event()
        while type(event) is not events.DocumentEndEvent:
            handlers[type(event)](event)
            event = next_event()
        if type(next_event()) is not events.StreamEndEvent:
            raise NeedsFullParser
        return self._top[0]

    def _scalar(self, event: Any) -> None:
        if event.tag is not None or event.anchor is not None:
            raise NeedsFullParser
        value = event.value
        if event.style in _PLAIN:
            value = _scalar(value)
        elif event.style in _BLOCKS and value.startswith("\n"):
            raise NeedsFullParser  # libyaml takes first lines that are indented more than it
        line = event.start_mark.line
        if self._key is _NO_KEY and type(self._holder) is LinedDict:
            if value in self._holder:
                raise NeedsFullParser
            self._holder.lc.of[value] = line
            self._key = value
        else:
            self._put(value, line)

    def _open(self, event: Any) -> None:
        no_key = self._key is _NO_KEY and type(self._holder) is LinedDict
        if event.tag is not None or no_key or len(self._around) > self._deepest:
            raise NeedsFullParser
        made = LinedDict() if type(event).__name__ == "MappingStartEvent" else LinedList()
        if event.anchor is not None:
            if event.anchor in self._anchors:
                raise NeedsFullParser
            self._anchors[event.anchor] = made
        self._put(made, event.start_mark.line)
        self._around.append((self._holder, self._key))
        self._holder, self._key = made, _NO_KEY

    def _close(self, _: Any) -> None:
        self._holder, self._key = self._around.pop()

    def _alias(self, event: Any) -> None:
        no_key = self._key is _NO_KEY and type(self._holder) is LinedDict
        if no_key or event.anchor not in self._anchors:
            raise NeedsFullParser
        self._put(self._anchors[event.anchor], event.start_mark.line)

    def _put(self, value: Any, line: int) -> None:
        if type(self._holder) is LinedList:
            self._holder.lc.of[len(self._holder)] = line
            self._holder.append(value)
        else:
            self._holder[self._key] = value
            self._key = _NO_KEY


def _scalar(text: str) -> Any:
    """Return what a plain scalar stands for."""
    if text in WORDS:
        return WORDS[text]
    if text[0] not in _MAYBE_NUMBER:
        return text
    if _WHOLE.fullmatch(text):
        return int(text)
    if _REAL.fullmatch(text):
        return float(text)
    if _TYPED.fullmatch(text):
        raise NeedsFullParser
    return text
