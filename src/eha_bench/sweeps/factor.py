"""A factor: something of a case that has another value at every point of a sweep."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

from eha_bench.control.gains import WrittenGain, gains_of, read_gain, unit_of_gain, with_gains
from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.located import Located
from eha_bench.core.near_miss import suggest
from eha_bench.core.trial import Trial
from eha_bench.core.units import base_unit, factor_and_offset, parse, unit_in
from eha_bench.plants.values import parameter_named, read_value, with_values
from eha_bench.suites.load import parse_suite
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.span import Range, Span, Value, span_of
from eha_bench.targets.simulator import Simulator

DEFAULTS: Final = "defaults"
"""In place of a trial's id: what all trials take over."""


@dataclass(frozen=True)
class Factor(ABC):
    """Something that is varied.

    Attributes:
        key: its name within its kind. span: what it may be, SI. unit: SI unit.
        where: where the file names it. shown_in: the unit that the file writes it in.
    """

    key: str
    span: Span
    unit: str
    where: Place
    shown_in: str = ""

    kind: ClassVar[str]

    def as_applied(self, value: Value) -> Value:
        """Return a value as `applied` takes it."""
        return value

    def in_file_unit(self, value: Value) -> Value:
        """Return a value in the unit that the file writes it in."""
        if isinstance(value, str) or not self.shown_in:
            return value
        factor, offset = factor_and_offset(self.shown_in, self.unit)
        return (value - offset) / factor

    def formatted(self, value: Value) -> str:
        """Return a value with its unit, for people."""
        shown = self.in_file_unit(value)
        number = shown if isinstance(shown, str) else f"{shown:.5g}"
        return f"{number} {self.shown_in or self.unit}".rstrip()

    @property
    def about(self) -> str:
        """Its name and its levels or ends, for people."""
        if isinstance(self.span, Range):
            low, high = self.formatted(self.span.low), self.formatted(self.span.high)
            return f"{self.key} {low} ... {high}"
        return f"{self.key} {', '.join(self.formatted(level) for level in self.span.levels)}"

    @abstractmethod
    def declared_value(self, case: Case) -> Value | None:
        """Return the value that a case has as it stands; None where it is unknown."""

    @staticmethod
    @abstractmethod
    def apply(case: Case, values: Mapping[str, Value]) -> Case:
        """Return the case with other values of this kind, by key."""


class Gain(Factor):
    """A gain of a controller: `pressure.k_p`."""

    kind = "gains"

    def declared_value(self, case: Case) -> Value | None:
        """Return the gain of the case's controller."""
        return gains_of(case.simulator.controllers)[self.key]

    @staticmethod
    def apply(case: Case, values: Mapping[str, Value]) -> Case:
        """Return the case with other gains."""
        gains = {key: float(value) for key, value in values.items()}
        controllers = with_gains(case.simulator.controllers, gains)
        return replace(case, simulator=case.simulator.varied(controllers=controllers))


class ModelParameter(Factor):
    """A parameter of the model, or of an effect that it declares: `pump.displacement`."""

    kind = "parameters"

    def declared_value(self, case: Case) -> Value | None:
        """Return the model's value."""
        return case.simulator.model.value(self.key)

    @staticmethod
    def apply(case: Case, values: Mapping[str, Value]) -> Case:
        """Return the case with another model."""
        model = with_values(
            case.simulator.model, {key: float(value) for key, value in values.items()}
        )
        return replace(case, simulator=case.simulator.varied(model=model))


class TrialKey(Factor):
    """A key of a trial as its suite writes it: `pressure_step.signal.at`."""

    kind = "trials"

    def declared_value(self, case: Case) -> Value | None:
        """Nothing: a key may stand there with a unit, by a name of the matrix, or not at all."""
        del case
        return None

    def as_applied(self, value: Value) -> Value:
        """Return the value with its unit."""
        return with_unit(value, self.unit)

    @staticmethod
    def apply(case: Case, values: Mapping[str, Value]) -> Case:
        """Return the case with a suite that says otherwise."""
        content = copy.deepcopy(yaml_file.mapping_of(case.suite.text, str(case.suite.path)))
        for key, value in values.items():
            block, last = _block(content, key, Place(file=str(case.suite.path), key=key))
            block[last] = value
        text = yaml_file.to_text(content)
        return replace(case, suite=parse_suite(text, case.suite.path))


_ALL: Final[tuple[type[Factor], ...]] = (Gain, ModelParameter, TrialKey)
KINDS: Final = {kind.kind: kind for kind in _ALL}


def _block(content: dict[str, Any], key: str, where: Place) -> tuple[dict[str, Any], str]:
    """Return the mapping that holds a trial's key, and the key's last word."""
    trials = {str(item.get("id", "")): item for item in content.get("trials", [])}
    blocks = {DEFAULTS: content.setdefault(DEFAULTS, {}), **trials}
    # the id of a trial may hold dots itself
    owner = max((name for name in blocks if key.startswith(f"{name}.")), key=len, default="")
    if not owner:
        raise InputError(
            f"'{key}' names no trial of the suite",
            where=where,
            hint=suggest(key.partition(".")[0], blocks),
        )
    block = blocks[owner]
    *path, last = key[len(owner) + 1 :].split(".")
    for word in path:
        block = block.setdefault(word, {})
        if not isinstance(block, dict):
            raise InputError(f"'{word}' of '{key}' holds no keys", where=where)
    return block, last


def _check_closes_a_loop(case: Case, key: str, where: Place) -> None:
    """Refuse a gain of a mode whose trials all impose a motion.

    Raises:
        InputError: it is one.
    """
    mode = key.partition(".")[0]
    trials = [trial for trial in case.suite.trials if trial.mode.name == mode]
    if trials and all(case.simulator.imposes(trial) for trial in trials):
        raise InputError(
            f"trial '{trials[0].id}' imposes {mode}: no controller closes that loop, and "
            f"'{key}' would change nothing",
            where=where,
            hint="vary parameters of the model, or give it an input that is commanded",
        )


def factor_of(kind: type[Factor], case: Case, key: str, content: Located) -> Factor:
    """Return the factor that an entry of a file declares.

    Args:
        kind: gains, parameters or trials. case: what is varied. key: its name.
        content: what it may be.

    Raises:
        InputError: the case has no such factor, or it cannot be what the entry says.
    """
    where = content.place()
    if kind is Gain:
        controllers, written = case.simulator.controllers, _written_unit(content)
        unit = unit_of_gain(controllers, key, where) or (base_unit(written) if written else "")

        def read_as_taken(raw: Any, at: Place) -> Value:
            gain = read_gain(controllers, key, raw, at)
            _check_taken(case, key, gain, at)
            return gain.value

        _check_closes_a_loop(case, key, where)
        return Gain(key, span_of(content, read_as_taken), unit, where, written)
    if kind is ModelParameter:
        model = case.simulator.model
        unit = parameter_named(model, key, where)[1].unit
        span = span_of(content, lambda raw, at: read_value(model, key, raw, at))
        return ModelParameter(key, span, unit, where, _written_unit(content))
    written = _written_unit(content)
    unit = base_unit(written) if written else ""

    def read(raw: Any, at: Place) -> Value:
        value = _quantity(raw, unit, at)
        try:
            TrialKey.apply(case, {key: with_unit(value, unit)})
        except InputError as error:
            raise InputError(error.what, where=at, hint=error.hint) from error
        return value

    return TrialKey(key, span_of(content, read), unit, where, written)


def _check_taken(case: Case, key: str, gain: WrittenGain, where: Place) -> None:
    """Raise an InputError where a trial's controller does not take a gain as it is written.

    A gain of some controllers (pid) is of a unit that follows from what a trial controls.
    """
    changed = case.simulator.varied(controllers=gain.controllers)
    for trial in case.suite.trials:
        if key.startswith(f"{trial.mode.name}."):
            try:
                changed.check(trial)
            except InputError as error:
                if not _refused(case.simulator, trial):  # not for another reason
                    raise InputError(error.what, where=where, hint=error.hint) from error


def _refused(simulator: Simulator, trial: Trial) -> bool:
    try:
        simulator.check(trial)
    except InputError:
        return True
    return False


def _written_unit(content: Located) -> str:
    """Return the unit of the first quantity of an entry that names one."""
    value = content.value
    raws = [value.get("from"), value.get("to")] if isinstance(value, dict) else value
    units = [unit_in(raw) for raw in raws or () if isinstance(raw, str) and _is_quantity(raw)]
    return next((unit for unit in units if unit), "")


def _is_quantity(text: str) -> bool:
    try:
        parse(text, base_unit(unit_in(text)) if unit_in(text) else "")
    except UnitError:
        return False
    return True


def _quantity(raw: Any, unit: str, where: Place) -> Value:
    """Return a number in SI, or a word as it stands."""
    if isinstance(raw, str) and not _is_quantity(raw):
        return raw
    try:
        return parse(raw, unit)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def with_unit(value: Value, unit: str) -> Value:
    """Return a value in SI as a suite takes it, with the unit that says what kind of number."""
    return value if isinstance(value, str) or not unit else f"{value!r} {unit}"
