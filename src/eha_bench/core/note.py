"""Notes as values: a sentence that keeps its template and what stands in it.

A note reads and is stored as its sentence. Notes of several runs are merged by their values, never
by their text.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from string import Formatter
from typing import Any, Self

Value = str | int | float


class Note(str):
    """A sentence made from a template, e.g. `Note("{channel} has {count:d} gaps", ...)`.

    Attributes:
        template: with a field for every value, as `str.format` takes it.
        values: name -> text or number (SI, or the unit that the template writes).
    """

    template: str
    values: dict[str, Value]

    def __new__(cls, template: str, **values: Value) -> Self:
        """Return the sentence; a KeyError where a field has no value."""
        note = super().__new__(cls, template.format(**values))
        note.template, note.values = template, values
        return note

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Value]]:
        return (self.template,), self.values

    @property
    def kind(self) -> tuple[Any, ...]:
        """What notes of one kind share: the template and all values that are not numbers."""
        words = {name: value for name, value in self.values.items() if isinstance(value, str)}
        return self.template, *sorted(words.items())


def prefixed(prefix: str, text: str, **values: Value) -> Note:
    """Return a text with a template in front of it; one that is a `Note` keeps its values."""
    own = text if isinstance(text, Note) else Note("{text}", text=text)
    return Note(prefix + own.template, **{**own.values, **values})


def of_run(run: str, text: str) -> Note:
    """Return a note with the name of its run in front; one that is a `Note` keeps its values."""
    return prefixed("{run}: ", text, run=run)


def merged_notes(notes: Iterable[Note]) -> tuple[str, ...]:
    """Return notes of several runs, those of one kind as one: all runs' names, ranges of numbers.

    Args:
        notes: each with its run's name under `run`.
    """
    alike: dict[tuple[Any, ...], list[Note]] = {}
    for note in notes:
        key = tuple(item for item in note.kind if item != ("run", note.values["run"]))
        alike.setdefault(key, []).append(note)
    return tuple(in_one(group) for group in alike.values())


def in_one(group: Sequence[Note]) -> str:
    """Return one sentence of notes of one kind: a range for each number, words one by one."""
    pieces = []
    for literal, field, form, _ in Formatter().parse(group[0].template):
        pieces.append(literal)
        if field is None:
            continue
        values = [note.values[field] for note in group]
        if isinstance(values[0], str):
            pieces.append(", ".join(dict.fromkeys(str(value) for value in values)))
            continue
        low, high = format(min(values), form or ""), format(max(values), form or "")
        pieces.append(low if low == high else f"{low} to {high}")
    return "".join(pieces)
