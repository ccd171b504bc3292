"""What `--target` may be: a registered name, a target.yaml, or a model.yaml to simulate."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from eha_bench.core import plugins, yaml_file
from eha_bench.core.errors import EhaBenchError, InputError, Place, PluginError
from eha_bench.targets.crash import told
from eha_bench.targets.simulator import default_simulator
from eha_bench.targets.target import Target


def _names_nothing(_key: str) -> None:
    return None


def open_target(target: str | Path, named: Callable[[str], Path | None] = _names_nothing) -> Target:
    """Return the target that a name or a file stands for.

    Args:
        target: `simulator`, the path of a target.yaml (key `target:`) or of a model.yaml.
        named: the file that a suite names as `model` or `controller`, which a target that brings
            its own is not asked for.

    Raises:
        InputError: no such target, or its file is wrong.
    """
    if str(target) == "simulator":
        return default_simulator(named("model"), named("controller"))
    path = Path(target)
    if path.suffix not in (".yaml", ".yml"):
        names = ", ".join(plugins.names("targets"))
        raise InputError(
            f"unknown target '{target}'",
            hint=f"give 'simulator', a model.yaml, or a target.yaml (its kinds: {names})",
        )
    content = yaml_file.load(path)
    if isinstance(content, dict) and "target" in content:
        return _from_file(path, content)
    if isinstance(content, dict) and "model" in content:
        return default_simulator(path, named("controller"))
    raise InputError(
        "neither a target nor a model", where=Place(file=str(path)), hint="expected 'target:'"
    )


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
            f"target '{content['target']}' cannot be made ({told(error)})", where=where
        ) from error
    if not isinstance(target, Target):
        raise InputError(f"'{content['target']}' does not make a Target", where=where)
    return target
