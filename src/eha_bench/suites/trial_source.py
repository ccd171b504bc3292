"""A trial as JSON text and back, so that a recording alone can be re-scored.

Everything in it is SI and complete: limits in numbers, a trajectory with its samples. Reading it
opens no file and loads no code but the installed signals.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Any, Literal

from pydantic import Field

from eha_bench.core import plugins
from eha_bench.core.errors import InputError, Place
from eha_bench.core.excerpt import signal_of_length
from eha_bench.core.limit import AcceptanceLimit, Bounds, Repeats, SafetyLimit
from eha_bench.core.margin import EquivalenceMargin
from eha_bench.core.near_miss import suggest
from eha_bench.core.own_metric import OwnMetric
from eha_bench.core.plugin_class import check_class
from eha_bench.core.trial import Bypass, ControlMode, Piston, Setup, Trial
from eha_bench.core.yaml_file import Places, StrictModel, validate
from eha_bench.suites.identifiers import check_identifier
from eha_bench.suites.own_metrics import NAME
from eha_bench.suites.signals.signal_model import SignalContext, SignalModel
from eha_bench.suites.suite_file import CHANNEL

VERSION = 1
_JUDGING = ("limits", "scores", "metrics", "matters", "description", "repeats", "seed", "safety",
            "version")  # fmt: skip


class _Bounds(StrictModel):
    low: float | None = Field(allow_inf_nan=False)
    high: float | None = Field(allow_inf_nan=False)

    def bounds(self) -> Bounds:
        low = -math.inf if self.low is None else self.low
        return Bounds(low, math.inf if self.high is None else self.high)


class _Limit(StrictModel):
    metric: str
    channel: str
    bounds: _Bounds
    text: str
    unit: str
    warn: _Bounds | None
    confident: bool = False
    repeats: Repeats = Repeats.ALL


class _Safety(StrictModel):
    channel: str
    bounds: _Bounds
    text: str
    unit: str = ""


class _Margin(StrictModel):
    absolute: float = Field(ge=0, allow_inf_nan=False)
    share: float = Field(ge=0, allow_inf_nan=False)
    text: str


class _OwnMetric(StrictModel):
    id: str = Field(pattern=NAME)
    expression: str
    unit: str = ""
    description: str = ""
    span: _Bounds

    def metric(self, name: str) -> OwnMetric:
        from eha_bench.core.formula import Formula

        span = self.span.bounds()
        try:
            formula = Formula.parse(self.expression)
        except ValueError as error:
            where = Place(file=name, key=f"metrics.{self.id}")
            raise InputError(str(error), where=where) from error
        return OwnMetric(self.id, formula, self.unit, self.description, span.low, span.high)


class _Setup(StrictModel):
    piston: Piston
    bypass: Bypass
    initial: dict[str, float]
    units: dict[str, str] = Field(default={})


class TrialSource(StrictModel):
    """The JSON form of a trial."""

    version: Literal[1] = 1
    id: str
    description: str = ""
    mode: str = Field(pattern=CHANNEL)
    unit: str | None = None
    signal: dict[str, Any]
    setup: _Setup
    duration: float = Field(gt=0, allow_inf_nan=False)
    settle: float = Field(ge=0, allow_inf_nan=False)
    sample_rate: float = Field(gt=0, allow_inf_nan=False)
    repeats: int = Field(ge=1)
    seed: int = Field(ge=0)
    scores: tuple[tuple[str, str], ...]
    limits: tuple[_Limit, ...]
    safety: tuple[_Safety, ...]
    matters: dict[str, _Margin] = Field(default={})
    metrics: tuple[_OwnMetric, ...] = ()


def _written_bounds(bounds: Bounds) -> dict[str, float | None]:
    return {
        side: value if math.isfinite(value) else None
        for side, value in (("low", bounds.low), ("high", bounds.high))
    }


def _written_metric(metric: OwnMetric) -> dict[str, Any]:
    return {
        "id": metric.id,
        "expression": metric.formula.text,
        "unit": metric.unit,
        "description": metric.description,
        "span": _written_bounds(Bounds(metric.start, metric.stop)),
    }


def source_of(trial: Trial, signal: SignalModel) -> str:
    """Return `trial` as JSON; `signal` is its signal as the suite wrote it."""
    content: dict[str, Any] = {
        "version": VERSION,
        "id": trial.id,
        "description": trial.description,
        "mode": trial.mode.name,
    }
    if trial.mode.declared is not None:  # only for channels that eha_bench does not know
        content["unit"] = trial.mode.declared
    content |= {
        "signal": signal.model_dump(mode="json", by_alias=True),
        "setup": {
            "piston": trial.setup.piston.value,
            "bypass": trial.setup.bypass.value,
            "initial": dict(trial.setup.initial),
            **({"units": dict(trial.setup.units)} if trial.setup.units else {}),
        },
        "duration": trial.duration,
        "settle": trial.settle,
        "sample_rate": trial.sample_rate,
        "repeats": trial.repeats,
        "seed": trial.seed,
        "scores": trial.scores,
        "limits": [
            {
                "metric": limit.metric,
                "channel": limit.channel,
                "bounds": _written_bounds(limit.bounds),
                "text": limit.text,
                "unit": limit.unit,
                "warn": None if limit.warn is None else _written_bounds(limit.warn),
                "confident": limit.confident,
                "repeats": limit.repeats.value,
            }
            for limit in trial.limits
        ],
        "safety": [
            {
                "channel": limit.channel,
                "bounds": _written_bounds(limit.bounds),
                "text": limit.text,
                **({"unit": limit.unit} if limit.unit else {}),
            }
            for limit in trial.safety
        ],
        "matters": {
            metric: {"absolute": margin.absolute, "share": margin.share, "text": margin.text}
            for metric, margin in trial.margins.items()
        },
    }
    if trial.own_metrics:
        content["metrics"] = [_written_metric(metric) for metric in trial.own_metrics]
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


def definition_of(source: str) -> str:
    """Return a digest of what a trial's JSON text runs; "" for a trial that has none.

    How it is judged, how often it is run and from which seed have no part in it.
    """
    if not source:
        return ""
    ran = {key: value for key, value in json.loads(source).items() if key not in _JUDGING}
    return hashlib.sha256(json.dumps(ran, sort_keys=True).encode()).hexdigest()


def trial_from_source(text: str, name: str = "the recording's trial") -> Trial:
    """Return the trial that `Trial.source` holds; `name` stands in messages.

    Raises:
        InputError: not JSON, not a trial, or of another version.
        PluginError: its signal is not installed.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not a trial ({error})", where=Place(file=name)) from error
    if isinstance(content, dict) and content.get("version") != VERSION:
        raise InputError(
            f"a trial of version {content.get('version')}, not {VERSION}",
            where=Place(file=name, key="version"),
            hint="score it against the suite it was made with (--suite)",
        )
    source = validate(TrialSource, content, name)
    signal = signal_from(source.signal, name, SignalContext())
    return Trial(
        id=check_identifier(source.id, "the trial's id", Place(file=name, key="id")),
        signal=signal_of_length(signal, source.duration),
        mode=ControlMode(source.mode, source.unit, Place(file=name, key="mode")),
        setup=Setup(
            source.setup.piston,
            source.setup.bypass,
            dict(source.setup.initial),
            dict(source.setup.units),
        ),
        duration=source.duration,
        settle=source.settle,
        sample_rate=source.sample_rate,
        repeats=source.repeats,
        seed=source.seed,
        scores=source.scores,
        limits=tuple(
            AcceptanceLimit(
                limit.metric,
                limit.channel,
                limit.bounds.bounds(),
                limit.text,
                limit.unit,
                None if limit.warn is None else limit.warn.bounds(),
                limit.confident,
                limit.repeats,
            )
            for limit in source.limits
        ),
        safety=tuple(
            SafetyLimit(limit.channel, limit.bounds.bounds(), limit.text, limit.unit)
            for limit in source.safety
        ),
        margins={
            metric: EquivalenceMargin(margin.absolute, margin.share, margin.text)
            for metric, margin in source.matters.items()
        },
        source=text,
        description=source.description,
        own_metrics=tuple(metric.metric(name) for metric in source.metrics),
    )


def signal_from(
    content: Any,
    file: str,
    context: SignalContext,
    places: Places | None = None,
    origins: Places | None = None,
) -> SignalModel:
    """Return the signal that a mapping with a `kind` describes.

    Args:
        content: the mapping. file: it stands in, for messages. context: of the trial.
        places, origins: say where a key, and where its value stands, as `validate` takes them.

    Raises:
        InputError: no `kind`, or quantities that are missing, unknown or of the wrong unit.
        PluginError: no signal of that kind is installed.
    """

    def place(*keys: str) -> Place:
        return places(keys) if places else Place(file=file, key=".".join(("signal", *keys)))

    kinds = plugins.names("signals")
    if not isinstance(content, dict):
        raise InputError(
            "a signal is written as keys and values",
            where=place(),
            hint="write {kind: step, final: 15 MPa}",
        )
    kind = content.get("kind")
    if not isinstance(kind, str):
        raise InputError(
            "key 'kind' is missing" if kind is None else f"'{kind}' is not a kind of signal",
            where=place("kind"),
            hint=f"known: {', '.join(kinds)}",
        )
    if kind not in kinds:
        raise InputError(f"unknown signal '{kind}'", where=place("kind"), hint=suggest(kind, kinds))
    model = plugins.load("signals", kind, where=place("kind"))
    if not (isinstance(model, type) and issubclass(model, SignalModel)):
        raise InputError(
            f"signal '{kind}' is not a SignalModel",
            where=place("kind"),
            hint="the entry point has to name a class derived from it",
        )
    check_class(model, SignalModel, f"signal '{kind}'", where=place("kind"))
    prefix = () if places else ("signal",)
    return validate(model, content, file, prefix, context=context, places=places, origins=origins)
