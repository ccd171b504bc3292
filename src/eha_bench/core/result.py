"""The result of a run: a versioned JSON file that reports, gates and comparisons read."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from eha_bench.core.atomic_file import write_text
from eha_bench.core.budget import Budget, Contribution, Evaluation
from eha_bench.core.errors import InputError, Place
from eha_bench.core.finite import finite_or_none
from eha_bench.core.input_files import note_input
from eha_bench.core.lazy import later
from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.score import Measure, Score, ScoreStatus, number_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SCHEMA_VERSION = 1

_html = later("eha_bench.report.notebook", "result_html")
_plot = later("eha_bench.report.plot", "plot_trial")


class Status(StrEnum):
    """How a trial or a whole run ended."""

    PASSED = "passed"
    FAILED = "failed"
    INCOMPLETE = "incomplete"
    FAULT = "fault"

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 accepted, 1 a limit failed, 3 fault or safety stop."""
        return {"passed": 0, "failed": 1, "incomplete": 1, "fault": 3}[self.value]

    def word(self, *, judged: bool) -> str:
        """Return the verdict in words: what ended well and has no limit passed none."""
        return self.value if judged or self is not Status.PASSED else "not judged"


@dataclass(frozen=True)
class TrialResult:
    """One run of one trial: its recording and its scores.

    `definition` is a digest of what was run (signal, setup, rate), without how it was judged: two
    results of the same definition can be compared. `reason` says why it was stopped or not scored,
    or which safety limit a recording that came to its end was beyond.
    """

    id: str
    repeat: int
    status: Status
    recording: str
    sha256: str
    scores: tuple[Score, ...] = ()
    reason: str = ""
    notes: tuple[str, ...] = ()
    definition: str = ""

    @property
    def is_unsafe(self) -> bool:
        """Whether a recording that came to its end was beyond a safety limit: `reason` says it."""
        return self.status is Status.FAILED and bool(self.reason)


class MissedLimit(NamedTuple):
    """A limit that was not kept, or (without a metric) why a run did not pass; values are SI."""

    trial: str
    repeat: int
    metric: str
    status: str
    value: float
    unit: str
    limit: str
    reason: str


@dataclass(frozen=True)
class Result:
    """All trials of a suite on a target, with where they came from.

    `repeats` sums up every metric over the repeats of its trial, where there are several;
    `not_run` names the trials and repeats that a stopped run did not come to; `folder` is where it
    lies with its recordings, None for one that was not written.
    """

    suite: str
    target: str
    status: Status
    trials: tuple[TrialResult, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    repeats: tuple[RepeatsSummary, ...] = ()
    not_run: tuple[tuple[str, int], ...] = ()
    folder: Path | None = field(default=None, compare=False)

    @property
    def failed(self) -> tuple[MissedLimit, ...]:
        """Limits that were not kept, and what stopped a run; in the order of the suite."""
        found = []
        for run in self.trials:
            missed = [score for score in run.scores if score.limit and score.status.rejects]
            found += [
                MissedLimit(
                    run.id, run.repeat, item.metric, item.status.value, item.value, item.unit,
                    item.limit, "" if math.isfinite(item.value) else item.reason,
                )
                for item in missed
            ]  # fmt: skip
            if run.status is not Status.PASSED and not missed:
                found.append(
                    MissedLimit(
                        run.id, run.repeat, "", run.status.value, math.nan, "", "", run.reason
                    )
                )
        return tuple(found)

    def __repr__(self) -> str:
        """What it is in one line: suite, target, verdict, limits kept."""
        limits = [score for run in self.trials for score in run.scores if score.limit]
        kept = sum(not score.status.rejects for score in limits)
        kept_of = f"{kept} of {len(limits)} limits kept" if limits else "no limits"
        where = f", in {self.folder}" if self.folder else ""
        return f"<Result of {self.suite} on {self.target}: {self.status.value}, {kept_of}{where}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: a line a limit, those that are not kept first."""
        return str(_html(self))

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas DataFrame with a row for every score of every run; values are SI."""
        import pandas as pd

        rows = [
            {
                "trial": run.id,
                "repeat": run.repeat,
                "metric": score.metric,
                "channel": score.channel,
                "value": score.measure.value,
                "low": score.measure.low,
                "high": score.measure.high,
                "unit": score.unit,
                "limit": score.limit,
                "status": score.status.value,
                "reason": score.reason,
            }
            for run in self.trials
            for score in run.scores
        ]
        names = ("trial", "repeat", "metric", "channel", "value", "low", "high", "unit", "limit",
                 "status", "reason")  # fmt: skip
        return pd.DataFrame(rows, columns=list(names))

    def plot(self, trial: str, repeat: int = 0) -> Figure:
        """Return a matplotlib figure of a trial's recording.

        Raises:
            InputError: there is no such trial, or its recording is not there.
        """
        figure: Figure = _plot(self, trial, repeat)
        return figure

    @staticmethod
    def overall(trials: tuple[TrialResult, ...], *, complete: bool) -> Status:
        """Return the worst status: fault, then incomplete, then failed, then passed."""
        found = {trial.status for trial in trials}
        if Status.FAULT in found:
            return Status.FAULT
        if not complete or Status.INCOMPLETE in found:
            return Status.INCOMPLETE
        return Status.FAILED if Status.FAILED in found else Status.PASSED

    def to_json(self) -> str:
        """Return the result as JSON (contract, section 8); NaN becomes null."""
        return json.dumps(_to_dict(self), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def write(self, path: Path) -> None:
        """Write JSON to a temporary name and rename it, so that it is never half there."""
        write_text(path, self.to_json())

    @staticmethod
    def read(path: Path) -> Result:
        """Read a result.json.

        Raises:
            InputError: missing, not JSON, or of another schema version.
        """
        note_input(path)
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise InputError(
                "no such result", where=Place(file=str(path)), hint=_RESULTS
            ) from error
        except (OSError, ValueError) as error:
            what = f"not a result ({error})" if isinstance(error, OSError) else "not a result"
            raise InputError(what, where=Place(file=str(path)), hint=_RESULTS) from error
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version != SCHEMA_VERSION:
            raise InputError(
                f"schema version {version} instead of {SCHEMA_VERSION}",
                where=Place(file=str(path), key="schema_version"),
                hint="read it with the eha-bench that wrote it, or run the suite again",
            )
        try:
            return replace(_from_dict(data), folder=path.parent)
        except _WRONG as error:
            raise InputError(
                f"not a result ({_why(error)})", where=Place(file=str(path))
            ) from error


_RESULTS = "give the result.json that `run` or `score` wrote, or its folder"


def _to_dict(result: Result) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "suite": result.suite,
        "description": result.description,
        "target": result.target,
        "status": result.status.value,
        "trials": [
            {
                "id": trial.id,
                "repeat": trial.repeat,
                "status": trial.status.value,
                "reason": trial.reason,
                "recording": trial.recording,
                "sha256": trial.sha256,
                "definition": trial.definition,
                "notes": list(trial.notes),
                "scores": [_score_to_dict(score) for score in trial.scores],
            }
            for trial in result.trials
        ],
        "repeats": [summary.to_dict() for summary in result.repeats],
        "not_run": [{"id": trial, "repeat": repeat} for trial, repeat in result.not_run],
        "provenance": dict(result.provenance),
    }


def _score_to_dict(score: Score) -> dict[str, Any]:
    return {
        "metric": score.metric,
        "channel": score.channel,
        **score.measure.to_dict(),
        "unit": score.unit,
        "limit": score.limit_in_si or score.limit,
        "limit_written": score.limit,
        "matters": score.matters,
        "status": score.status.value,
        "reason": score.measure.reason,
        "judged_by": score.judged_by,
        "budget": [_contribution_to_dict(part) for part in score.measure.budget.parts],
    }


def _contribution_to_dict(part: Contribution) -> dict[str, Any]:
    return {
        "source": part.source,
        "type": part.evaluation.value,
        "standard": finite_or_none(part.standard),
        "freedom": finite_or_none(part.freedom),
        "distribution": "rectangular" if part.rectangular else "normal",
    }


_WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError)
_Read = TypeVar("_Read")


def _why(error: Exception) -> str:
    """Return what is wrong with an entry in words, not in Python's."""
    if isinstance(error, KeyError):
        return f"'{error.args[0]}' is missing"
    return str(error) if isinstance(error, ValueError) else "an entry of a wrong type"


def _each(data: Mapping[str, Any], key: str, read: Callable[[Any], _Read]) -> tuple[_Read, ...]:
    """Read every entry of a list; what is wrong with one says which."""
    entries = data.get(key) or ()
    if not isinstance(entries, list | tuple):
        raise ValueError(f"{key}: not a list")
    found = []
    for place, entry in enumerate(entries):
        try:
            found.append(read(entry))
        except _WRONG as error:
            raise ValueError(f"{key}[{place}]: {_why(error)}") from error
    return tuple(found)


def _contribution(data: Mapping[str, Any]) -> Contribution:
    freedom = data.get("freedom")
    return Contribution(
        source=str(data["source"]),
        evaluation=Evaluation(data["type"]),
        standard=number_of(data["standard"]),
        freedom=math.inf if freedom is None else number_of(freedom),
        rectangular=data.get("distribution") == "rectangular",
    )


def _score(data: Mapping[str, Any]) -> Score:
    return Score(
        metric=str(data["metric"]),
        channel=str(data.get("channel") or ""),
        measure=Measure(
            number_of(data["value"]),
            *Measure.ends_of(data),
            str(data.get("reason") or ""),
            Budget(_each(data, "budget", _contribution)),
        ),
        unit=str(data.get("unit") or ""),
        status=ScoreStatus(data["status"]),
        limit=str(data.get("limit_written") or data.get("limit") or ""),
        limit_in_si=str(data.get("limit") or "") if data.get("limit_written") else "",
        matters=str(data.get("matters") or ""),
        judged_by=str(data.get("judged_by") or ""),
    )


def _trial(data: Mapping[str, Any]) -> TrialResult:
    return TrialResult(
        id=str(data["id"]),
        repeat=int(number_of(data.get("repeat", 0))),
        status=Status(data["status"]),
        recording=str(data.get("recording") or ""),
        sha256=str(data.get("sha256") or ""),
        definition=str(data.get("definition") or ""),
        reason=str(data.get("reason") or ""),
        notes=_each(data, "notes", str),
        scores=_each(data, "scores", _score),
    )


def _from_dict(data: Mapping[str, Any]) -> Result:
    if data.get("trials") is None:
        raise KeyError("trials")
    return Result(
        suite=str(data["suite"]),
        target=str(data["target"]),
        status=Status(data["status"]),
        trials=_each(data, "trials", _trial),
        provenance={str(k): str(v) for k, v in (data.get("provenance") or {}).items()},
        description=str(data.get("description", "")),
        not_run=_each(
            data, "not_run", lambda item: (str(item["id"]), int(number_of(item.get("repeat", 0))))
        ),
        repeats=_each(data, "repeats", RepeatsSummary.from_dict),
    )
