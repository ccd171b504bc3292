"""YAML 1.2 files read with line numbers, and pydantic's errors mapped back onto them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest


class StrictModel(BaseModel):
    """Base of all file formats: unknown keys are errors, instances are immutable."""

    # built when first used: most are parts of others, which build them again
    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        populate_by_name=True,
        defer_build=True,
        allow_inf_nan=False,
    )


class WrongAt(ValueError):
    """What a validator raises that knows better than pydantic where the mistake stands.

    Attributes:
        keys: lead from what is being validated to the key that is wrong, or missing.
    """

    def __init__(self, what: str, *keys: int | str) -> None:
        super().__init__(what)
        self.keys = keys


def _number(value: Any) -> Any:
    if isinstance(value, bool):  # which is a number to Python, and a slip of the pen in a file
        raise ValueError(f"'{str(value).lower()}' is not a number")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"'{value}' is not a finite number")
    return value


NUMBER = BeforeValidator(_number)
"""Marks a field as a number, which `true` and `.nan` are none."""

Real: TypeAlias = Annotated[float, NUMBER]
"""A number of a file."""

DEEPEST = 40
MOST_VALUES = 1_000_000

M = TypeVar("M", bound=BaseModel)
Places: TypeAlias = Callable[[Sequence[int | str]], Place]


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        InputError: the file is missing, cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError("no such file", where=Place(file=str(path))) from error
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError, as is bad UTF-8
        raise InputError(f"cannot be read ({error})", where=Place(file=str(path))) from error


def load(path: Path) -> Any:
    """Return the content of a YAML file as ruamel's line-carrying maps and sequences.

    Raises:
        InputError: the file is missing, empty, not UTF-8, or not YAML.
    """
    return parse(read_text(path), str(path))


_PEEKED: dict[str, tuple[str, Any]] = {}


def peek(path: Path) -> Any:
    """Return what `load` does, and keep it for the next who parses the same text, and only them.

    Who asks what kind of file it is before reading it so pays for one parse.
    """
    text = read_text(path)
    content = parse(text, str(path))
    _PEEKED.clear()
    _PEEKED[str(path)] = text, content
    return content


def parse(text: str, name: str) -> Any:
    """Return YAML text as line-carrying maps and sequences; `name` stands in messages."""
    peeked = _PEEKED.pop(name, None)
    if peeked is not None and peeked[0] == text:
        return peeked[1]
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        content = YAML(typ="rt").load(StringIO(text))
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        problem = " ".join(str(error.problem or error.context or "syntax error").split())
        raise InputError(f"not valid YAML: {problem}", where=Place(file=name, line=line)) from error
    except (YAMLError, ValueError, RecursionError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else "syntax error"
        raise InputError(f"not valid YAML: {first}", where=Place(file=name)) from error
    if content is None:
        raise InputError("the file is empty", where=Place(file=name))
    if _size(content, name, 0, {}) > MOST_VALUES:
        raise InputError("there are too many values, by aliases of aliases", where=Place(file=name))
    return content


def _size(content: Any, name: str, depth: int, known: dict[int, int]) -> int:
    """Return the number of values with aliases written out; refuse what cannot be written out."""
    if not isinstance(content, (dict, list)):
        return 1
    if depth > DEEPEST:
        raise InputError(
            "nests too deep", where=Place(file=name), hint=f"at most {DEEPEST} levels are read"
        )
    if id(content) not in known:
        items = content.values() if isinstance(content, dict) else content
        known[id(content)] = 1 + sum(_size(item, name, depth + 1, known) for item in items)
    return known[id(content)]


def line_of(content: Any, keys: Sequence[int | str]) -> int:
    """Return the 1-based line of the deepest of `keys` that the content has (0 if unknown)."""
    line = 0
    for key in keys:
        position = getattr(content, "lc", None)
        try:
            if isinstance(content, dict) and key in content:
                line = position.key(key)[0] + 1 if position is not None else line
                content = content[key]
            elif isinstance(content, list) and isinstance(key, int) and key < len(content):
                line = position.item(key)[0] + 1 if position is not None else line
                content = content[key]
        except (KeyError, TypeError, AttributeError):
            break
    return line


def named_file(folder: Path, name: str, where: Place) -> Path:
    """Return the path of a file that a key names, relative to a folder.

    Raises:
        InputError: it is not there; `where` is the key.
    """
    path = folder / name
    if not path.is_file():
        raise InputError(
            f"there is no file '{name}'",
            where=where,
            hint="name it relative to the file that the key stands in",
        )
    return path


def plain(content: Any) -> Any:
    """Return the content as plain dicts, lists, str, int, float, bool, None."""
    if isinstance(content, dict):
        return {str(key): plain(value) for key, value in content.items()}
    if isinstance(content, list):
        return [plain(value) for value in content]
    if isinstance(content, bool) or content is None:
        return content
    for kind in (int, float, str):
        if isinstance(content, kind):
            return kind(content)
    return str(content)


def validate(
    model: type[M],
    content: Any,
    name: str,
    prefix: Sequence[int | str] = (),
    *,
    context: Any = None,
    places: Places | None = None,
) -> M:
    """Return `content` as `model`; the first problem becomes one sentence with file, line and key.

    Args:
        model: the file format.
        content: what `load` returned, or a part of it.
        name: the file's name, for messages.
        prefix: keys that lead from the file's top to `content`, for messages.
        context: handed to the model's validators (`info.context`).
        places: says where a key stands, for content that was put together from several places.

    Raises:
        InputError: an unknown key, a missing key, a wrong type or unit.
    """

    def place(keys: Sequence[int | str]) -> Place:
        if places is not None:
            return places(keys)
        path = ".".join(str(part) for part in (*prefix, *_key_path(content, keys)))
        return Place(file=name, line=line_of(content, keys), key=path)

    if not isinstance(content, dict):
        found = place(())
        raise InputError(
            f"expected keys and values, found {_kind_of(content)}",
            where=found if found.line else Place(file=name, line=1, key=found.key),
        )
    try:
        return model.model_validate(plain(content), context=context)
    except ValidationError as error:
        details = error.errors(include_url=False, include_input=False)
        first = min(details, key=_rank)
        # a value that may be written in several ways is wrong in each of them, and still one
        wrong = {tuple(_key_path(content, detail["loc"])) for detail in details}
        raise InputError(
            _sentence(first["type"], first["msg"], first["loc"]) + _others(len(wrong) - 1),
            where=place(_location(first)),
            hint=_way_out(model, first["type"], first["loc"]),
        ) from error


def _location(detail: Any) -> tuple[int | str, ...]:
    raised = detail.get("ctx", {}).get("error")
    further = raised.keys if isinstance(raised, WrongAt) else ()
    return (*detail["loc"], *further)


def _rank(detail: Any) -> tuple[bool, int]:
    # A misspelt key is told first (it is why another one is missing), then the deepest problem
    # (of a union's alternatives the one that came furthest).
    return detail["type"] != "extra_forbidden", -len(detail["loc"])


def _kind_of(content: Any) -> str:
    content = plain(content)
    names = {list: "a list", str: f"the text '{content}'", type(None): "nothing"}
    return names.get(type(content), f"'{content}'")


def _key_path(content: Any, location: Sequence[int | str]) -> list[str]:
    """Return the parts of pydantic's location that are keys of the file (not tags of a union)."""
    path: list[str] = []
    for position, key in enumerate(location):
        inside = key in content if isinstance(content, dict) else _is_index(content, key)
        if inside:
            content = content[key]
            path.append(str(key))
        elif position == len(location) - 1 and isinstance(content, dict) and "[" not in str(key):
            path.append(str(key))
    return path


def _is_index(content: Any, key: int | str) -> bool:
    return isinstance(content, list) and isinstance(key, int) and key < len(content)


_PLAINER = {
    "dict_type": "expected keys and values",
    "model_type": "expected keys and values",
    "list_type": "expected a list, as in [a, b]",
    "tuple_type": "expected a list, as in [a, b]",
    "string_type": "expected text",
}
"""What pydantic says in Python's words, in those of a file."""


def _sentence(kind: str, message: str, location: Sequence[int | str]) -> str:
    last = location[-1] if location else ""
    if kind == "extra_forbidden":
        return f"unknown key '{last}'"
    if kind == "missing":
        return f"key '{last}' is missing"
    if kind == "too_short" and message.endswith("not 0"):
        return f"'{last}' is empty: it needs at least 1"
    if kind in _PLAINER:
        return _PLAINER[kind]
    text = message.removeprefix("Value error, ").removeprefix("Assertion failed, ")
    return text[:1].lower() + text[1:] if text.startswith("Input should") else text


def _others(count: int) -> str:
    return f" (and {count} more)" if count else ""


def _way_out(model: type[BaseModel], kind: str, location: Sequence[int | str]) -> str:
    """Return the nearest key that the format has, for a key that it does not have."""
    if kind != "extra_forbidden":
        return ""
    known: type[BaseModel] | None = model
    named = False
    for key in location[:-1]:
        if named:  # any name may stand here, and the same model behind each
            named = False
        elif known is not None:
            named = _is_mapping(known, key)
            known = _model_within(known, key)
    if known is None:
        return ""
    return suggest(str(location[-1]), [f.alias or name for name, f in known.model_fields.items()])


def _model_within(model: type[BaseModel], key: int | str) -> type[BaseModel] | None:
    if isinstance(key, int):
        return model  # an item of a list: the list's own models were found at its key
    for name, field in model.model_fields.items():
        if key in (name, field.alias):
            found = _models_in(field.annotation)
            return found[0] if len(found) == 1 else None
    return None


def _is_mapping(model: type[BaseModel], key: int | str) -> bool:
    """Whether a key holds models by name."""
    field = model.model_fields.get(str(key))
    return field is not None and get_origin(field.annotation) is dict


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def load_model(model: type[M], path: Path) -> M:
    """Read a YAML file and return it as `model`.

    Raises:
        InputError: as `load` and `validate`.
    """
    return validate(model, load(path), str(path))
