"""A suite file becomes a `Suite`: defaults merged, matrices expanded, everything in SI."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from eha_bench.core.errors import InputError
from eha_bench.core.excerpt import fitted
from eha_bench.core.near_miss import suggest
from eha_bench.core.signal import Signal
from eha_bench.core.trial import Setup, Trial
from eha_bench.core.yaml_file import StrictModel, read_text, validate
from eha_bench.core.yaml_file import parse as parse_yaml
from eha_bench.suites.acceptance.baseline import Baseline
from eha_bench.suites.acceptance.limits import judgement, safety_limits
from eha_bench.suites.acceptance.margins import margins
from eha_bench.suites.identifiers import check_identifier
from eha_bench.suites.located import Located
from eha_bench.suites.matrix import expand
from eha_bench.suites.signals.signal_model import SignalContext
from eha_bench.suites.suite import Suite
from eha_bench.suites.suite_file import RunKeys, SuiteFile, TrialFile
from eha_bench.suites.trial_source import signal_from, source_of

MOST_TICKS = 100_000_000
"""A run of a day at 1 kHz; more is a slip of the pen, and would not fit into memory."""

_MERGED = ("setup", "accept", "safety", "matters")
_APART = ("id", "signal", "accept", "scores", "safety", "matters")

M = TypeVar("M", bound=StrictModel)


def load_suite(path: str | Path) -> Suite:
    """Read a suite file.

    Raises:
        InputError: with file, line and key: the file is missing or not YAML, a key is unknown or
            missing, a value has the wrong unit, a name is not fit for a file, two trials are
            called the same.
    """
    path = Path(path)
    text = read_text(path)
    content = Located.of(parse_yaml(text, str(path)), str(path))
    form = validate(SuiteFile, content.value, str(path), places=content.place)
    defaults = content.at("defaults").mapping("keys and values")
    _check_keys(defaults, [key for key in TrialFile.model_fields if key not in ("id", "matrix")])
    place = content.place(("baseline",))
    baseline = Baseline(path.parent / form.baseline if form.baseline else None, place)
    trials: dict[str, Trial] = {}
    for index in range(len(form.trials)):
        written = content.at("trials", index)
        for trial, located in _trials(written, index, defaults, path, baseline):
            _check_unique(trial.id, trials, located)
            trials[trial.id] = trial
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
    written: Located, index: int, defaults: Located, path: Path, baseline: Baseline
) -> list[tuple[Trial, Located]]:
    """Return the trials that one entry of the list stands for."""
    pattern = written.value.get("id")
    if isinstance(pattern, str):
        written = written.named(f"trials.{index}", f"trials.{pattern}")
    _check_keys(written, list(TrialFile.model_fields))
    if pattern is None:
        raise InputError("key 'id' is missing", where=written.place(("id",)), hint="name the trial")
    found = []
    for name, trial in expand(written.over(defaults, deep=_MERGED)):
        checked = check_identifier(name, "the trial's id", trial.place(("id",)))
        found.append((_trial(checked, trial, path, baseline), trial))
    return found


def _trial(name: str, content: Located, path: Path, baseline: Baseline) -> Trial:
    run = _validated(RunKeys, content.without(*_APART), path)
    if "signal" not in content.value:
        raise InputError("key 'signal' is missing", where=content.place(("signal",)))
    context = SignalContext(run.mode.value, run.mode.unit, path.parent)
    wave = content.at("signal")
    signal = signal_from(wave.value, str(path), context, wave.place)
    duration = run.duration if run.duration is not None else signal.duration
    if not math.isfinite(duration):
        raise InputError(
            "key 'duration' is missing",
            where=content.place(("duration",)),
            hint=f"a {signal.kind} has no end of its own",
        )
    judged = judgement(content.at("accept"), content.at("scores"), run.mode, name, baseline)
    trial = Trial(
        id=name,
        signal=fitted(signal, duration),
        mode=run.mode,
        setup=Setup(run.setup.piston, run.setup.bypass, run.setup.initial.values()),
        duration=duration,
        settle=run.settle,
        sample_rate=run.sample_rate,
        repeats=run.repeats,
        seed=run.seed,
        scores=judged.scores,
        limits=judged.limits,
        safety=safety_limits(content.at("safety"), run.mode),
        margins=margins(content.at("matters"), run.mode),
        description=run.description.strip(),
    )
    _check_sampling(trial, content)
    return replace(trial, source=source_of(trial, signal))


def _validated(model: type[M], content: Located, path: Path) -> M:
    return validate(model, content.value, str(path), places=content.place)


def _check_keys(content: Located, known: list[str]) -> None:
    if not isinstance(content.value, dict):
        raise content.error("expected keys and values")
    for key in content.value:
        if key not in known:
            raise InputError(
                f"unknown key '{key}'", where=content.place((key,)), hint=suggest(key, known)
            )


def _check_unique(name: str, trials: dict[str, Trial], content: Located) -> None:
    # some file systems do not tell capital letters from small ones
    for other in trials:
        if other.lower() == name.lower():
            raise InputError(
                f"two trials are called '{name}'"
                if other == name
                else f"trials '{other}' and '{name}' differ in capital letters only",
                where=content.place(("id",)),
                hint="give each an id of its own",
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
            f"the trial is shorter than one tick of {1 / trial.sample_rate:g} s", where=where
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
