"""A suite file becomes a `Suite`: defaults merged, matrices expanded, everything in SI."""

from __future__ import annotations

import gc
import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from eha_bench.core.channels import CHANNELS, unit_of
from eha_bench.core.errors import InputError, Mistakes, UnitError
from eha_bench.core.excerpt import signal_of_length
from eha_bench.core.limit import SafetyLimit
from eha_bench.core.located import Located
from eha_bench.core.margin import EquivalenceMargin
from eha_bench.core.near_miss import suggest
from eha_bench.core.signal import Signal
from eha_bench.core.trial import ControlMode, Setup, Trial, mode_named
from eha_bench.core.units import base_unit, parse, unit_in
from eha_bench.core.yaml_file import file_of, read_text, validate
from eha_bench.core.yaml_file import parse as parse_yaml
from eha_bench.suites.acceptance.baseline import BaselineResult
from eha_bench.suites.acceptance.limits import Judgement, judgement, safety_limits
from eha_bench.suites.acceptance.margins import margins
from eha_bench.suites.identifiers import check_identifier
from eha_bench.suites.matrix import expand
from eha_bench.suites.own_metrics import OwnMetrics, needed_metrics, own_metrics
from eha_bench.suites.reach import asked_levels, check_anywhere
from eha_bench.suites.signals.signal_model import SignalContext, SignalModel
from eha_bench.suites.suite import Suite
from eha_bench.suites.suite_file import RunKeys, SuiteFile, TrialFile
from eha_bench.suites.trial_source import signal_from, source_of

MOST_TICKS = 100_000_000
"""A run of a day at 1 kHz; more is a slip of the pen, and would not fit into memory."""

_MERGED = ("setup", "accept", "safety", "matters")
_APART = ("id", "signal", "accept", "scores", "safety", "matters")


def load_suite(suite: str | Path | Mapping[str, Any]) -> Suite:
    """Read a suite.

    Args:
        suite: a file, the name of a shipped one (`paper`), or a dict of what a file would hold.

    Raises:
        InputError: with file, line and key: the file is missing or not YAML, a key is unknown or
            missing, a value has the wrong unit, a name is not fit for a file, two trials are
            called the same; further mistakes in `also`.
    """
    path = file_of(suite, "suite", "suites")
    return parse_suite(read_text(path), path)


def parse_suite(text: str, path: Path) -> Suite:
    """Return the suite that a text holds; files that it names are relative to `path`.

    Raises:
        InputError: as `load_suite`.
    """
    with _pause_collection():
        return _parse(text, path)


def _parse(text: str, path: Path) -> Suite:
    content = Located.of(parse_yaml(text, str(path)), str(path))
    # a user-defined metric is checked where it is read, mistake by mistake
    whole = content.without("metrics").value if isinstance(content.value, dict) else content.value
    form = validate(SuiteFile, whole, str(path), places=content.place, kind="suite")
    defaults = content.at("defaults").mapping("keys and values")
    mistakes = Mistakes()
    own = own_metrics(content.at("metrics"), mistakes)
    known = [key for key in TrialFile.model_fields if key not in ("id", "matrix")]
    # every trial asks it for its places
    defaults = _known_keys(defaults, known, mistakes).apart()
    place = content.place(("baseline",))
    baseline = BaselineResult(path.parent / form.baseline if form.baseline else None, place)
    trials: dict[str, Trial] = {}
    folded: dict[str, str] = {}
    for index, written in enumerate(content.at("trials").each()):
        with mistakes:
            for trial, located in _trials(written, index, defaults, path, baseline, own):
                _check_unique(trial.id, folded, located)
                trials[trial.id] = trial
    mistakes.tell()
    name = form.name
    if name is None:
        name = re.sub(r"[^A-Za-z0-9_.-]", "_", path.stem)
    return Suite(
        name=check_identifier(name, "the suite's name", content.place(("name",))),
        description=form.description.strip(),
        trials=tuple(trials.values()),
        path=path,
        text=text,
        sha256=hashlib.sha256(text.encode("utf-8")).hexdigest(),
        model=form.model or "",
        controller=form.controller or "",
        target=form.target or "",
    )


def _trials(
    written: Located,
    index: int,
    defaults: Located,
    path: Path,
    baseline: BaselineResult,
    own: OwnMetrics,
) -> list[tuple[Trial, Located]]:
    """Return the trials that one entry of the list stands for."""
    pattern = written.value.get("id")
    if isinstance(pattern, str):
        written = written.renamed(f"trials.{index}", f"trials.{pattern}")
    mistakes = Mistakes()
    written = _known_keys(written, list(TrialFile.model_fields), mistakes)
    if pattern is None:
        raise InputError("key 'id' is missing", where=written.place(("id",)), hint="name the trial")
    found = []
    for name, trial in expand(written.over(defaults, deep=_MERGED)):
        with mistakes:
            checked = check_identifier(name, "the trial's id", trial.place(("id",)))
            found.append((_trial(checked, trial, path, baseline, own), trial))
    mistakes.tell()
    return found


def _trial(
    name: str, content: Located, path: Path, baseline: BaselineResult, own: OwnMetrics
) -> Trial:
    specs = own.specs
    mistakes = Mistakes()
    run: RunKeys | None = None
    mode: ControlMode | None = None
    signal: SignalModel | None = None
    with mistakes:
        keys = {key: item for key, item in content.value.items() if key not in _APART}
        run = validate(RunKeys, keys, str(path), places=content.place, origins=content.origin)
    with mistakes:
        mode = _mode(content)
    if mode is None:
        mistakes.tell()  # what is asked for has no unit: nothing else can be read
        raise AssertionError
    context = SignalContext(mode.name, mode.unit if mode.known else None, path.parent)
    with mistakes:
        signal = _signal(content, context, path)
    if run is None or signal is None:
        # what can be checked of the rest without them
        with mistakes:
            accept, scores = own.readable(content.at("accept")), content.at("scores")
            judgement(accept, scores, mode, name, baseline, None, specs)
        with mistakes:
            safety_limits(content.at("safety"), mode)
        with mistakes:
            margins(own.readable(content.at("matters")), mode, specs)
        mistakes.tell()
        raise AssertionError
    duration = run.duration if run.duration is not None else signal.duration
    if not math.isfinite(duration):
        raise InputError(
            "key 'duration' is missing",
            where=content.place(("duration",)),
            hint=f"a {signal.kind} never ends: add 'duration: 1 s'",
        )
    if context.named:
        mode = replace(mode, declared=context.named[0])
    reference = signal_of_length(signal, duration)
    judged = Judgement((), ())
    safety: tuple[SafetyLimit, ...] = ()
    matters: dict[str, EquivalenceMargin] = {}
    setup = Setup(run.setup.piston, run.setup.bypass)
    with mistakes:
        accept, scores = own.readable(content.at("accept")), content.at("scores")
        judged = judgement(accept, scores, mode, name, baseline, reference, specs)
    with mistakes:
        safety = safety_limits(content.at("safety"), mode)
    with mistakes:
        matters = margins(own.readable(content.at("matters")), mode, specs)
    with mistakes:
        start = content.at("setup", "initial")
        initial, units = _initial(start, run.setup.initial)
        places = {name: start.place((name,)) for name in initial}
        setup = replace(setup, initial=initial, units=units, places=places)
    trial = Trial(
        id=name,
        signal=reference,
        mode=mode,
        setup=setup,
        duration=duration,
        settle=run.settle,
        sample_rate=run.sample_rate,
        repeats=run.repeats,
        seed=run.seed,
        scores=judged.scores,
        limits=judged.limits,
        safety=safety,
        margins=matters,
        description=run.description.strip(),
        own_metrics=needed_metrics(own.by_id, _metrics_of(judged)),
        levels=asked_levels(mode.channel, setup.initial, signal, content),
    )
    with mistakes:
        _check_sampling(trial, content)
    with mistakes:
        check_anywhere(trial)
    mistakes.tell()
    return replace(trial, source=source_of(trial, signal))


def _metrics_of(judged: Judgement) -> set[str]:
    """Return the ids of the metrics that a trial asks for."""
    return {limit.metric for limit in judged.limits} | {metric for metric, _ in judged.scores}


def _mode(content: Located) -> ControlMode | None:
    """Return the control mode of a trial, in which something else may be wrong."""
    written = content.value.get("mode")
    return mode_named(written, where=content.place(("mode",))) if isinstance(written, str) else None


def _signal(content: Located, context: SignalContext, path: Path) -> SignalModel:
    if "signal" not in content.value:
        raise InputError(
            "key 'signal' is missing",
            where=content.place(("signal",)),
            hint="add 'signal: {kind: step, final: ...}'",
        )
    wave = content.at("signal")
    return signal_from(wave.value, str(path), context, wave.place, wave.origin)


def _initial(
    content: Located, written: Mapping[str, float | str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return start values by channel, SI, and the units of channels that eha_bench does not know.

    Raises:
        InputError: a wrong unit, or two values for one position.
    """
    if {"joint_angle", "piston_position"} <= written.keys():
        raise content.error("joint_angle and piston_position are both given: keep one of them")
    values, units = {}, {}
    for name, value in written.items():
        try:
            unit = unit_of(name) if name in CHANNELS else base_unit(unit_in(value))
            values[name] = parse(value, unit)
        except UnitError as error:
            where = content.place((name,))
            raise InputError(error.what, where=where, hint=error.hint) from error
        if name not in CHANNELS and unit_in(value):
            units[name] = unit
    return values, units


def _known_keys(content: Located, known: list[str], mistakes: Mistakes) -> Located:
    """Return the content without keys that the format does not have; each is a mistake."""
    if not isinstance(content.value, dict):
        raise content.error("expected keys and values", hint="write it as 'key: value' lines")
    unknown = [key for key in content.value if key not in known]
    for key in unknown:
        with mistakes:
            raise InputError(
                f"unknown key '{key}'", where=content.place((key,)), hint=suggest(key, known)
            )
    return content.without(*unknown)


def _check_unique(name: str, folded: dict[str, str], content: Located) -> None:
    """Note a trial's id; `folded` holds those before it by their small letters."""
    # some file systems do not tell capital letters from small ones
    other = folded.get(name.lower())
    folded.setdefault(name.lower(), name)
    if other is not None:
        raise InputError(
            f"two trials are called '{name}'"
            if other == name
            else f"trials '{other}' and '{name}' differ in capital letters only",
            where=content.place(("id",)),
            hint="give each its own id",
        )


def _check_sampling(trial: Trial, content: Located) -> None:
    """Raise an InputError where the sample rate does not suit the duration or the signal."""
    where = content.place(("sample_rate",))
    ticks = (trial.settle + trial.duration) * trial.sample_rate
    if ticks > MOST_TICKS:
        raise InputError(
            f"{ticks:.3g} samples are more than {MOST_TICKS:.0e}",
            where=where,
            hint="shorten the trial, or lower its sample_rate",
        )
    if round(trial.duration * trial.sample_rate) < 1:
        raise InputError(
            f"the trial is shorter than one tick of {1 / trial.sample_rate:g} s",
            where=where,
            hint="give it a longer 'duration', or a higher 'sample_rate'",
        )
    highest = _highest_frequency(trial.signal)
    if highest >= trial.sample_rate / 2:
        raise InputError(
            f"the signal reaches {highest:g} Hz, sampled at {trial.sample_rate:g} Hz",
            where=where,
            hint="the sample rate has to be more than twice the highest frequency",
        )


def _highest_frequency(signal: Signal) -> float:
    tones = [tone.frequency for tone in signal.tones]
    lines = [lines.harmonics[-1] / lines.period for lines in signal.lines if lines.harmonics]
    sweeps = [max(sweep.f_start, sweep.f_stop) for sweep in signal.sweeps]
    return max([0.0, *tones, *lines, *sweeps])


@contextmanager
def _pause_collection() -> Iterator[None]:
    """Pause the collection of cycles: many objects are made, and little of them goes."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()
