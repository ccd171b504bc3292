"""All scores of a recording of a trial: the same code wherever the recording came from."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable
from dataclasses import replace
from functools import cache

from eha_bench.core import plugins
from eha_bench.core.channels import unit_of
from eha_bench.core.error_text import error_text
from eha_bench.core.errors import (
    EhaBenchError,
    InputError,
    MissingChannelError,
    Place,
    PluginError,
    UnitError,
)
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.metric import METRICS, MetricSpec
from eha_bench.core.plugin_class import check_attributes, check_class
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import Trial
from eha_bench.core.units import factor_and_offset
from eha_bench.metrics.acceptance import judge
from eha_bench.metrics.formula_metric import FormulaMetric
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.recorded import bind
from eha_bench.metrics.returned import as_measure

_LOG = logging.getLogger("eha_bench")
_BEYOND = "the value is beyond the largest number"


@cache
def metric(name: str) -> Metric:
    """Return the metric of an id; the built-in ones are registered as plug-ins are.

    Raises:
        PluginError: no such metric, it cannot be loaded, or it is not a Metric.
    """
    found = plugins.load("metrics", name)
    if isinstance(found, type) and issubclass(found, Metric):
        check_class(found, Metric, f"metric '{name}'")
        found = _made(found, name)
    if isinstance(found, Metric):
        check_class(type(found), Metric, f"metric '{name}'")
        check_attributes(found, Metric, f"metric '{name}'")
    spec = getattr(found, "spec", None)
    if not (isinstance(found, Metric) and isinstance(spec, MetricSpec) and spec.id == name):
        raise PluginError(
            f"entry point '{name}' of eha_bench.metrics does not name a metric of this id",
            hint="it must name a subclass of eha_bench.metrics.Metric with this id in its spec",
        )
    return found


def _made(kind: type[Metric], name: str) -> Metric:
    try:
        return kind()
    except Exception as error:
        raise PluginError(
            f"metric '{name}' cannot be made ({error_text(error)})",
            hint="it is made without arguments",
        ) from error


@cache
def all_metrics() -> dict[str, Metric]:
    """Return every installed metric by id: in the order of the public table, then by name.

    One that cannot be loaded is left out with a note: only who asks for it is stopped by it.
    """
    installed = plugins.names("metrics")
    known = [name for name in METRICS if name in installed]
    found = {}
    for name in (*known, *(name for name in installed if name not in METRICS)):
        try:
            found[name] = metric(name)
        except PluginError as error:
            _LOG.warning("note: left out: %s", error)
    return found


def load_metrics(trials: Iterable[Trial]) -> None:
    """Load every metric that will score recordings of trials, before anything moves for them.

    Raises:
        PluginError: one that a trial asks for cannot be loaded, with the suite's file.
    """
    all_metrics()
    for trial in trials:
        asked = [limit.metric for limit in trial.limits] + [name for name, _ in trial.scores]
        inputs = [name for own in trial.own_metrics for name in own.formula.metrics]
        for name in dict.fromkeys((*asked, *inputs)):
            try:
                metric_in(trial, name)
            except PluginError as error:
                what = f"trial '{trial.id}' cannot be scored: {error.what}"
                where = Place(file=trial.mode.where.file)
                raise PluginError(what, where=where, hint=error.hint) from error


def score(recording: Recording, trial: Trial) -> tuple[Score, ...]:
    """Return the scores that the trial's limits and `scores` ask for, then those by default.

    What cannot be computed is a score without a value, with its reason; a limit on it is then
    'not_scored', which a gate rejects.

    Args:
        recording: as `eha_bench.read` gives it.
        trial: one of `eha_bench.suites.load_suite("suite.yaml").trials`.

    Raises:
        PluginError: a metric that is asked for does not exist or cannot be loaded.
        InputError: what is given is not a recording or no trial.
    """
    _check(recording, trial)
    recording, trial = bind(recording, trial)
    wanted = _limits_of(trial)
    have = {(name, channel) for name, channel, _ in wanted}
    defaults: list[tuple[str, str]] = []
    broken: list[Score] = []
    for name, candidate in all_metrics().items():
        channel = candidate.spec.channel_for(trial.channel)
        try:
            if candidate.by_default and candidate.applies(trial):
                defaults.append((name, channel))
        except Exception as error:  # as in `measure_safely`
            unit, why = _unit(candidate, recording, trial, channel), _reason(candidate, error)
            measure = Measure.none(why)
            broken.append(Score(name, channel, measure, unit, ScoreStatus.NOT_SCORED))
    asked = [(name, _channel(name, channel, trial)) for name, channel in trial.scores]
    for pair in (*asked, *defaults):
        if pair not in have:
            have.add(pair)
            wanted.append((*pair, None))
    found = (_score(recording, trial, *item) for item in wanted)
    return (*found, *(item for item in broken if (item.metric, item.channel) not in have))


def score_limits(recording: Recording, trial: Trial) -> tuple[Score, ...]:
    """Return the scores that the trial's limits ask for and no others, as `score` does.

    For searches, that judge a trial a thousand times.
    """
    _check(recording, trial)
    recording, trial = bind(recording, trial)
    return tuple(_score(recording, trial, *item) for item in _limits_of(trial))


def _limits_of(trial: Trial) -> list[tuple[str, str, AcceptanceLimit | None]]:
    """Return metric, channel and limit of each of a trial's limits."""
    return [
        (limit.metric, _channel(limit.metric, limit.channel, trial), limit)
        for limit in trial.limits
    ]


def _check(recording: object, trial: object) -> None:
    if not isinstance(recording, Recording):
        raise InputError(
            f"{recording!r} is not a recording", hint="read it: eha_bench.read('run.mcap')"
        )
    if not isinstance(trial, Trial):
        raise InputError(
            f"{trial!r} is not a trial",
            hint="take one of eha_bench.suites.load_suite('suite.yaml').trials, or let "
            "`eha-bench score --trial` find it by its id",
        )


def check_reference(recording: Recording, trial: Trial, where: Place) -> None:
    """Refuse a foreign log whose `reference` is mapped as no quantity that the trial controls.

    Args:
        recording: of the trial. trial: it. where: the recording, for the message.

    Raises:
        UnitError: its unit has another dimension.
    """
    recorded, asked = recording.units.get("reference", ""), trial.mode.unit
    if recorded and asked and recorded != asked:
        raise UnitError(
            f"its reference is in {recorded}, and trial '{trial.id}' controls {trial.channel}, in "
            f"{asked}",
            where=where,
            hint="map 'reference' in channels.yaml in a unit of that dimension",
        )


def _channel(name: str, channel: str, trial: Trial) -> str:
    return channel or metric_in(trial, name).spec.channel_for(trial.channel)


def metric_in(trial: Trial, name: str) -> Metric:
    """Return the metric of an id: one of the suite's own that the trial carries, or installed.

    Raises:
        PluginError: no such metric, it cannot be loaded, or it is not a Metric.
    """
    for own in trial.own_metrics:
        if own.id == name:
            return FormulaMetric(own, _input)
    return metric(name)


def _input(name: str, recording: Recording, trial: Trial, channel: str) -> tuple[Measure, str]:
    """Return what a metric within a formula finds, and the channel that it is scored on."""
    chosen = _channel(name, channel, trial)
    return measure_safely(metric_in(trial, name), recording, trial, chosen), chosen


def _score(
    recording: Recording, trial: Trial, name: str, channel: str, limit: AcceptanceLimit | None
) -> Score:
    found = metric_in(trial, name)
    measure = measure_safely(found, recording, trial, channel)
    unit = _unit(found, recording, trial, channel)
    if limit is not None and measure.value == measure.value:
        why = _of_another_unit(unit, limit)
        measure = Measure.none(why) if why else measure
    return Score(
        metric=name,
        channel=channel,
        measure=measure,
        unit=unit,
        status=judge(measure, limit),
        limit=limit.text if limit else "",
        limit_in_si=limit.in_si if limit else "",
        matters=trial.margins[name].text if name in trial.margins else "",
    )


def _of_another_unit(unit: str, limit: AcceptanceLimit) -> str:
    """Return why a limit cannot be applied to values of a unit, "" where it can.

    A limit without a unit is in that of the recording. What a target records of a channel that
    nobody else knows is checked against the suite nowhere before.
    """
    if limit.unit in ("", unit):
        return ""
    try:
        alike = factor_and_offset(unit, limit.unit) == (1.0, 0.0)
    except UnitError:
        alike = False
    recorded = f"in {unit}" if unit else "without a unit"
    return "" if alike else f"recorded {recorded}, and the limit is in {limit.unit}"


def _reason(found: Metric, error: Exception) -> str:
    """Return why a metric that raised an error has no value."""
    match error:
        case NotScored():
            return error.reason
        case MissingChannelError():
            return f"no {error.channel}"
        case EhaBenchError():
            return str(error)
        case OverflowError():  # of Python's own numbers; NumPy's become infinite
            return _BEYOND
        case _:
            return f"metric '{found.spec.id}' failed ({error_text(error)})"


def measure_safely(found: Metric, recording: Recording, trial: Trial, channel: str) -> Measure:
    """Return what a metric finds; whatever goes wrong becomes a reason."""
    if isinstance(trial.signal, FromRecording):
        return Measure.none("no usable reference in the recording, and the trial describes none")
    try:
        with warnings.catch_warnings():
            # numbers near the ends of the floating-point range overflow inside; what is not finite
            # in the end is not scored, so the warning would say it twice
            warnings.simplefilter("ignore", RuntimeWarning)
            measure = as_measure(found.measure(recording, trial, channel), found)
    except Exception as error:  # a plug-in's fault must not cost the run's other scores
        return Measure.none(_reason(found, error))
    if measure.value == measure.value and abs(measure.value) == float("inf"):
        return Measure.none(_BEYOND)
    if measure.value != measure.value and not measure.reason:
        return replace(measure, reason="the metric gave no value and no reason")
    return measure


def _unit(found: Metric, recording: Recording, trial: Trial, channel: str) -> str:
    if not found.spec.by_channel:
        return found.spec.unit_for("")
    if channel == "reference":
        return found.spec.unit_for(recording.unit(channel) or trial.mode.unit)
    on_channel = recording.unit(channel) if channel in recording else unit_of(channel)
    return found.spec.unit_for(on_channel)
