"""Content of a YAML file that still knows where each of its values was written.

A trial is put together from `defaults`, its own keys and the matrix's parameters; whatever is wrong
with it must be reported with the line that the user has to change.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

from eha_bench.core.errors import InputError, Place
from eha_bench.core.fast_yaml import LineNumbers
from eha_bench.core.yaml_file import plain

Key: TypeAlias = int | str
Keys: TypeAlias = tuple[Key, ...]


@dataclass(frozen=True)
class Located:
    """A plain value (dicts, lists, scalars) and the place of each value within it.

    Attributes:
        value: the content.
        written: keys that lead to a value -> where it was written; of all that this is a part of.
        inside: keys that lead to this part.
        holder: what should hold this part, if `written` does not say where it stands.
        origins: keys that lead to a value that stands elsewhere than its key -> where.
    """

    value: Any
    written: Mapping[Keys, Place] = field(default_factory=dict)
    inside: Keys = ()
    holder: Located | None = None
    origins: Mapping[Keys, Place] = field(default_factory=dict)

    @staticmethod
    def of(content: Any, file: str) -> Located:
        """Wrap what `yaml_file.load` returned."""
        places: dict[Keys, Place] = {(): Place(file=file, line=1)}
        return Located(_walk(content, file, (), places), places)

    @property
    def places(self) -> Mapping[Keys, Place]:
        """Keys that lead from here to a value -> where it was written; () is the content itself."""
        if not self.inside:
            return self.written
        size = len(self.inside)
        found = {path[size:]: at for path, at in self.written.items() if path[:size] == self.inside}
        found.setdefault((), self.place())
        return found

    def place(self, keys: Sequence[Key] = ()) -> Place:
        """Return where `keys` were written; what is not there is placed at what should hold it."""
        known = self.inside
        value = self.value
        absent = ""
        found = self.written.get(known) or self._place_in_holder()
        for key in keys:
            deeper = self.written.get((*known, key))
            if deeper is not None:
                known = (*known, key)
                value = _item(value, key)
                absent = ""
                found = deeper
            elif isinstance(value, dict):  # otherwise it names an alternative of a union
                absent = str(key)
        if not absent or "[" in absent:
            return found
        key = f"{found.key}.{absent}" if found.key else absent
        return Place(found.file, found.line, key, found.topic, found.time)

    def _place_in_holder(self) -> Place:
        """Return where this part would stand in what should hold it."""
        holder = self.holder
        return Place() if holder is None else holder.place(self.inside[len(holder.inside) :])

    def at(self, *keys: Key) -> Located:
        """Return the part that `keys` lead to; None in place of what is not there."""
        value = self.value
        for key in keys:
            value = _item(value, key)
        inside = (*self.inside, *keys)
        holder = None if inside in self.written else self
        return Located(value, self.written, inside, holder, self.origins)

    def apart(self) -> Located:
        """Return the same part with the places within it alone: asked often, it is found soon."""
        return Located(self.value, self.places)

    def each(self) -> list[Located]:
        """Return the items of a list; all places are gone through once, however many there are."""
        places: list[dict[Keys, Place]] = [{} for _ in self.value]
        for path, at in self.places.items():
            if path and isinstance(path[0], int) and path[0] < len(places):
                places[path[0]][path[1:]] = at
        for index, inside in enumerate(places):
            inside.setdefault((), self.place((index,)))
        return [Located(item, places[index]) for index, item in enumerate(self.value)]

    def items(self) -> Iterator[tuple[str, Located]]:
        """Yield key and value of a mapping."""
        for key in self.value:
            yield key, self.at(key)

    def without(self, *keys: str) -> Located:
        """Return a mapping without some of its keys."""
        if not any(key in self.value for key in keys):
            return self
        value = {key: item for key, item in self.value.items() if key not in keys}
        places = {path: at for path, at in self.places.items() if not path or path[0] not in keys}
        return Located(value, places)

    def renamed(self, old: str, new: str) -> Located:
        """Return the same content with another name in messages: `trials.0` -> `trials.step`."""
        within, size = f"{old}.", len(old)
        places = {
            path: Place(at.file, at.line, new + at.key[size:], at.topic, at.time)
            if at.key == old or at.key.startswith(within)
            else at
            for path, at in self.places.items()
        }
        return Located(self.value, places)

    def over(self, base: Located, deep: tuple[str, ...] = ()) -> Located:
        """Return this mapping with the keys of `base` that it lacks; those in `deep` are merged."""
        value = dict(self.value)
        places = dict(self.places)
        for key, item in base.items():
            if key not in value:
                value[key] = item.value
                places |= {(key, *path): at for path, at in item.places.items()}
            elif key in deep and isinstance(value[key], dict) and isinstance(item.value, dict):
                merged = self.at(key).over(item)
                value[key] = merged.value
                places |= {(key, *path): at for path, at in merged.places.items()}
        return Located(value, places)

    def over_all(self, base: Located) -> Located:
        """Return this mapping over `base`: mappings within mappings are merged at every depth."""
        value = dict(base.value)
        places = dict(base.places) | {(): self.place()}
        for key, item in self.items():
            both = isinstance(item.value, dict) and isinstance(value.get(key), dict)
            merged = item.over_all(base.at(key)) if both else item
            value[key] = merged.value
            places = {path: at for path, at in places.items() if path[:1] != (key,)}
            places |= {(key, *path): at for path, at in merged.places.items()}
        return Located(value, places)

    def placed(self, origins: Mapping[Keys, Place]) -> Located:
        """Return the same content with values that were written elsewhere: keys -> where."""
        own = {(*self.inside, *keys): place for keys, place in origins.items()}
        return replace(self, origins=own)

    def origin(self, keys: Sequence[Key] = ()) -> Place:
        """Return where the value that `keys` lead to was written, under its key.

        That is another line than its key's where the key says `${name}`.
        """
        found = self.place(keys)
        whole = (*self.inside, *keys)
        for length in range(len(whole), 0, -1):
            if (place := self.origins.get(whole[:length])) is not None:
                return Place(place.file, place.line, found.key, found.topic, found.time)
        return found

    def holding(self, mark: str) -> Marked:
        """Return where the texts stand that hold `mark`."""
        return Marked(self, _holding(self.value, mark))

    def mapping(self, what: str) -> Located:
        """Return itself, an empty mapping in place of nothing.

        Raises:
            InputError: it is something else than a mapping; `what` says what it should hold.
        """
        if self.value is None:
            return Located({}, self.written, self.inside, self.holder)
        if not isinstance(self.value, dict):
            raise self.error(f"expected {what}", hint="write it as 'key: value' lines")
        return self

    def error(self, what: str, *, hint: str = "") -> InputError:
        """Return an error about this content."""
        return InputError(what, where=self.place(), hint=hint)


@dataclass(frozen=True)
class Marked:
    """Content with some texts to be replaced, once or many times.

    Attributes:
        content: as it was written.
        texts: keys -> texts within; True for a text itself, nothing where there is none.
    """

    content: Located
    texts: _Texts

    def mapped(self, change: Callable[[str, Place], Any]) -> Located:
        """Return the content with every such text replaced by change(text, place)."""
        whole = self.content
        value = self._mapped(whole.value, (), self.texts, change) if self.texts else whole.value
        return Located(value, whole.written, whole.inside, whole.holder)

    def whole(self, pattern: re.Pattern[str]) -> dict[Keys, str]:
        """Return the keys of the texts that are all of a pattern -> its first group."""
        texts = ((keys, _at(self.content.value, keys)) for keys in _leaves(self.texts))
        return {keys: match[1] for keys, text in texts if (match := pattern.fullmatch(text))}

    def _mapped(
        self, value: Any, keys: Keys, texts: _Texts, change: Callable[[str, Place], Any]
    ) -> Any:
        if texts is True:
            return change(value, self.content.place(keys))
        copied = value.copy()
        for key, within in texts.items():
            copied[key] = self._mapped(value[key], (*keys, key), within, change)
        return copied


_Texts: TypeAlias = "Mapping[Key, _Texts] | Literal[True]"


def _leaves(texts: _Texts, keys: Keys = ()) -> Iterator[Keys]:
    """Yield the keys that lead to each text."""
    if texts is True:
        yield keys
        return
    for key, within in texts.items():
        yield from _leaves(within, (*keys, key))


def _at(value: Any, keys: Keys) -> str:
    """Return the text that keys lead to, without what is around it."""
    for key in keys:
        value = value[key]
    return str(value).strip()


def _holding(value: Any, mark: str) -> _Texts:
    """Return the keys that lead to the texts that hold `mark`."""
    if isinstance(value, str):
        return True if mark in value else {}
    if not isinstance(value, (dict, list)):
        return {}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {key: found for key, item in items if (found := _holding(item, mark))}


def _walk(content: Any, file: str, keys: Keys, places: dict[Keys, Place]) -> Any:
    """Return the content as plain values; note in `places` where each was written."""
    if not isinstance(content, (dict, list)):
        return plain(content)
    here = places[keys]
    before = f"{here.key}." if here.key else ""
    line_of = _lines(content, here.line)
    values: dict[Key, Any] = {}
    mapping = isinstance(content, dict)
    items: Iterable[tuple[Any, Any]] = (
        content.items() if isinstance(content, dict) else enumerate(content)
    )
    for raw, item in items:
        key = str(raw) if mapping else raw
        path = (*keys, key)
        places[path] = Place(file, line_of(raw), f"{before}{key}")
        values[key] = _walk(item, file, path, places)
    return values if mapping else list(values.values())


def _item(value: Any, key: Key) -> Any:
    try:
        return value[key]
    except (KeyError, IndexError, TypeError):
        return None


def _lines(content: Any, otherwise: int) -> Callable[[Any], int]:
    """Return what tells the line of a key or item; it may have come in through an anchor."""
    position = getattr(content, "lc", None)
    if isinstance(position, LineNumbers):
        known = position.of
        return lambda key: known.get(key, otherwise - 1) + 1
    tell = getattr(position, "key" if isinstance(content, dict) else "item", None)

    def line(key: Any) -> int:
        try:
            return int(tell(key)[0]) + 1 if tell is not None else otherwise
        except (AttributeError, KeyError, TypeError, IndexError):
            return otherwise

    return line
