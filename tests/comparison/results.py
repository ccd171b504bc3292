"""Results made up for the tests of comparisons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus


def score(metric: str, value: float, unit: str = "s", **more: str) -> Score:
    reason = more.pop("reason", "")
    low, high = 0.995 * value, 1.005 * value
    if more.pop("clipped", ""):
        high = math.inf
    return Score(
        metric, more.pop("channel", "pressure_difference"), Measure(value, low, high, reason),
        unit, ScoreStatus.PASSED, **more,
    )  # fmt: skip


def result(
    values: Sequence[float], metric: str = "rise_time", *, trial: str = "step", **more: str
) -> Result:
    """A result of one metric, one value a repeat."""
    target, suite = more.pop("target", "simulator"), more.pop("suite", "tiny")
    keys = ("suite_sha256", "host", "revision", "started", "version")
    provenance = {key: more.pop(key) for key in keys if key in more}
    definition = more.pop("definition", "")
    runs = tuple(
        TrialResult(
            trial, i, Status.PASSED, "", "", (score(metric, value, **more),), definition=definition
        )
        for i, value in enumerate(values)
    )
    return Result(suite, target, Status.PASSED, runs, provenance)


def folder(path: Path, content: Result) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    content.write(path / "result.json")
    return path
