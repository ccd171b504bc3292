"""The result of a run: a versioned JSON file that reports, gates and comparisons read."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place
from eha_bench.core.finite import finite_or_none
from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.score import Measure, Score, ScoreStatus

SCHEMA_VERSION = 1


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


@dataclass(frozen=True)
class TrialResult:
    """One run of one trial: its recording and its scores.

    `definition` is a digest of what was run (signal, setup, rate), without how it was judged: two
    results of the same definition can be compared.
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


@dataclass(frozen=True)
class Result:
    """All trials of a suite on a target, with where they came from.

    `repeats` sums up every metric over the repeats of its trial, where there are several.
    """

    suite: str
    target: str
    status: Status
    trials: tuple[TrialResult, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    repeats: tuple[RepeatsSummary, ...] = ()

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
        """Write JSON beside the final name and rename it, so that it is never half there."""
        write_text(path, self.to_json())

    @staticmethod
    def read(path: Path) -> Result:
        """Read a result.json.

        Raises:
            InputError: missing, not JSON, or of another schema version.
        """
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise InputError("no such result", where=Place(file=str(path))) from error
        except (OSError, ValueError) as error:
            raise InputError(f"not a result ({error})", where=Place(file=str(path))) from error
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version != SCHEMA_VERSION:
            raise InputError(
                f"schema version {version} instead of {SCHEMA_VERSION}",
                where=Place(file=str(path), key="schema_version"),
                hint="read it with the eha-bench that wrote it, or run the suite again",
            )
        try:
            return _from_dict(data)
        except _WRONG as error:
            raise InputError(
                f"not a result ({_why(error)})", where=Place(file=str(path))
            ) from error


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
        "provenance": dict(result.provenance),
    }


def _score_to_dict(score: Score) -> dict[str, Any]:
    return {
        "metric": score.metric,
        "channel": score.channel,
        "value": finite_or_none(score.measure.value),
        "low": finite_or_none(score.measure.low),
        "high": finite_or_none(score.measure.high),
        "unit": score.unit,
        "limit": score.limit_in_si or score.limit,
        "limit_written": score.limit,
        "matters": score.matters,
        "status": score.status.value,
        "reason": score.measure.reason,
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


def _float(value: Any) -> float:
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{value!r} is not a number") from error


def _score(data: Mapping[str, Any]) -> Score:
    return Score(
        metric=str(data["metric"]),
        channel=str(data.get("channel") or ""),
        measure=Measure(
            _float(data["value"]),
            _float(data.get("low")),
            _float(data.get("high")),
            str(data.get("reason") or ""),
        ),
        unit=str(data.get("unit") or ""),
        status=ScoreStatus(data["status"]),
        limit=str(data.get("limit_written") or data.get("limit") or ""),
        limit_in_si=str(data.get("limit") or "") if data.get("limit_written") else "",
        matters=str(data.get("matters") or ""),
    )


def _trial(data: Mapping[str, Any]) -> TrialResult:
    return TrialResult(
        id=str(data["id"]),
        repeat=int(_float(data.get("repeat", 0))),
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
        repeats=_each(data, "repeats", RepeatsSummary.from_dict),
    )
