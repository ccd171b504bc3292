"""Runs a suite at every point of a design, and keeps what came of it as a table."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.bench.store import SuiteFolder, folder_lock, set_aside
from eha_bench.core.arrays import FloatArray
from eha_bench.core.atomic_file import replacing, write_text
from eha_bench.core.errors import InputError, Place
from eha_bench.core.extras import require
from eha_bench.core.finite import finite_or_none
from eha_bench.core.interruption import Interruption
from eha_bench.core.output_folder import writable
from eha_bench.core.progress import Progress, silent
from eha_bench.core.result import Status
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.design import design_of
from eha_bench.sweeps.evaluation import LimitName, PointEvaluation, PointResult, limits_of
from eha_bench.sweeps.journal import JOURNAL, PointJournal
from eha_bench.sweeps.space import Point, Space, space_of
from eha_bench.sweeps.sweep_file import SweepFile

TABLE: Final = "points.parquet"
SUMMARY: Final = "sweep.json"
WRITTEN: Final = (JOURNAL, TABLE, SUMMARY)
"""What a sweep writes for programs."""
SCHEMA_VERSION: Final = 1


@dataclass(frozen=True)
class SweepResult:
    """A sweep as far as it came.

    Attributes:
        space: what was varied. points: all of them. results: by the point's place, of those done.
        limits: of the suite. folder: where it lies. file: the sweep.yaml.
    """

    space: Space
    points: tuple[Point, ...]
    results: Mapping[int, PointResult]
    limits: tuple[LimitName, ...]
    folder: Path
    file: Path

    @property
    def complete(self) -> bool:
        """Whether every point is done."""
        return len(self.results) == len(self.points)

    @property
    def passing_points(self) -> tuple[int, ...]:
        """Places of the points that keep all limits."""
        return tuple(place for place, found in sorted(self.results.items()) if found.passed)

    @property
    def best(self) -> int | None:
        """Place of the point with the largest least margin, those that pass before all others."""
        ranked = [
            (found.passed, found.margin, -place)
            for place, found in self.results.items()
            if math.isfinite(found.margin)
        ]
        return -max(ranked)[2] if ranked else None

    @property
    def margins(self) -> FloatArray:
        """Margins of the points done, (points, limits), in the order of their places."""
        done = [found.margins for _, found in sorted(self.results.items())]
        return np.array(done, dtype=np.float64).reshape(len(done), len(self.limits))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of sweep.json."""
        best = self.best
        return {
            "schema_version": SCHEMA_VERSION,
            "suite": self.space.case.suite.name,
            "target": self.space.case.simulator.identity.name,
            "status": _status(self).value,
            "points": len(self.points),
            "done": len(self.results),
            "passed": len(self.passing_points),
            "best": None if best is None else {
                "point": best,
                "values": self.space.values_by_key(self.points[best]),
                "margin": finite_or_none(self.results[best].margin),
                "passed": self.results[best].passed,
            },
            "factors": [
                {"key": factor.key, "kind": factor.kind, "unit": factor.unit}
                for factor in self.space.factors
            ],
            "limits": [
                {
                    "key": limit.key,
                    "trial": limit.trial,
                    "metric": limit.metric,
                    "channel": limit.channel,
                    "limit": limit.text,
                    "kept": int(np.sum(self.margins[:, place] >= 0.0)),
                }
                for place, limit in enumerate(self.limits)
            ],
            "table": TABLE,
        }  # fmt: skip


def _status(sweep: SweepResult) -> Status:
    if not sweep.complete:
        return Status.INCOMPLETE
    return Status.PASSED if sweep.passing_points else Status.FAILED


def prepared_sweep(case: Case, file: SweepFile) -> tuple[Space, tuple[Point, ...]]:
    """Return the space and the points of a sweep file over a case.

    Raises:
        InputError: the case has no such factor, or a factor cannot be what is asked.
    """
    space = space_of(case, file.blocks)
    return space, design_of(file).points(space)


def run_sweep(
    case: Case,
    file: SweepFile,
    out: Path | SuiteFolder,
    *,
    resume: bool = False,
    workers: Workers = IN_PROCESS,
    progress: Progress = silent,
) -> SweepResult:
    """Run a case's suite at every point of a sweep file; write its table and its summary.

    Ctrl-C keeps what is done; with `resume` only the rest is run.

    Args:
        case: suite, model and controllers. file: what varies. out: folder, or shelf of folders.
        resume: go on with what is in `out`. workers: where points are run.
        progress: called after every point, with the time that is left.

    Raises:
        InputError: a factor that the case does not have, or `out` holds something else.
    """
    require("pyarrow", "parquet", f"{TABLE}, the table of all points,")
    space, points = prepared_sweep(case, file)
    limits = limits_of(case.suite)
    if not limits:
        raise InputError(
            "the suite has no acceptance limit, so nothing can pass",
            where=Place(file=str(case.suite.path)),
            hint="give a trial an 'accept' block",
        )
    for trial in case.suite.trials:
        case.simulator.check(trial)
    folder = _folder(out, resume=resume)
    digests = {
        "suite_sha256": case.suite.sha256,
        "sweep_sha256": file.sha256,
        **case.simulator.identity.digests,
    }
    with folder_lock(folder), PointJournal(folder / JOURNAL, digests, resume=resume) as journal:
        _run_rest(space, points, journal, workers, progress)
        results = {place: journal.done[place] for place in sorted(journal.done)}
        sweep = SweepResult(space, points, results, limits, folder, file.path)
        _write(sweep)
    return sweep


def _folder(out: Path | SuiteFolder, *, resume: bool) -> Path:
    if isinstance(out, SuiteFolder):
        latest = out.latest() if resume else None
        return latest or out.claim()
    folder = writable(out)
    ours = (folder / JOURNAL).is_file()
    if folder.is_dir() and any(folder.iterdir()) and not ours:
        raise InputError(
            "is not empty and holds no sweep",
            where=Place(file=str(folder)),
            hint="name another folder with --out",
        )
    if ours and not resume:
        with folder_lock(folder):
            set_aside(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _run_rest(
    space: Space,
    points: tuple[Point, ...],
    journal: PointJournal,
    workers: Workers,
    progress: Progress,
) -> None:
    waiting = [place for place in range(len(points)) if place not in journal.done]
    began, before = time.monotonic(), len(points) - len(waiting)
    passed = sum(found.passed for found in journal.done.values())
    try:
        with Interruption() as interrupted:
            progress(before, len(points), "starting")
            items = [points[place] for place in waiting]
            with closing(workers.outcomes(PointEvaluation(space), items)) as outcomes:
                for number, outcome in enumerate(outcomes, 1):
                    found = outcome.value or PointResult(
                        Status.FAULT,
                        (math.nan,) * len(limits_of(space.case.suite)),
                        reason=str(outcome.error),
                    )
                    journal.add(waiting[outcome.index], found)
                    passed += found.passed
                    left = (time.monotonic() - began) / number * (len(waiting) - number)
                    progress_text = f"{passed} pass; {time_left(left)} left"
                    progress(before + number, len(points), progress_text)
                    if interrupted():
                        break
    except KeyboardInterrupt:
        return  # asked for twice: what is done stands


def time_left(seconds: float) -> str:
    """Return a time for people: `40 s`, `12 min`, `3.4 h`."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def _write(sweep: SweepResult) -> None:
    import pyarrow.parquet as pq

    with replacing(sweep.folder / TABLE) as part:
        pq.write_table(table(sweep), part)
    text = json.dumps(sweep.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(sweep.folder / SUMMARY, text + "\n")


def table(sweep: SweepResult) -> Any:
    """Return a pyarrow table: a row a point that is done.

    Columns: `point`, one a factor (SI), `status`, `margin` (the least), `margin:KEY` a limit,
    `value:KEY` a score (SI), `reason`. The metadata of a column hold its unit.
    """
    import pyarrow as pa

    places = sorted(sweep.results)
    results = [sweep.results[place] for place in places]
    keys = dict.fromkeys(key for found in results for key in found.values)
    units = {key: unit for found in results for key, unit in found.units.items()}
    columns: list[tuple[str, Any, str]] = [("point", pa.array(places, pa.int64()), "")]
    for number, factor in enumerate(sweep.space.factors):
        values = [sweep.points[place][number] for place in places]
        words = any(isinstance(value, str) for value in values)
        found = [str(value) for value in values] if words else [float(value) for value in values]
        columns.append((factor.key, pa.array(found), factor.unit))
    columns.append(("status", pa.array([found.status.value for found in results]), ""))
    columns.append(("margin", pa.array([found.margin for found in results], pa.float64()), ""))
    for number, limit in enumerate(sweep.limits):
        own = [found.margins[number] for found in results]
        columns.append((f"margin:{limit.key}", pa.array(own, pa.float64()), ""))
    for key in keys:
        scores = [found.values.get(key, math.nan) for found in results]
        columns.append((f"value:{key}", pa.array(scores, pa.float64()), units[key]))
    columns.append(("reason", pa.array([found.reason for found in results]), ""))
    fields = [
        pa.field(name, column.type, metadata={"unit": unit}) for name, column, unit in columns
    ]
    return pa.Table.from_arrays([column for _, column, _ in columns], schema=pa.schema(fields))
