"""The blocks `accept`, `scores` and `safety` of a trial become limits in SI."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from pydantic import Field

from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Mistakes, Place, UnitError
from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats, SafetyLimit
from eha_bench.core.located import Located
from eha_bench.core.near_miss import likely, suggest
from eha_bench.core.signal import Signal
from eha_bench.core.trial import ControlMode
from eha_bench.core.units import base_unit
from eha_bench.core.yaml_file import Real, StrictModel, validate
from eha_bench.suites.acceptance.baseline import BaselineResult, scaled_bounds
from eha_bench.suites.acceptance.grammar import LimitWords, examples, parse_bounds, split_words
from eha_bench.suites.acceptance.specs import NONE, Specs, spec_named

Quantity: TypeAlias = Real | str

_MISSPELT = 0.8
"""Similarity to a known channel's name from which it is taken for a misspelling, without a unit."""
_WRITTEN = re.compile(r"\d(?:[eE][-+]?\d+)?\s*([^\W\d_][^\s,<>=+]*|%)")
"""A number and its unit, within a limit's text."""


class BoundsFile(StrictModel):
    """A limit written as keys: `limit`, or `min` and `max`.

    `unit` says the unit of a channel that eha_bench does not know, where the bounds do not.
    """

    limit: str | None = None
    min: Quantity | None = None
    max: Quantity | None = None
    unit: str = ""


class LimitFile(BoundsFile):
    """An acceptance limit: bounds, the channel it is scored on, and how it is judged."""

    channel: str | None = None
    warn: str | BoundsFile | None = None
    confidence: Literal["95 %", "95%"] | None = Field(
        default=None, description="the whole 95 % interval has to keep the bounds"
    )
    repeats: Repeats = Field(
        default=Repeats.ALL, description="every repeat, or all by the worst or the median"
    )


class ScoreFile(StrictModel):
    """A metric to compute, on another channel than the controlled one."""

    metric: str
    channel: str
    unit: str = Field(default="", description="unit of a channel that eha_bench does not know")


@dataclass(frozen=True)
class Judgement:
    """What `accept` and `scores` ask for."""

    limits: tuple[AcceptanceLimit, ...]
    scores: tuple[tuple[str, str], ...]


def judgement(
    accept: Located,
    scores: Located,
    mode: ControlMode,
    trial: str,
    baseline: BaselineResult,
    signal: Signal | None,
    own: Specs = NONE,
) -> Judgement:
    """Return the acceptance limits, and the (metric, channel) pairs to compute without limit.

    `trial` is the id under which the `baseline` has the values of relative limits; `signal` is None
    where it could not be read; `own` are the suite's own metrics.

    Raises:
        InputError: an unknown metric or channel, not a limit, a wrong unit, the same limit twice,
            or a limit on what a trial of this signal never has; further ones in `also`.
    """
    mistakes = Mistakes()
    limits: dict[tuple[str, str], AcceptanceLimit] = {}
    pairs: dict[tuple[str, str], None] = {}
    for metric, entry in accept.mapping("limits by metric").items():
        several = isinstance(entry.value, list)
        entries = [entry.at(i) for i in range(len(entry.value))] if several else [entry]
        if not entries:
            with mistakes:
                raise entry.error(
                    f"the list of limits of {metric} is empty",
                    hint="give a limit, or null to score it without one",
                )
        for one in entries:
            with mistakes:
                pair, limit = _acceptance(metric, one, mode, trial, baseline, own)
                if pair in limits or pair in pairs:
                    raise one.error(
                        f"{metric} of {pair[1] or 'the run'} is limited twice",
                        hint="give each entry its own 'channel'",
                    )
                if limit is None:
                    pairs[pair] = None
                else:
                    _check_applies(metric, one, trial, signal, own)
                    limits[pair] = limit
    with mistakes:
        for pair in _scores(scores, mode, own):
            if pair not in limits:
                pairs[pair] = None
    mistakes.tell()
    return Judgement(tuple(limits.values()), tuple(pairs))


def _check_applies(
    metric: str, entry: Located, trial: str, signal: Signal | None, own: Specs
) -> None:
    """Raise an InputError for a limit that nothing in the trial can ever be judged by."""
    needs = spec_named(metric, own, entry.place()).needs
    if needs is None or signal is None or needs.met_by(signal):
        return
    raise entry.error(
        f"'{metric}' needs {needs.value}, which the signal of trial '{trial}' does not have "
        "within its duration",
        hint=f"remove the limit, or write '{metric}: null' in a trial that has it by 'defaults'",
    )


def safety_limits(safety: Located, mode: ControlMode) -> tuple[SafetyLimit, ...]:
    """Return the bounds that channels must keep during the run.

    Raises:
        InputError: an unknown channel, not a limit, a wrong unit.
    """
    limits = []
    mistakes = Mistakes()
    for channel, entry in safety.mapping("limits by channel").items():
        with mistakes:
            form = _form(BoundsFile, entry)
            unit = _unit_of(channel, form, mode, entry.place())
            bounds, text = _bounds(form, unit, entry)
            own = "" if channel in CHANNELS else unit
            limits.append(SafetyLimit(channel, bounds, text, own))
    mistakes.tell()
    return tuple(limits)


def _acceptance(
    metric: str, entry: Located, mode: ControlMode, trial: str, baseline: BaselineResult, own: Specs
) -> tuple[tuple[str, str], AcceptanceLimit | None]:
    """Return the (metric, channel) of an entry, and its limit if it has one."""
    spec = spec_named(metric, own, entry.place())
    shown = spec.unit_for(mode.unit)
    form = LimitFile() if entry.value is None else _form(LimitFile, entry, shown)
    channel = spec.channel_for(mode.channel) if form.channel is None else form.channel
    if channel and metric in own:
        raise entry.error(f"'{metric}' is one number of the recording", hint="leave out 'channel'")
    # a limit's own unit is that of the channel only where the metric's is
    whole = spec.unit is None or not spec.by_channel
    given = form if whole else ScoreFile(metric=metric, channel=channel, unit=form.unit)
    on_channel = _unit_of(channel, given, mode, entry.place(("channel",))) if channel else ""
    unit = spec.unit_for(on_channel)
    if form.limit is None and form.min is None and form.max is None:
        judged = form.confidence is not None or form.repeats is not Repeats.ALL
        if form.warn is not None or judged:
            what = "a warning" if form.warn is not None else "a judgement"
            raise entry.error(f"{what} needs a limit", hint=examples(unit))
        return (metric, channel), None
    words = _words(form, entry)
    if words.relative:
        shares, text = _bounds(form.model_copy(update={"limit": words.bounds}), "", entry)
        value = baseline.value(trial, metric, channel, entry.place())
        bounds, text = (
            scaled_bounds(shares, value),
            f"{text} of baseline ({value:.4g} {unit}".rstrip() + ")",
        )
    else:
        same = form.limit is None or form.limit == words.bounds
        plain = form if same else form.model_copy(update={"limit": words.bounds})
        bounds, text = _bounds(plain, unit, entry)
    if bounds.high < spec.least:
        raise entry.error(
            f"no run can keep it: {metric} is never below {spec.least:g}",
            hint=examples(unit),
        )
    confident = words.confident or form.confidence is not None
    text += " with 95 % confidence" if confident else ""
    text += f", {form.repeats.value} of the repeats" if form.repeats is not Repeats.ALL else ""
    warn = None
    if form.warn is not None:
        warning = entry.at("warn")
        warn, _ = _bounds(_form(BoundsFile, warning), unit, warning)
        # one beside a baseline is met by whatever that is next
        if not words.relative and warn.low <= bounds.low and warn.high >= bounds.high:
            raise warning.error(
                f"nothing is ever warned: it is not within the limit ({text})",
                hint="give a warning tighter bounds than its limit, or leave it out",
            )
        warn = Bounds(max(warn.low, bounds.low), min(warn.high, bounds.high))
        if not warn.low <= warn.high:
            raise warning.error("no value is accepted without a warning")
    limit = AcceptanceLimit(metric, channel, bounds, text, unit, warn, confident, form.repeats)
    return (metric, channel), limit


def _words(form: LimitFile, entry: Located) -> LimitWords:
    try:
        return split_words(form.limit or "")
    except UnitError as error:
        raise InputError(error.what, where=entry.origin(), hint=error.hint) from error


def _scores(scores: Located, mode: ControlMode, own: Specs) -> list[tuple[str, str]]:
    value: Any = scores.value or []
    if not isinstance(value, list):
        raise scores.error("expected a list of metrics", hint="write [rise_time, overshoot]")
    pairs = []
    for index in range(len(value)):
        entry = scores.at(index)
        if isinstance(entry.value, dict):
            form = validate(ScoreFile, entry.value, "", places=entry.place, origins=entry.origin)
            spec_named(form.metric, own, entry.place(("metric",)))
            _unit_of(form.channel, form, mode, entry.place(("channel",)))
            pairs.append((form.metric, form.channel))
        elif isinstance(entry.value, str):
            spec = spec_named(entry.value, own, entry.place())
            pairs.append((spec.id, spec.channel_for(mode.channel)))
        else:
            raise entry.error("expected a metric", hint="write [rise_time, overshoot]")
    return pairs


def _form(model: type[BoundsFile], entry: Located, unit: str = "") -> Any:
    """Return an entry, be it text or keys, as `model`; `unit` is for examples in a message."""
    if isinstance(entry.value, dict):
        return validate(model, entry.value, "", places=entry.place, origins=entry.origin)
    if isinstance(entry.value, str):
        return model(limit=entry.value)
    raise entry.error(f"'{entry.value}' is not a limit", hint=examples(unit))


def _bounds(form: BoundsFile, unit: str, entry: Located) -> tuple[Bounds, str]:
    where = entry.origin()
    if form.limit is not None and (form.min is not None or form.max is not None):
        raise entry.error("both 'limit' and 'min' or 'max' are given", hint="keep one of them")
    try:
        if form.limit is not None:
            where = entry.origin(("limit",)) if isinstance(entry.value, dict) else where
            return parse_bounds(form.limit, unit), form.limit.strip()
        sides = [(">=", "min", form.min), ("<=", "max", form.max)]
        given = [(sign, key, str(value)) for sign, key, value in sides if value is not None]
        if not given:
            raise entry.error("the limit is empty", hint=examples(unit))
        for sign, key, value in given:
            where = entry.origin((key,))
            parse_bounds(f"{sign} {value}", unit)
        where = entry.origin()
        text = ", ".join(f"{sign} {value}" for sign, _, value in given)
        return parse_bounds(text, unit), text
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error


def _unit_of(channel: str, form: BoundsFile | ScoreFile, mode: ControlMode, where: Place) -> str:
    """Return a channel's SI unit: as known, as given, or that of the quantities about it."""
    channel = mode.channel if channel == "reference" else channel
    known = CHANNELS.get(channel)
    if known is not None:
        if form.unit and form.unit != known.unit:
            raise InputError(
                f"the unit of channel '{channel}' is {known.unit}, not '{form.unit}'", where=where
            )
        return known.unit
    if channel == mode.channel and mode.declared is not None:
        return mode.declared
    hint = suggest(channel, CHANNELS, likeness=_MISSPELT)
    try:
        if form.unit:
            return base_unit(form.unit)
        written = written_unit(form) if isinstance(form, BoundsFile) else ""
        if written and not likely(channel, CHANNELS, likeness=_MISSPELT):
            return base_unit(written)
    except UnitError as error:
        raise InputError(error.what, where=where, hint=error.hint) from error
    if channel == mode.channel:
        return ""
    raise InputError(
        f"unknown channel '{channel}'",
        where=where,
        hint=f"{hint}; for a channel of your own, give its 'unit'",
    )


def written_unit(form: BoundsFile) -> str:
    """Return the unit that a limit's quantities are written in, "" where they name none."""
    texts = [str(text) for text in (form.limit, form.min, form.max) if text is not None]
    found = [match[1].strip() for text in texts for match in _WRITTEN.finditer(text)]
    return next((unit for unit in found if unit != "%"), "")
