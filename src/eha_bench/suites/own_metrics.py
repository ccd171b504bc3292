"""The block `metrics` of a suite: user-defined metrics, as formulas."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from eha_bench.core import plugins
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Mistakes, Place, UnitError
from eha_bench.core.located import Located
from eha_bench.core.metric import METRICS, STATISTICS, MetricSpec, metric_spec
from eha_bench.core.near_miss import likely
from eha_bench.core.own_metric import OwnMetric
from eha_bench.core.units import base_unit
from eha_bench.core.yaml_file import StrictModel, validate
from eha_bench.suites.signals.signal_model import Moment

# formulas work on arrays, which who reads a suite without any does not need
if TYPE_CHECKING:
    from eha_bench.core.formula import MetricInput, Statistic

NAME = r"^[A-Za-z_][A-Za-z0-9_]*$"
"""What a user-defined metric may be called: a formula has to be able to name it."""

_MISSPELT = 0.9


class OwnMetricFile(StrictModel):
    """A user-defined metric."""

    expression: str = Field(
        description="arithmetic over metrics (rise_time, peak(pressure_a)) and statistics of "
        f"channels ({', '.join(STATISTICS)}), in SI"
    )
    unit: str = Field(default="", description="unit that the expression comes out in")
    description: str = ""
    start: Moment | None = Field(
        default=None, alias="from", description="start of the statistics, s of the signal"
    )
    stop: Moment | None = Field(default=None, alias="to", description="end of the statistics, s")


@dataclass(frozen=True)
class OwnMetrics:
    """The suite's own metrics.

    Attributes:
        by_id: in their order; a mistaken one is among them with any formula, so that what names it
            is no further mistake.
        without_unit: those whose unit is mistaken: no limit of them can be read.
    """

    by_id: dict[str, OwnMetric]
    without_unit: frozenset[str]

    @property
    def specs(self) -> dict[str, MetricSpec]:
        """Their specifications, by id."""
        return {name: metric.spec for name, metric in self.by_id.items()}

    def readable(self, limits: Located) -> Located:
        """Return limits, or differences that matter, by metric without those that cannot be read.

        The unit that they lack has been named at its metric.
        """
        if not isinstance(limits.value, dict):
            return limits
        return limits.without(*self.without_unit)


def own_metrics(metrics: Located, mistakes: Mistakes) -> OwnMetrics:
    """Return the suite's own metrics.

    Args:
        metrics: the block. mistakes: takes a name that is taken, no formula, a metric that does not
            exist or is defined further down, a misspelt channel, an unknown unit.
    """
    found: dict[str, OwnMetric] = {}
    without_unit: set[str] = set()
    written: Located = metrics
    with mistakes:
        written = metrics.mapping("formulas by metric")
    entries = written.items() if isinstance(written.value, dict) else ()
    for name, entry in entries:
        with mistakes:
            found[name] = _own(name, entry, found, list(written.value))
        if name not in found and not _is_taken(name):
            unit = _unit(entry)
            found[name] = _with_any_formula(name, unit or "")
            if unit is None:
                without_unit.add(name)
    return OwnMetrics(found, frozenset(without_unit))


def _is_taken(name: str) -> bool:
    from eha_bench.core.expression import FUNCTIONS

    return name in METRICS or name in plugins.names("metrics") or name in (*STATISTICS, *FUNCTIONS)


def _unit(entry: Located) -> str | None:
    """Return the SI unit that a mistaken metric is given; None where that is the mistake."""
    unit = entry.value.get("unit", "") if isinstance(entry.value, dict) else ""
    try:
        return base_unit(unit) if unit else ""
    except (UnitError, TypeError):
        return None


def _with_any_formula(name: str, unit: str) -> OwnMetric:
    from eha_bench.core.formula import Formula

    return OwnMetric(name, Formula.parse("peak"), unit, "", -math.inf, math.inf)


def needed_metrics(own: Mapping[str, OwnMetric], asked: Iterable[str]) -> tuple[OwnMetric, ...]:
    """Return those of a suite's own metrics that a trial asks for, and those that they need."""
    wanted = set(asked)
    chosen = []
    for name, metric in reversed(list(own.items())):  # what is needed stands further up
        if name in wanted:
            chosen.append(metric)
            wanted |= metric.formula.metrics
    return tuple(reversed(chosen))


def _own(name: object, entry: Located, before: dict[str, OwnMetric], all_: list[str]) -> OwnMetric:
    from eha_bench.core.formula import Formula

    if not isinstance(name, str) or not re.match(NAME, name):
        raise entry.error(
            f"'{name}' is not a name for a metric", hint="letters, digits and _, no digit first"
        )
    if _is_taken(name):
        raise entry.error(
            f"'{name}' is already the name of something else", hint="choose another name"
        )
    content = {"expression": entry.value} if isinstance(entry.value, str) else entry.value
    form = validate(OwnMetricFile, content, "", places=entry.place)
    where = entry.place(("expression",)) if isinstance(entry.value, dict) else entry.place()
    try:
        formula = Formula.parse(form.expression)
    except ValueError as error:
        raise InputError(
            str(error), where=where, hint="write 'mean(abs(current)) * rise_time', say"
        ) from error
    mistakes = Mistakes()
    for part in formula.inputs.values():
        with mistakes:
            _check(part, before, all_, where)
    mistakes.tell()
    try:
        unit = base_unit(form.unit) if form.unit else ""
    except UnitError as error:
        raise InputError(error.what, where=entry.place(("unit",)), hint=error.hint) from error
    start = -math.inf if form.start is None else form.start
    stop = math.inf if form.stop is None else form.stop
    if not start < stop:
        raise InputError("'to' is not after 'from'", where=entry.place(("to",)))
    return OwnMetric(name, formula, unit, form.description.strip(), start, stop)


def _check(
    part: Statistic | MetricInput, before: Mapping[str, OwnMetric], all_: list[str], where: Place
) -> None:
    """Raise an InputError for what cannot be meant."""
    from eha_bench.core.formula import Statistic

    if isinstance(part, Statistic):
        for channel in part.of.names:
            _check_channel(channel, where)
        return
    if part.metric not in before:
        if part.metric in all_:
            raise InputError(
                f"'{part.metric}' is not defined above",
                where=where,
                hint="a metric may use those that stand before it",
            )
        if part.metric in CHANNELS:
            raise InputError(
                f"'{part.metric}' is a channel",
                where=where,
                hint=f"take a statistic of it: mean({part.metric}), max({part.metric}) ...",
            )
        metric_spec(part.metric, where=where)
    if part.channel:
        _check_channel(part.channel, where)


def _check_channel(channel: str, where: Place) -> None:
    if channel in CHANNELS:
        return
    hint = likely(channel, CHANNELS, likeness=_MISSPELT)
    if hint:
        raise InputError(f"unknown channel '{channel}'", where=where, hint=hint)
