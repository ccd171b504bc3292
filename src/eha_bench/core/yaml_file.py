"""YAML 1.2 files read with line numbers, and pydantic's errors mapped back onto them."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from eha_bench.core.errors import InputError, Place


class StrictModel(BaseModel):
    """Base of all file formats: unknown keys are errors, instances are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


M = TypeVar("M", bound=BaseModel)


def load(path: Path) -> Any:
    """Return the content of a YAML file as ruamel's line-carrying maps and sequences.

    Raises:
        InputError: the file is missing, empty, not UTF-8, or not YAML.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError("no such file", where=Place(file=str(path))) from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", where=Place(file=str(path))) from error
    return parse(text, str(path))


def parse(text: str, name: str) -> Any:
    """Return YAML text as line-carrying maps and sequences; `name` stands in messages."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        content = YAML(typ="rt").load(StringIO(text))
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        problem = " ".join(str(error.problem or error.context or "syntax error").split())
        raise InputError(
            f"not valid YAML: {problem}", where=Place(file=name, line=line)
        ) from error
    except (YAMLError, ValueError, RecursionError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else "syntax error"
        raise InputError(f"not valid YAML: {first}", where=Place(file=name)) from error
    if content is None:
        raise InputError("the file is empty", where=Place(file=name))
    return content


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


def validate(model: type[M], content: Any, name: str, prefix: Sequence[int | str] = ()) -> M:
    """Return `content` as `model`; the first problem becomes one sentence with file, line and key.

    Raises:
        InputError: an unknown key, a missing key, a wrong type or unit.
    """
    if not isinstance(content, dict):
        raise InputError(
            f"expected keys and values, found {type(plain(content)).__name__}",
            where=Place(file=name, line=1),
        )
    try:
        return model.model_validate(plain(content))
    except ValidationError as error:
        details = error.errors()
        first = max(details, key=lambda item: len(item["loc"])) if details else None
        location = tuple(first["loc"]) if first else ()
        key = ".".join(str(part) for part in (*prefix, *_key_path(content, location)))
        message = first["msg"] if first else str(error)
        kind = first["type"] if first else ""
        raise InputError(
            _sentence(kind, message, location, len(details)),
            where=Place(file=name, line=line_of(content, location), key=key),
        ) from error


def _key_path(content: Any, location: Sequence[int | str]) -> list[str]:
    """Return the parts of pydantic's location that are keys of the file (not tags of a union)."""
    path: list[str] = []
    for position, key in enumerate(location):
        if isinstance(content, dict) and key in content:
            path.append(str(key))
            content = content[key]
        elif isinstance(content, list) and isinstance(key, int) and key < len(content):
            path.append(str(key))
            content = content[key]
        elif position == len(location) - 1 and isinstance(content, dict) and "[" not in str(key):
            path.append(str(key))
    return path


def _sentence(kind: str, message: str, location: Sequence[int | str], count: int) -> str:
    last = location[-1] if location else ""
    if kind == "extra_forbidden":
        text = f"unknown key '{last}'"
    elif kind == "missing":
        text = f"key '{last}' is missing"
    else:
        text = message.removeprefix("Value error, ")
    return f"{text} (and {count - 1} more)" if count > 1 else text


def load_model(model: type[M], path: Path) -> M:
    """Read a YAML file and return it as `model`.

    Raises:
        InputError: as `load` and `validate`.
    """
    return validate(model, load(path), str(path))
