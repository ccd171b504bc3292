"""What a nightly.yaml has to follow: the model, its causes, and the suite that limits them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from eha_bench.causes.cause import Cause, causes_of
from eha_bench.core import yaml_file
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.core.shipped import by_name
from eha_bench.plants.layout import Layout
from eha_bench.plants.model import Model, model_from
from eha_bench.plants.static_plant import StaticPlant
from eha_bench.suites import load_suite
from eha_bench.sweeps.case import Case, case_of
from eha_bench.targets.resolve import open_target
from eha_bench.trends.nightly_file import Diagnose, load_nightly

_VERSION = 2
"""Of what is kept of a night: another one is estimated again."""


@dataclass(frozen=True)
class CauseSettings:
    """What is followed.

    Attributes:
        model: of the machine, as declared. inputs: channels that drive it.
        causes: what may wear. trials: whose recordings are used; all if empty.
        healthy: first nights on which nothing wears. case: the suite on the simulator, or None.
        channels: channels.yaml of recordings made elsewhere, or None.
    """

    model: Model
    inputs: tuple[str, ...]
    causes: tuple[Cause, ...]
    trials: tuple[str, ...]
    healthy: int
    case: Case | None
    channels: Path | None

    @property
    def digest(self) -> str:
        """Of all that a night's evidence depends on."""
        content = [
            _VERSION, self.model.sha256, self.inputs, [cause.name for cause in self.causes],
            self.trials, None if self.channels is None else self.channels.read_text("utf-8"),
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def load_cause_settings(path: Path) -> CauseSettings:
    """Read what a nightly.yaml has under `diagnose`.

    Raises:
        InputError: it has nothing there, or it is wrong, with file, line and key.
    """
    nightly = load_nightly(path)
    if nightly.diagnose is None:
        raise InputError(
            "there is nothing to diagnose",
            where=Place(file=str(path), key="diagnose"),
            hint="name the machine's model: 'diagnose: {model: model.yaml, suite: suite.yaml}'",
        )
    content = yaml_file.load(path)

    def place(*keys: int | str) -> Place:
        whole = ("diagnose", *keys)
        return Place(
            file=str(path),
            line=yaml_file.line_of(content, whole),
            key=".".join(str(key) for key in whole),
        )

    return _checked(nightly.diagnose, path.parent, place)


def _checked(declared: Diagnose, folder: Path, place: Callable[..., Place]) -> CauseSettings:
    shipped = by_name("models", declared.model)
    model = model_from(shipped or _existing(folder, declared.model, place("model")))
    plant = model.plant
    if isinstance(plant, StaticPlant):
        raise InputError(
            f"{plant.id} has operating points, and no recording over time", where=place("model")
        )
    if not model.calibrate:
        raise InputError(
            "the model has nothing under 'calibrate': no night could be estimated",
            where=place("model"),
            hint="list under 'calibrate' what may differ from machine to machine",
        )
    for number, name in enumerate(declared.follow):
        _check_followed(plant.layout, name, place("follow", number))
    case = _case(declared, folder, place)
    for number, name in enumerate(declared.trials):
        known = [trial.id for trial in case.suite.trials] if case is not None else [name]
        if name not in known:
            raise InputError(
                f"the suite has no trial '{name}'",
                where=place("trials", number),
                hint=suggest(name, known),
            )
    channels = (
        _existing(folder, declared.channels, place("channels")) if declared.channels else None
    )
    return CauseSettings(
        model, tuple(declared.inputs), causes_of(model, declared.follow), tuple(declared.trials),
        declared.healthy_nights, case, channels,
    )  # fmt: skip


def _check_followed(layout: Layout, name: str, where: Place) -> None:
    own = {item.name for item in layout.parameters}
    effects = [effect.id for effect in layout.effects]
    if name in effects or layout.key(name) in own:
        return
    raise InputError(
        f"{layout.plant} has no parameter and no place for an effect '{name}'",
        where=where,
        hint=suggest(name, (*effects, *own)),
    )


def _case(declared: Diagnose, folder: Path, place: Callable[..., Place]) -> Case | None:
    if not declared.suite:
        return None
    shipped = by_name("suites", declared.suite)
    suite = load_suite(shipped or _existing(folder, declared.suite, place("suite")))
    given = declared.target or declared.model
    key = "target" if declared.target else "model"
    named = by_name("targets", given) or by_name("models", given)
    path = named or _existing(folder, given, place(key))
    try:
        return case_of(suite, open_target(path, suite.file))
    except EhaBenchError as error:
        if error.where.file:
            raise
        raise InputError(error.what, where=place(key), hint=error.hint) from error


def _existing(folder: Path, name: str, where: Place) -> Path:
    path = folder / name
    if not path.is_file():
        raise InputError(f"'{name}' is not there", where=where)
    return path
