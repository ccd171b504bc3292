"""YAML 1.2 files read with line numbers, and pydantic's errors mapped back onto them."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from eha_bench.core import fast_yaml
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.file_kind import FileKind, kind_by_keys, kind_named, kinds
from eha_bench.core.input_files import note_input
from eha_bench.core.near_miss import likely, suggest
from eha_bench.core.shipped import KINDS, by_name, find
from eha_bench.core.shipped import names as shipped_names


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


class ErrorAt(ValueError):
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

_QUOTED = 60
"""Letters of a value that a message repeats."""

DEEPEST = 40
MOST_VALUES = 1_000_000

M = TypeVar("M", bound=BaseModel)
Places: TypeAlias = Callable[[Sequence[int | str]], Place]


_GIVEN: dict[str, str] = {}


def file_of_content(content: Mapping[str, Any], kind: str) -> Path:
    """Return the path under which content that was given as a dict is read like a file.

    File names in it are relative to the working directory. There is no such file on the disk.

    Args:
        content: what a YAML file would hold.
        kind: what it is, for messages: suite, target, model, dataset, channels.
    """
    text = json.dumps(content, indent=1, ensure_ascii=False, default=str)
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    path = Path.cwd() / f"<{kind} {digest}>.yaml"
    _GIVEN[str(path)] = text
    return path


def file_of(source: str | Path | Mapping[str, Any], kind: str, *folders: str) -> Path:
    """Return the file that is meant: one on the disk, a shipped one by its name, or a dict as one.

    Raises:
        InputError: a bare name that nothing shipped has.
    """
    return file_of_content(source, kind) if isinstance(source, Mapping) else find(source, *folders)


def read_text(path: Path) -> str:
    """Return the text of a file, or of content that `file_of_content` keeps.

    Raises:
        InputError: the file is missing, cannot be read, or is not UTF-8.
    """
    if str(path) in _GIVEN:
        return _GIVEN[str(path)]
    note_input(path)
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError(
            "no such file",
            where=Place(file=str(path)),
            hint="check the name, or let 'eha-bench init' write files to start from",
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            "is not a text file in UTF-8",
            where=Place(file=str(path)),
            hint="give a YAML file; an editor saves another encoding as UTF-8",
        ) from error
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError
        why = getattr(error, "strerror", None) or error
        hint = "give a YAML file in it" if path.is_dir() else ""
        raise InputError(
            f"cannot be read ({why})", where=Place(file=str(path)), hint=hint
        ) from error


def load(path: Path) -> Any:
    """Return the content of a YAML file as maps and sequences that know their lines.

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
    try:
        content = fast_yaml.parse(text, DEEPEST)
    except fast_yaml.NeedsFullParser:
        content = _parse_any(text, name)
    if content is None:
        raise InputError(
            "the file is empty",
            where=Place(file=name),
            hint="'eha-bench init' writes files to start from",
        )
    if _size(content, name, 0, {}) > MOST_VALUES:
        raise InputError("there are too many values, by aliases of aliases", where=Place(file=name))
    return content


_SYNTAX = {
    "\\t": "indent with spaces, not with tabs",
    "duplicate key": "give each key once",
    "cannot start any token": "put the text into quotes",
    "expected chomping": "put the text into quotes",
    "mapping values are not allowed": "indent lines of one block alike, and quote text with ': '",
    "expected <block end>": "indent lines of one block alike",
    "expected ',' or": "close every [, { and quote",
    "undefined alias": "put text that begins with * into quotes",
}
"""What is usually behind a message of the parser -> the way out."""


_BARE_PARAMETER = re.compile(r"""\{[^"']*[:,\s](\$\{\w+\})""")
"""A parameter of a matrix without quotes within { }, where YAML takes its brace for another."""


def _parse_any(text: str, name: str) -> Any:
    """Return what any YAML 1.2 text holds.

    Raises:
        InputError: it is not YAML.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    try:
        return YAML(typ="rt").load(StringIO(text))
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        problem = " ".join(str(error.problem or error.context or "syntax error").split())
        lines = text.splitlines()
        written = lines[line - 1] if 0 < line <= len(lines) else ""
        way = next((way for sign, way in _SYNTAX.items() if sign in problem), "")
        if bare := _BARE_PARAMETER.search(written):
            way = f'put a parameter within braces into quotes: "{bare[1]}"'
        raise InputError(
            f"not valid YAML: {problem}", where=Place(file=name, line=line), hint=way
        ) from error
    except Exception as error:  # its parser trips over some texts instead of refusing them
        first = str(error).strip().splitlines()[0] if str(error).strip() else "syntax error"
        raise InputError(f"not valid YAML: {first}", where=Place(file=name)) from error


def _size(content: Any, name: str, depth: int, known: dict[int, int]) -> int:
    """Return the number of values with aliases written out; refuse what cannot be written out."""
    if not isinstance(content, (dict, list)):
        return 1
    if depth > DEEPEST:
        raise InputError(
            "is nested too deeply",
            where=Place(file=name),
            hint=f"at most {DEEPEST} levels are read",
        )
    if id(content) not in known:
        items = content.values() if isinstance(content, dict) else content
        known[id(content)] = 1 + sum(_size(item, name, depth + 1, known) for item in items)
    return known[id(content)]


def to_text(content: Any) -> str:
    """Return plain content as YAML text."""
    from ruamel.yaml import YAML

    stream = StringIO()
    yaml = YAML()
    yaml.default_flow_style = False
    yaml.dump(plain(content), stream)
    return stream.getvalue()


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


def kind_of(path: Path) -> FileKind:
    """Return the kind of a YAML file by its top-level keys.

    Raises:
        InputError: not YAML, of no known kind, or the result of a command.
    """
    content = peek(path)
    _refuse_results(content, str(path))
    found = kind_by_keys(content)
    if found is not None:
        return found
    telling = [key for kind in kinds() for key in kind.keys]
    for key in content if isinstance(content, dict) else ():
        near = likely(str(key), telling)
        if near:
            line = line_of(content, [key])
            raise InputError(
                f"key '{key}' is not a key of any kind of file",
                where=Place(file=str(path), line=line, key=str(key)),
                hint=near,
            )
    known = "; ".join(f"{kind.name} ({', '.join(sorted(kind.keys))})" for kind in kinds())
    raise InputError(
        "has no known kind",
        where=Place(file=str(path), line=1),
        hint=f"the kind is given by one of these keys: {known}",
    )


def named_file(folder: Path, name: str, where: Place) -> Path:
    """Return the path of a file that a key names, relative to a folder, or of a shipped one.

    Raises:
        InputError: it is not there; `where` is the key.
    """
    path = folder / name
    if not path.is_file():
        found = by_name(f"{where.key.rpartition('.')[2]}s", name)
        if found is not None:
            return found
        raise InputError(
            f"there is no file '{name}'",
            where=where,
            hint=_way_to_file(f"{where.key.rpartition('.')[2]}s", name),
        )
    return path


def _way_to_file(shipped: str, name: str) -> str:
    """Return how a file is named that is not there; a bare name may be meant for a shipped one."""
    way = "name it relative to the file that the key stands in"
    if shipped not in KINDS or not name.isidentifier():
        return way
    known = shipped_names(shipped)
    return likely(name, known) or f"{way}, or one that is shipped: {', '.join(known)}"


def file_beside(path: Path, content: Mapping[str, Any], *keys: str) -> Path:
    """Return the path of the file that a key of a YAML file names, relative to that file.

    Args:
        path: the YAML file. content: what it holds. keys: the way to the key that names a file.

    Raises:
        InputError: it is not there; with file, line and key.
    """
    name: Any = content
    for key in keys:
        name = name[key]
    where = Place(str(path), line_of(content, keys), ".".join(keys))
    return named_file(path.resolve().parent, str(name), where)


_PLAIN = frozenset({bool, int, float, type(None)})


def plain(content: Any) -> Any:
    """Return the content as plain dicts, lists, str, int, float, bool, None."""
    if type(content) in _PLAIN or (type(content) is str and content.isascii()):
        return content
    if isinstance(content, dict):
        return {str(key): plain(value) for key, value in content.items()}
    if isinstance(content, list):
        return [plain(value) for value in content]
    if isinstance(content, bool) or content is None:
        return content
    for kind in (int, float):
        if isinstance(content, kind):
            return kind(content)
    text = str(content)
    if text.isascii():
        return text
    # YAML may write a letter as two escapes, halves that no file can hold
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


@cache
def mapping_of(text: str, name: str) -> dict[str, Any]:
    """Return what YAML text with a mapping at its top holds, plain; shared: copy before a change.

    Raises:
        InputError: it is not YAML, with the line; `name` is the file.
    """
    content = plain(parse(text, name))
    assert isinstance(content, dict)
    return content


def validate(
    model: type[M],
    content: Any,
    name: str,
    prefix: Sequence[int | str] = (),
    *,
    context: Any = None,
    places: Places | None = None,
    origins: Places | None = None,
    kind: str = "",
) -> M:
    """Return `content` as `model`; every mistake becomes a sentence with file, line and key.

    Args:
        model: the file format.
        content: what `load` returned, or a part of it.
        name: the file's name, for messages.
        prefix: keys that lead from the file's top to `content`, for messages.
        context: handed to the model's validators (`info.context`).
        places: says where a key stands, for content that was put together from several places.
        origins: says where the value of a key stands, where that may be elsewhere than the key.
        kind: name of the kind of file, where it is a whole file; one of another kind is called so.

    Raises:
        InputError: an unknown key, a missing key, a wrong type or unit; further ones in `also`.
    """

    def place(keys: Sequence[int | str]) -> Place:
        if places is not None:
            return places(keys)
        path = ".".join(str(part) for part in (*prefix, *_key_path(content, keys)))
        return Place(file=name, line=line_of(content, keys), key=path)

    if not isinstance(content, dict):
        found = place(())
        raise InputError(
            f"expected keys and values, found {_value_in_words(content)}",
            where=found if found.line else Place(file=name, line=1, key=found.key),
        )
    try:
        return model.model_validate(plain(content), context=context)
    except ValidationError as error:
        if kind:
            _refuse_other_kind(model, content, kind, name)
        details = error.errors(include_url=False)
        # a value that may be written in several ways is wrong in each of them, and still one
        wrong: dict[tuple[str, ...], Any] = {}
        for detail in sorted(details, key=_rank):
            wrong.setdefault(tuple(_key_path(content, detail["loc"])), detail)
        for keys in _results_of_misspelling(model, list(wrong.items())):
            del wrong[keys]
        of_value = origins or place
        first, *others = [
            _mistake(model, detail, place if detail["type"] in _OF_KEYS else of_value)
            for detail in wrong.values()
        ]
        raise InputError(
            first.what, where=first.where, hint=first.hint, also=tuple(others)
        ) from error


_OF_KEYS = ("extra_forbidden", "missing")
"""Mistakes of a key, not of its value."""


def _mistake(model: type[BaseModel], detail: Any, place: Places) -> InputError:
    """Return what pydantic found as a sentence of ours, with its place and the way out."""
    what = _sentence(detail["type"], detail["msg"], detail["loc"], detail.get("input"))
    hint = _way_out(model, detail["type"], detail["loc"], detail["msg"])
    if detail["type"] == "model_type" and isinstance(detail.get("input"), str):
        hint = _as_keys(model, detail["loc"], detail["input"]) or hint
    # a wrong unit comes with its own way out
    cause = getattr(detail.get("ctx", {}).get("error"), "__cause__", None)
    if not hint and isinstance(cause, EhaBenchError) and what.endswith(f"; {cause.hint}"):
        what, hint = what.removesuffix(f"; {cause.hint}"), cause.hint
    return InputError(what, where=place(_location(detail)), hint=hint)


def _results_of_misspelling(
    model: type[BaseModel], wrong: Sequence[tuple[tuple[str, ...], Any]]
) -> list[tuple[str, ...]]:
    """Return the keys that are only missing because they are there under a misspelt name."""
    meant = {
        (*keys[:-1], _way_out(model, detail["type"], detail["loc"], "").removesuffix("'?")[14:])
        for keys, detail in wrong
        if detail["type"] == "extra_forbidden"
    }
    return [keys for keys, detail in wrong if detail["type"] == "missing" and keys in meant]


def _refuse_results(content: Any, name: str) -> None:
    """Raise an InputError where the content is what a command has written for programs."""
    if isinstance(content, dict) and "schema_version" in content:
        raise InputError(
            "this is a result, as a command has written it",
            where=Place(file=name, line=1),
            hint="give a suite, a model or another YAML file; a result.json goes to 'eha-bench "
            "compare' and 'history', a diagnosis.json to 'next'",
        )


def _refuse_other_kind(model: type[BaseModel], content: Any, kind: str, name: str) -> None:
    """Raise an InputError where the content is a file of another kind than the one expected."""
    _refuse_results(content, name)
    found, wanted = kind_by_keys(content), kind_named(kind)
    if found is not None and found.name != kind:
        # a plant is written with the keys of a model: it is none of another kind
        telling = found.keys & set(content)
        if found.model and wanted.model and telling and telling <= model.model_fields.keys():
            return
        raise InputError(
            f"this is a {found.title}, and a {wanted.title} is expected",
            where=Place(file=name, line=1),
            hint=f"a {found.title} goes to: {found.use}" if found.use else "",
        )


def _location(detail: Any) -> tuple[int | str, ...]:
    raised = detail.get("ctx", {}).get("error")
    further = raised.keys if isinstance(raised, ErrorAt) else ()
    return (*detail["loc"], *further)


def _rank(detail: Any) -> tuple[bool, int]:
    # A misspelt key is reported first (it is why another one is missing), then the deepest problem
    # (of a union's alternatives the one that came furthest).
    return detail["type"] != "extra_forbidden", -len(detail["loc"])


def _value_in_words(content: Any) -> str:
    content = plain(content)
    names = {list: "a list", str: f"the text {_quoted(content)}", type(None): "nothing"}
    return names.get(type(content), _quoted(content))


def _quoted(value: Any) -> str:
    """Return a value in quotes, of a long one its beginning."""
    text = " ".join(str(value).split())
    return f"'{text}'" if len(text) <= _QUOTED else f"'{text[:_QUOTED]} ...'"


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
    "list_type": "expected a list",
    "tuple_type": "expected a list",
    "string_type": "expected text",
}
"""What pydantic says in Python's words, in those of a file."""

_HINTS = {
    "dict_type": "write it as 'key: value' lines",
    "model_type": "write it as 'key: value' lines",
    "list_type": "write [a, b], or a line '- a' for each",
    "tuple_type": "write [a, b], or a line '- a' for each",
    "string_type": "put it into quotes",
    "string_pattern_mismatch": "use letters, digits, '_', '-' and '.'",
}
"""The way out of each."""


_WHOLE = re.compile(r"a valid integer.*")
_NUMERAL = re.compile(r"a valid number.*")
_TRUTH = re.compile(r"a valid boolean.*")


def _sentence(kind: str, message: str, location: Sequence[int | str], found: Any) -> str:
    last = location[-1] if location else ""
    if kind == "extra_forbidden":
        return f"unknown key '{last}'"
    if kind == "missing":
        return f"key '{last}' is missing"
    if kind == "too_short" and message.endswith("not 0"):
        return f"'{last}' is empty: it needs at least 1"
    if kind == "string_pattern_mismatch":
        return f"'{last}' has a character that a name cannot have"
    if kind in _PLAINER:
        return _PLAINER[kind]
    text = message.removeprefix("Value error, ").removeprefix("Assertion failed, ")
    if not text.startswith("Input should"):
        return text
    for pattern, plainer in (
        (_WHOLE, "a whole number"), (_NUMERAL, "a number"), (_TRUTH, "true or false")
    ):  # fmt: skip
        text = pattern.sub(plainer, text)
    if kind in ("enum", "literal_error"):
        return f"{_quoted(found)} is not known here"
    what = "this" if isinstance(found, (dict, list)) else _quoted(found)
    if isinstance(found, (int, float)) and not isinstance(found, bool):
        what = str(found)
    return text.replace("Input", what, 1)


def _way_out(model: type[BaseModel], kind: str, location: Sequence[int | str], message: str) -> str:
    """Return what to write instead: the nearest key that the format has, or the form of a value."""
    if kind == "missing":
        return f"add a line '{location[-1]}: ...'"
    if kind == "too_short":
        return "write [a, b], or take the key out"
    if kind in _HINTS:
        return _HINTS[kind]
    if kind in ("enum", "literal_error"):
        return _nearest_choice(message)
    if kind != "extra_forbidden":
        return ""
    if re.match(r"\d", str(location[-1])):
        return "a comma parts keys: write a number with a point, or quote the text"
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


def _as_keys(model: type[BaseModel], location: Sequence[int | str], text: str) -> str:
    """Return how a text is written where keys are expected: under the first that is needed."""
    known: type[BaseModel] | None = model
    for key in location:
        known = None if known is None else _model_within(known, key)
    fields = {} if known is None else known.model_fields
    first = next((field.alias or name for name, field in fields.items() if field.is_required()), "")
    return f"write {{{first}: {text}}}" if first and len(text) <= _QUOTED else ""


def _nearest_choice(message: str) -> str:
    """Return the choices that pydantic's message lists, as a way out."""
    choices = re.findall(r"'([^']+)'", message.partition("should be")[2])
    return f"known: {', '.join(choices)}" if choices else ""


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


def load_model(model: type[M], path: Path, kind: str = "") -> M:
    """Read a YAML file of a kind and return it as `model`.

    Raises:
        InputError: as `load` and `validate`.
    """
    return validate(model, load(path), str(path), kind=kind)
