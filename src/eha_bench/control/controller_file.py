"""controller.yaml: one revision of the controllers, one block for each control mode.

    pressure:    {controller: pressure_pi, k_1: 0.9 A/MPa, ...}
    joint_angle: {controller: my_package.module:MyController, ...}

A mode is one of the well-known ones or any channel of the target. `controller` is a registered name
or `module:Class`; the other keys are its gains. A mode without a block cannot be run, except the
target's command, which needs no controller. `extends: base.yaml` (or a shipped name) takes over the
blocks of another file, key by key: only what differs is written again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from eha_bench.control.controller import Context, Controller, NoGains
from eha_bench.control.open_loop import OpenLoop
from eha_bench.core import plugins, yaml_file
from eha_bench.core.errors import InputError, Mistakes, Place, PluginError
from eha_bench.core.located import Located
from eha_bench.core.plugin_class import check_class
from eha_bench.core.shipped import by_name
from eha_bench.core.trial import ControlMode, mode_named, passes_on
from eha_bench.core.yaml_file import StrictModel

_NO_MODES = ("description", "extends")

Block = Annotated[
    dict[str, Any], Field(description="controller: name or module:Class, and its gains")
]


class ControllerFile(StrictModel):
    """controller.yaml: the controller of each control mode, by the mode's name."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)
    __pydantic_extra__: dict[str, Block]

    description: str = ""
    extends: Annotated[
        str | None, Field(description="controller.yaml whose blocks this one takes over")
    ] = None
    current: Block | None = None
    pressure: Block | None = None
    joint_angle: Block | None = None
    motor_speed: Block | None = None
    piston_position: Block | None = None


@dataclass(frozen=True)
class ControllerSpec:
    """A controller class with its gains; makes a fresh controller for every run.

    Attributes:
        kind, gains: the class, and what it is made with.
        places: where each gain is written, by its key.
        source: `module:Class` and the folder of the file that names it; empty for a registered one.
    """

    kind: type[Controller]
    gains: StrictModel
    places: Mapping[str, Place] = field(default_factory=dict)
    source: tuple[str, str] = ("", "")

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes by name where the class is a user's: they look for it again."""
        if not self.source[0]:
            return ControllerSpec, (self.kind, self.gains, self.places)
        return _again, (self.source, self.gains.model_dump(), self.places)

    def make(self, context: Context) -> Controller:
        """Return a controller at rest.

        Raises:
            InputError: a gain that does not suit the target, with its line.
        """
        try:
            return self.kind(self.gains, context)
        except InputError as error:
            place = self.places.get(error.where.key)
            if place is None:
                raise
            raise InputError(error.what, where=place, hint=error.hint) from error


def _again(
    source: tuple[str, str], gains: dict[str, Any], places: Mapping[str, Place]
) -> ControllerSpec:
    reference, base = source
    kind = plugins.load_class(reference, base=Path(base))
    assert kind is not None
    return ControllerSpec(kind, kind.Gains.model_validate(gains), places, source)


@dataclass(frozen=True)
class ControllerSet:
    """One revision: a controller for each control mode, and the text it came from."""

    by_mode: Mapping[str, ControllerSpec]
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
        spec = self.by_mode.get(mode.name)
        if spec is None:
            if passes_on(mode, context.command):
                return OpenLoop(NoGains(), context)
            raise InputError(
                f"no controller for mode '{mode.name}'",
                where=Place(file=self.name),
                hint=f"add a block '{mode.name}:' to the controller file, e.g. with `pid`",
            )
        return spec.make(context)


def load_controllers(path: Path) -> ControllerSet:
    """Read a controller.yaml and those it extends; classes that they name are loaded.

    Raises:
        InputError: unknown controller or gain, wrong unit, files that extend each other in a
            circle, with file, line and key; further mistakes in `also`.
    """
    content = _content_over_base(path, ())
    text = yaml_file.read_text(path)
    if "extends" in _own(path).value:
        # a recording carries all of it
        text = yaml_file.to_text(content.without("extends").value)
    return parse_controllers(content, str(path), text)


def _own(path: Path) -> Located:
    text = yaml_file.read_text(path)
    content = Located.of(yaml_file.parse(text, str(path)), str(path))
    yaml_file.validate(
        ControllerFile, content.value, str(path), places=content.place, kind="controller"
    )
    return content


def _content_over_base(path: Path, on_the_way: tuple[Path, ...]) -> Located:
    """Return a file's content over that of the file it extends."""
    content = _own(path)
    base = content.value.get("extends")
    if base is None:
        return content
    where = content.place(("extends",))
    file = by_name("controllers", base) or yaml_file.named_file(path.parent, base, where)
    if file.resolve() in (path.resolve(), *on_the_way):
        raise InputError(
            f"'{base}' extends this file, which extends it",
            where=where,
            hint="let one of the files stand on its own",
        )
    return content.over_all(_content_over_base(file, (*on_the_way, path.resolve())))


def parse_controllers(content: Located, name: str, text: str) -> ControllerSet:
    """Return the controllers that a controller file holds.

    Raises:
        InputError: as `load_controllers`.
    """
    mistakes = Mistakes()
    by_mode = {}
    for key, block in content.items():
        if key not in _NO_MODES and block.value is not None:
            with mistakes:
                mode = mode_named(key, where=block.place())
                by_mode[mode.name] = _parse_block(block)
    mistakes.tell()
    return ControllerSet(by_mode, name, text)


def _parse_block(block: Located) -> ControllerSpec:
    where = block.place(("controller",))
    source = ("", "")
    reference = block.value.get("controller")
    if not isinstance(reference, str):
        raise InputError(
            "key 'controller' is missing",
            where=where,
            hint=f"known: {', '.join(plugins.names('controllers'))}, or module:Class",
        )
    try:
        if ":" in reference:
            base = Path(where.file).resolve().parent
            kind = plugins.load_class(reference, base=base)
            source = (reference, str(base))
        else:
            kind = plugins.load("controllers", reference)
    except PluginError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if kind is None:  # the file is only checked, and this stands in for what is not loaded
        return ControllerSpec(OpenLoop, NoGains())
    if not (isinstance(kind, type) and issubclass(kind, Controller)):
        raise InputError(
            f"'{reference}' is not a Controller class",
            where=where,
            hint="derive it from eha_bench.control.controller.Controller",
        )
    check_class(kind, Controller, f"controller '{reference}'", where=where)
    gains = block.without("controller")
    checked = yaml_file.validate(kind.Gains, gains.value, where.file, places=gains.place)
    places = {key: gains.place((key,)) for key in gains.value}
    return ControllerSpec(kind, checked, places, source)
