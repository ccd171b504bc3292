"""controller.yaml: one revision of the controllers, one block for each control mode.

    pressure:    {controller: pressure_pi, k_1: 0.9 A/MPa, ...}
    joint_angle: {controller: my_package.module:MyController, ...}

`controller` is a registered name or `module:Class`; the other keys are its gains. A mode without a
block cannot be run, except `current`, which needs no controller.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from eha_bench.control.controller import Context, Controller, NoGains
from eha_bench.control.open_loop import OpenLoop
from eha_bench.core import plugins, yaml_file
from eha_bench.core.errors import InputError, Place, PluginError
from eha_bench.core.trial import ControlMode
from eha_bench.core.yaml_file import StrictModel

Block = Annotated[
    dict[str, Any], Field(description="controller: name or module:Class, and its gains")
]


class ControllerFile(StrictModel):
    """controller.yaml: the controller of each control mode."""

    description: str = ""
    current: Block | None = None
    pressure: Block | None = None
    joint_angle: Block | None = None
    motor_speed: Block | None = None
    piston_position: Block | None = None


@dataclass(frozen=True)
class ControllerSpec:
    """A controller class with its gains; makes a fresh controller for every run."""

    kind: type[Controller]
    gains: StrictModel

    def make(self, context: Context) -> Controller:
        """Return a controller at rest."""
        return self.kind(self.gains, context)


@dataclass(frozen=True)
class ControllerSet:
    """One revision: a controller for each control mode, and the text it came from."""

    by_mode: Mapping[ControlMode, ControllerSpec]
    name: str = ""
    text: str = ""

    @property
    def sha256(self) -> str:
        """Digest of the file."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def make(self, mode: ControlMode, context: Context) -> Controller:
        """Return a fresh controller for a mode.

        Raises:
            InputError: the revision has no controller for that mode.
        """
        spec = self.by_mode.get(mode)
        if spec is None:
            if mode is ControlMode.CURRENT:
                return OpenLoop(NoGains(), context)
            raise InputError(
                f"no controller for mode '{mode.value}'",
                where=Place(file=self.name),
                hint=f"add a block '{mode.value}:' to the controller file",
            )
        return spec.make(context)


def load_controllers(path: Path) -> ControllerSet:
    """Read a controller.yaml; classes that it names are loaded.

    Raises:
        InputError: unknown controller or gain, wrong unit, with file, line and key.
    """
    content = yaml_file.load(path)
    text = path.read_text(encoding="utf-8")
    return parse_controllers(content, str(path), text, base=path.resolve().parent)


def parse_controllers(content: Any, name: str, text: str, *, base: Path | None) -> ControllerSet:
    """Return the controllers that a YAML mapping holds."""
    file = yaml_file.validate(ControllerFile, content, name)
    by_mode = {}
    for mode in ControlMode:
        if getattr(file, mode.value) is not None:
            by_mode[mode] = _parse_block(content, name, mode.value, base)
    return ControllerSet(by_mode, name, text)


def _parse_block(content: Any, name: str, mode: str, base: Path | None) -> ControllerSpec:
    block = content[mode]
    line = yaml_file.line_of(content, [mode, "controller"])
    where = Place(file=name, line=line, key=f"{mode}.controller")
    reference = block.get("controller")
    if not isinstance(reference, str):
        raise InputError("key 'controller' is missing", where=where)
    try:
        if ":" in reference:
            kind = plugins.load_class(reference, base=base)
        else:
            kind = plugins.load("controllers", reference)
    except PluginError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if not (isinstance(kind, type) and issubclass(kind, Controller)):
        raise InputError(f"'{reference}' is not a Controller class", where=where)
    gains = {key: value for key, value in block.items() if key != "controller"}

    def places(keys: Sequence[int | str]) -> Place:
        path = (mode, *keys)
        return Place(
            file=name,
            line=yaml_file.line_of(content, path),
            key=".".join(str(key) for key in path),
        )

    return ControllerSpec(kind, yaml_file.validate(kind.Gains, gains, name, places=places))
