"""What `--target` may be: a registered name, a target.yaml, or any file with a model in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from eha_bench.core import plugins, yaml_file
from eha_bench.core.error_text import error_text
from eha_bench.core.errors import EhaBenchError, InputError, Place, PluginError
from eha_bench.core.file_kind import kind_by_keys
from eha_bench.core.plugin_class import check_class
from eha_bench.core.shipped import find
from eha_bench.targets.simulator import default_simulator
from eha_bench.targets.target import Target

_SIMULATOR = "simulator"


def _names_nothing(_key: str) -> None:
    return None


def open_target(
    target: str | Path | Mapping[str, Any], named: Callable[[str], Path | None] = _names_nothing
) -> Target:
    """Return the target that a name or a file stands for.

    Args:
        target: `simulator`, the path of a target.yaml (key `target:`) or of a file that holds a
            model to simulate, the name of a shipped one, or a dict of what such a file would hold.
        named: the file that a suite names as `model` or `controller`, which a target that brings
            its own is not asked for.

    Raises:
        InputError: no such target, or its file is wrong.
    """
    if isinstance(target, Mapping):
        path = yaml_file.file_of_content(target, "target" if "target" in target else "model")
    elif str(target) == _SIMULATOR:
        return default_simulator(named("model"), named("controller"))
    else:
        path = _file(target)
    content = yaml_file.load(path)
    if isinstance(content, dict) and "target" in content:
        return _from_file(path, content)
    found = kind_by_keys(content)
    if found is not None and found.model is not None:
        return default_simulator(path, named("controller"))
    what = f"this is a {found.title}, and a target or a model is expected" if found else (
        "neither a target nor a model"
    )  # fmt: skip
    raise InputError(
        what,
        where=Place(file=str(path), line=1),
        hint="a target.yaml begins with 'target:', a model.yaml with 'model:'",
    )


def _file(target: str | Path) -> Path:
    """Return the file of a target or model, which may be a shipped one."""
    path = find(target, "targets", "models", also=(_SIMULATOR,))
    if path.suffix not in (".yaml", ".yml"):
        kinds = ", ".join(plugins.names("targets"))
        raise InputError(
            f"unknown target '{target}'",
            hint=f"give 'simulator', a model.yaml, or a target.yaml (its kinds: {kinds})",
        )
    return path


def _from_file(path: Path, content: dict[str, object]) -> Target:
    line = yaml_file.line_of(content, ["target"])
    where = Place(file=str(path), line=line, key="target")
    try:
        make = plugins.load("targets", str(content["target"]))
    except PluginError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    try:
        target = make(path, content)
    except EhaBenchError:
        raise
    except Exception as error:
        raise PluginError(
            f"target '{content['target']}' cannot be made ({error_text(error)})", where=where
        ) from error
    if not isinstance(target, Target):
        raise InputError(f"'{content['target']}' does not make a Target", where=where)
    check_class(type(target), Target, f"target '{content['target']}'", where=where)
    return target
