"""Checks a field path against a message's definition, before any message is read."""

from __future__ import annotations

from eha_bench.recordings.encodings.definitions import (
    Array,
    DefinitionError,
    Definitions,
    Fields,
    Nested,
    Primitive,
    Sequence,
    Text,
    Type,
    resolve,
)
from eha_bench.recordings.encodings.field_path import (
    ALIASES,
    ArrayItem,
    Attribute,
    FieldPath,
    NamedElement,
    lists_names,
)
from eha_bench.recordings.naming import among


def check_path(definitions: Definitions, name: str, path: FieldPath) -> None:
    """Check that a path leads to a number of message type `name`.

    Raises:
        DefinitionError: no such field, not an array, or not a number; says what there is.
    """
    kind: Type = Nested(name)
    around: list[Fields] = []
    for step in path.steps:
        match step, kind:
            case Attribute(attribute), Nested(owner):
                around.append(resolve(definitions, owner))
                kind = _field(owner, around[-1], attribute)
            case ArrayItem(index), Array(element, length):
                if index >= length:
                    raise DefinitionError(f"'{path}' asks for more than the {length} elements")
                kind = element
            case ArrayItem(), Sequence(element):
                kind = element
            case NamedElement(label), (Array(element) | Sequence(element)):
                inside = resolve(definitions, element.name) if isinstance(element, Nested) else ()
                if ("name", Text()) not in inside and not any(map(_has_names, around)):
                    raise DefinitionError(
                        f"'{path}' asks for the element '{label}', but nothing names the elements: "
                        "give its number, counted from 0"
                    )
                kind = element
            case Attribute(attribute), (Array() | Sequence()):
                raise DefinitionError(
                    f"'.{attribute}' of an array: say which element, e.g. [0].{attribute}"
                )
            case Attribute(attribute), _:
                raise DefinitionError(f"'.{attribute}' of something that has no fields")
            case _:
                raise DefinitionError(
                    f"'{path}' takes an element of something that is not an array"
                )
    if not isinstance(kind, Primitive):
        raise DefinitionError(f"'{path}' is not a number but {_what(definitions, kind)}")


def _field(owner: str, fields: Fields, name: str) -> Type:
    known = dict(fields)
    found = known.get(name) or known.get(ALIASES.get(name, ""))
    if found is None:
        raise DefinitionError(f"{owner} has no field '{name}'; {among(name, known, 'fields')}")
    return found


def _has_names(fields: Fields) -> bool:
    return any(
        lists_names(title) and isinstance(kind, (Array, Sequence)) and kind.element == Text()
        for title, kind in fields
    )


def _what(definitions: Definitions, kind: Type) -> str:
    match kind:
        case Array() | Sequence():
            return "an array: add an index, e.g. [0]"
        case Nested(name):
            fields = ", ".join(dict(resolve(definitions, name)))
            return f"a message: add one of its fields ({fields})"
        case _:
            return "text"
