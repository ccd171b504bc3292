"""What a diagnosis found, and its file diagnosis.json (contract, section 7)."""

from __future__ import annotations

import json
import math
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.finite import finite_or_none
from eha_bench.core.lazy import later
from eha_bench.diagnosis.data.slopes import in_words
from eha_bench.diagnosis.fit.convergence import Convergence
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.diagnosis.outcome.rival import RIVALS_FOLDER, Rival
from eha_bench.diagnosis.replay.error_by_value import ErrorByValue
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.plants.model import Model
from eha_bench.posterior.covered import Covered

SCHEMA_VERSION = 1
DIAGNOSIS_FILE = "diagnosis.json"
REVISED_FILE = "revised.yaml"
RECALIBRATED_FILE = "recalibrated.yaml"
WRITTEN = (DIAGNOSIS_FILE, REVISED_FILE, RECALIBRATED_FILE, RIVALS_FOLDER)
"""What is written of a diagnosis, by its name in the folder."""
MAY_AS_WELL = "what is missing may as well act"
"""How a note begins that names other balances in which something unknown may act."""

_html = later("eha_bench.report.notebook", "diagnosis_html")


class Verdict(StrEnum):
    """What is missing in the declared model."""

    EFFECT = "effect"
    NONE = "none"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class FoundEffect:
    """An effect that was added.

    Attributes:
        id: public name. equation: balance it acts in. parameters: with 95 % intervals, SI.
        at: node, element or channel where it acts; "all" for all of a kind.
        settings: its words (which chamber, which sensor).
        share: part of the excess that it explains on runs left out in turn, when it was added; at
            most 1, below 0 where it does harm there.
        p_value: that it gains nothing there.
    """

    id: str
    equation: str
    parameters: Mapping[str, Estimate]
    settings: Mapping[str, str] = field(default_factory=dict)
    share: float = math.nan
    p_value: float = math.nan
    at: str = ""

    @property
    def without_intervals(self) -> FoundEffect:
        """The effect with its numbers alone."""
        alone = {name: item.without_interval for name, item in self.parameters.items()}
        return replace(self, parameters=alone)


@dataclass(frozen=True)
class Unknown:
    """Something missing that no known effect explains.

    Attributes:
        equation: balance it acts in; None where it was not located, `description` says why.
        variables: what it depends on.
        description: one sentence. share: part of the excess that the learned curve explains.
        period: of the variable where it is periodic, else 0. when: (start, stop) times in s.
        at: node, element or sensor where the learned curve acts; "" where there is none.
        where: values of a channel at which the model errs most, as a clause; "" where about alike.
        sensor: what the sensor reads in which it acts, as a clause; "" where that is not known.
        derived: variable that is no channel -> channel of the position whose slope it is.
        shape: what the learned curve looks like, as a clause; "" where that is none of a few words.
    """

    equation: str | None
    variables: tuple[str, ...]
    description: str = ""
    share: float = math.nan
    period: float = 0.0
    when: tuple[tuple[float, float], ...] = ()
    at: str = ""
    where: str = ""
    sensor: str = ""
    derived: Mapping[str, str] = field(default_factory=dict)
    shape: str = ""

    @property
    def in_words(self) -> tuple[str, ...]:
        """What it depends on, and of which channel that is the derivative."""
        return tuple(in_words(name, self.derived.get(name, "")) for name in self.variables)


ADDED: Final = "added"
"""`reason` of a candidate that was found to be a cause; other reasons are sentences."""


@dataclass(frozen=True)
class RankLine:
    """One candidate: its score (share of the excess explained), and what would remain."""

    id: str
    score: float
    p_value: float
    error_after: float
    reason: str = ""

    @property
    def added(self) -> bool:
        """Whether it is one of the effects that were found."""
        return self.reason == ADDED


@dataclass(frozen=True)
class FailedStage:
    """A stage that could not be ended.

    Attributes:
        stage: its name. error: what went wrong, one sentence. trace: for who mends it.
    """

    stage: str
    error: str
    trace: str = ""

    @property
    def note(self) -> str:
        """Say it in one sentence."""
        return f"the stage '{self.stage}' failed ({self.error}): earlier findings stand"

    def to_dict(self) -> dict[str, str]:
        """Return it as it stands in JSON."""
        return {"stage": self.stage, "error": self.error}


def failed_stage(stage: str, error: Exception) -> FailedStage:
    """Return a stage that an error has ended."""
    known = isinstance(error, EhaBenchError)
    text = str(error) if known else f"{type(error).__name__}: {error}"
    return FailedStage(stage, text, "".join(traceback.format_exception(error)))


@dataclass(frozen=True)
class Diagnosis:
    """The outcome of closing the loop once.

    Attributes:
        verdict: effect, none or unknown.
        effects: what was added, the strongest first.
        unknown: where something acts that nothing known explains; always there with that verdict.
        equivalent: sets of candidates that these data cannot distinguish.
        separate: effect's id -> the experiment that would tell it from its look-alikes.
        ranking: all candidates, the best first.
        train, holdout, unseen: channel -> errors; unseen runs are held out and of another kind.
        calibrated: parameters of the revised model with intervals.
        corrected: parameters of these that nobody calibrates, and of which the data ask for another
            value than the declared one -> that one, SI.
        misread: channels that their map mistakes, with how they are read instead.
        doubtful: numbers and scales, each with which all would be as believed that is not.
        per_run: run -> parameter of that run alone -> value with its interval; of held-out
            runs by their first part.
        undetermined: directions that the data do not determine, in words.
        convergence: how the fit of the revised model ended.
        notes: what the data gate and the search found, one sentence each.
        revised: the model with everything that was found.
        recalibrated: the model with its own parameters estimated again and nothing added.
        replays: every run replayed freely by the declared, the recalibrated and the revised model;
            what the errors are computed from. Not in diagnosis.json: `predict` gives them again.
        complete: False where it was interrupted, or a stage failed.
        failed: the stage that failed, if any: what was found before it stands.
        rivals: what was found, and its rivals, each as a model with its covariance.
        covered: where the training recordings have been.
        error_by_value: errors of the revised model by the value of each channel.
        lateness: clock of a log -> s by which its stamps are late by always the same.
        remainder: what effects that were found leave, where that is more than noise.
        seconds: how long it took.
        simulations: how many simulations of all training data that equals, by simulated time.
    """

    verdict: Verdict
    revised: Model
    recalibrated: Model
    effects: tuple[FoundEffect, ...] = ()
    unknown: Unknown | None = None
    equivalent: tuple[tuple[str, ...], ...] = ()
    separate: Mapping[str, str] = field(default_factory=dict)
    ranking: tuple[RankLine, ...] = ()
    train: Mapping[str, ChannelError] = field(default_factory=dict)
    holdout: Mapping[str, ChannelError] = field(default_factory=dict)
    unseen: Mapping[str, ChannelError] = field(default_factory=dict)
    calibrated: Mapping[str, Estimate] = field(default_factory=dict)
    corrected: Mapping[str, float] = field(default_factory=dict)
    misread: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    per_run: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    convergence: Convergence | None = None
    notes: tuple[str, ...] = ()
    replays: tuple[Replay, ...] = ()
    complete: bool = True
    failed: FailedStage | None = None
    rivals: tuple[Rival, ...] = ()
    covered: Covered | None = None
    error_by_value: tuple[ErrorByValue, ...] = ()
    seconds: float = math.nan
    simulations: float = math.nan
    lateness: Mapping[str, Estimate] = field(default_factory=dict)
    remainder: Remainder | None = None

    def __repr__(self) -> str:
        """What it is in one line: the verdict, and what was found."""
        found = ", ".join(item.id for item in self.effects)
        if not found and self.unknown is not None:
            found = f"in the {self.unknown.equation or 'undetermined'} equation"
        ended = "" if self.complete else ", interrupted"
        return f"<Diagnosis: {self.verdict.value}{f' ({found})' if found else ''}{ended}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: what was found, and the errors before and after."""
        return str(_html(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of diagnosis.json; what is not computable is null."""
        return {
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict.value,
            "effects": [
                {
                    "id": item.id,
                    "at": item.at,
                    "equation": item.equation,
                    "parameters": {
                        name: estimate_to_dict(e) for name, e in item.parameters.items()
                    },
                    "settings": dict(item.settings),
                    "share": finite_or_none(item.share),
                    "p_value": finite_or_none(item.p_value),
                }
                for item in self.effects
            ],
            "unknown": None if self.unknown is None else {
                "equation": self.unknown.equation,
                "at": self.unknown.at or None,
                "variables": list(self.unknown.variables),
                "derived": dict(self.unknown.derived),
                "description": self.unknown.description,
                "share": finite_or_none(self.unknown.share),
                "period": self.unknown.period or None,
                "when": [list(pair) for pair in self.unknown.when],
                "where": self.unknown.where,
                "sensor": self.unknown.sensor,
                "shape": self.unknown.shape,
            },
            "remainder": None if self.remainder is None else self.remainder.to_dict(),
            "equivalent": [list(group) for group in self.equivalent],
            "separate": dict(self.separate),
            "ranking": [
                {
                    "id": line.id,
                    "score": finite_or_none(line.score),
                    "p_value": finite_or_none(line.p_value),
                    "error_after": finite_or_none(line.error_after),
                    "reason": line.reason,
                }
                for line in self.ranking
            ],
            "error": {
                "train": errors_to_dict(self.train),
                "holdout": errors_to_dict(self.holdout),
                "unseen": errors_to_dict(self.unseen),
            },
            "model": REVISED_FILE,
            "rivals": [item.to_dict() for item in self.rivals],
            "covered": None if self.covered is None else self.covered.to_dict(),
            "error_by_value": [item.to_dict() for item in self.error_by_value],
            "calibrated": {name: estimate_to_dict(e) for name, e in self.calibrated.items()},
            "corrected": {
                name: {"declared": value, **estimate_to_dict(self.calibrated[name])}
                for name, value in self.corrected.items()
            },
            "misread": list(self.misread),
            "doubtful": list(self.doubtful),
            "per_run": own_to_dict(self.per_run),
            "lateness": {name: estimate_to_dict(e) for name, e in self.lateness.items()},
            "undetermined": list(self.undetermined),
            "convergence": None if self.convergence is None else self.convergence.to_dict(),
            "notes": list(self.notes),
            "complete": self.complete,
            "failed": None if self.failed is None else self.failed.to_dict(),
            "seconds": finite_or_none(self.seconds),
            "simulations": finite_or_none(self.simulations),
        }  # fmt: skip

    def to_json(self) -> str:
        """Return diagnosis.json's text."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def write(self, folder: Path) -> None:
        """Write diagnosis.json, revised.yaml, recalibrated.yaml and each rival's model."""
        folder.mkdir(parents=True, exist_ok=True)
        changed = (f"another {name}" for name in self.corrected)
        names = ", ".join((*(item.id for item in self.effects), *changed)) or "nothing"
        self.revised.write(folder / REVISED_FILE, f"Revised by eha-bench diagnose; added: {names}")
        self.recalibrated.write(
            folder / RECALIBRATED_FILE, "Recalibrated by eha-bench diagnose; nothing added"
        )
        for rival in self.rivals:
            (folder / rival.file).parent.mkdir(exist_ok=True)
            rival.model.write(
                folder / rival.file, f"A rival by eha-bench diagnose ({rival.standing.value})"
            )
        write_text(folder / DIAGNOSIS_FILE, self.to_json())

    def with_note(self, note: str) -> Diagnosis:
        """Return it with one more note."""
        return replace(self, notes=(*self.notes, note))

    def keep(self, folder: str | Path | None) -> None:
        """Write it where there is a folder to write it to."""
        if folder is not None:
            self.write(Path(folder))


def own_to_dict(items: Mapping[str, Mapping[str, Estimate]]) -> dict[str, Any]:
    """Return the runs' own parameters as they stand in JSON."""
    return {
        run: {name: estimate_to_dict(item) for name, item in own.items()}
        for run, own in items.items()
    }


def estimate_to_dict(item: Estimate) -> dict[str, Any]:
    """Return an estimate as it stands in JSON."""
    return {
        "value": finite_or_none(item.value),
        "low": finite_or_none(item.low),
        "high": finite_or_none(item.high),
        "unit": item.unit,
        **({} if item.profile is None else {"profile": list(item.profile)}),
    }


def errors_to_dict(items: Mapping[str, ChannelError]) -> dict[str, Any]:
    """Return errors by channel as they stand in JSON."""
    return {
        name: {
            "before": finite_or_none(item.before),
            "after": finite_or_none(item.after),
            "noise_floor": finite_or_none(item.noise_floor),
            "unit": item.unit,
            "uncalibrated": finite_or_none(item.uncalibrated),
            "before_predict": finite_or_none(item.before_predict),
            "after_predict": finite_or_none(item.after_predict),
            "before_windows": finite_or_none(item.before_windows),
            "after_windows": finite_or_none(item.after_windows),
            "start": finite_or_none(item.start),
        }
        for name, item in items.items()
    }
