"""Runs a suite on two targets in turn, A B B A, so that no drift of the rig favours one of them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.bench.ahead import Job, ahead
from eha_bench.bench.folder import ResultFolder
from eha_bench.bench.run import run_suite
from eha_bench.bench.store import folder_lock, set_aside
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place, TargetFault
from eha_bench.core.interruption import Interruption
from eha_bench.core.progress import Progress, silent
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.trial import Trial
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.suites import Suite
from eha_bench.targets.target import Target

SCHEMA_VERSION: Final = 1
PLAN_NAME: Final = "ab.json"
SIDES: Final = ("a", "b")
COMPARISON: Final = "comparison.json"
COMPARISON_SUMMARY: Final = "comparison.md"
COMPARISON_FILES: Final = (COMPARISON, COMPARISON_SUMMARY, "comparison.html")
"""What is written there once the sides have been compared."""
_WARM_UP: Final = "warm-up"

Opener = Callable[[], Target]
Decided = Callable[[dict[str, Result]], bool]


@dataclass(frozen=True)
class InterleavedPlan:
    """What an interleaved run does; written before it begins, so that it can be resumed.

    Attributes:
        suite_sha256: digest of the suite.
        targets: names of the two targets, A first.
        repeats: pairs, at most.
        seed: of the order.
    """

    suite_sha256: str
    targets: tuple[str, str]
    repeats: int
    seed: int

    def order(self) -> tuple[tuple[str, str], ...]:
        """Return which side is first in each pair: A B B A or B A A B, drawn for two pairs."""
        drawn = np.random.default_rng(self.seed).integers(0, 2, (self.repeats + 1) // 2)
        blocks = [(SIDES, SIDES[::-1]) if first == 0 else (SIDES[::-1], SIDES) for first in drawn]
        pairs = [(pair[0], pair[1]) for block in blocks for pair in block]
        return tuple(pairs[: self.repeats])

    def to_json(self) -> str:
        """Return the plan as JSON."""
        content = {
            "schema_version": SCHEMA_VERSION,
            "suite_sha256": self.suite_sha256,
            "targets": list(self.targets),
            "repeats": self.repeats,
            "seed": self.seed,
            "order": ["".join(pair).upper() for pair in self.order()],
        }
        return json.dumps(content, indent=1) + "\n"


@dataclass(frozen=True)
class Interleaved:
    """How far an interleaved run came.

    Attributes:
        results: of the sides `a` and `b`, pairs as repeats; recordings relative to their folders.
        pairs: that both sides finished.
        status: the worst of all runs; INCOMPLETE if it was interrupted.
        decided: whether it ended before the last pair because nothing was left to decide.
    """

    results: dict[str, Result]
    pairs: int
    status: Status
    decided: bool


def run_interleaved(
    suite: Suite,
    openers: Mapping[str, Opener],
    out: Path,
    plan: InterleavedPlan,
    *,
    decided: Decided,
    warm_up: int = 1,
    resume: bool = False,
    workers: Workers = IN_PROCESS,
    progress: Progress = silent,
) -> Interleaved:
    """Run every trial on both targets, pair by pair, until nothing is left to decide.

    Args:
        suite: its trials are run once a pair; their own `repeats` do not count.
        openers: by side, makes the target again for every run: only one is held at a time.
        out: gets a folder for each side, and the plan; an earlier run in it is set aside.
        plan: order and number of pairs.
        decided: asked after every pair whether to stop.
        warm_up: passes through the suite, the targets taking turns, that are not scored.
        resume: go on with an earlier, interrupted run of the same plan.
        workers: simulate runs ahead, several at a time, to the same results; those beyond the last
            pair that was needed are dropped.
        progress: called at the start of every run.

    Raises:
        EhaBenchError: the suite cannot run on a target, or `out` cannot be used.
    """
    _prepare(out, plan, resume=resume)
    with folder_lock(out):
        return _run_pairs(suite, openers, out, plan, decided, warm_up, workers, progress)


def _run_pairs(
    suite: Suite,
    openers: Mapping[str, Opener],
    out: Path,
    plan: InterleavedPlan,
    decided: Decided,
    warm_up: int,
    workers: Workers,
    progress: Progress,
) -> Interleaved:
    """Run what is not finished of the plan, pair by pair."""
    done: dict[str, list[TrialResult]] = {side: [] for side in SIDES}
    about: dict[str, Result] = {}
    ended, pairs, enough = Status.PASSED, 0, False
    warm = warm_up <= 0
    total = plan.repeats * len(suite.trials) * 2
    with _ahead(suite, openers, out, plan, workers) as opened, Interruption() as interrupted:
        for number, order in enumerate(plan.order()):
            for trial, side in ((trial, side) for trial in suite.trials for side in order):
                folder = out / side / _name(number, trial)
                if not warm and not _finished(folder):
                    ended = _warm_up(suite, openers, out / _WARM_UP, warm_up, progress)
                    warm = True
                    if ended is Status.INCOMPLETE:
                        break
                progress(sum(map(len, done.values())), total, f"{side.upper()}: {trial.id}")
                single = _single(trial, number)
                result = run_suite(_only(suite, single), opened[side](), folder, resume=True)
                about[side] = result
                done[side] += [_repeat_of_whole(run, number, folder.name) for run in result.trials]
                if result.status in (Status.FAULT, Status.INCOMPLETE) or interrupted():
                    fault = result.status is Status.FAULT
                    ended = Status.FAULT if fault else Status.INCOMPLETE
                    break
            else:
                pairs = number + 1
                enough = decided(_merged(suite, about, done, complete=True))
                if enough:
                    break
                continue
            break
    complete = ended not in (Status.FAULT, Status.INCOMPLETE)
    if not about:
        return Interleaved({}, 0, ended, decided=False)
    results = _merged(suite, about, done, complete=complete)
    for side, result in results.items():
        result.write(out / side / "result.json")
    status = ended if not complete else Result.overall(
        tuple(run for result in results.values() for run in result.trials), complete=True
    )  # fmt: skip
    return Interleaved(results, pairs, status, decided=enough and pairs < plan.repeats)


def _prepare(out: Path, plan: InterleavedPlan, *, resume: bool) -> None:
    """Make the folder; refuse one that holds something else, or another plan to go on with."""
    file = out / PLAN_NAME
    if out.exists() and (not out.is_dir() or (any(out.iterdir()) and not file.is_file())):
        raise InputError(
            "is not empty and not the folder of such a run",
            where=Place(file=str(out)),
            hint="name another folder with --out",
        )
    if resume and file.is_file():
        found: Any = None
        with suppress(ValueError):
            found = json.loads(file.read_text(encoding="utf-8"))
        if found != json.loads(plan.to_json()):
            raise InputError(
                "was started with another suite, other targets, repeats or seed",
                where=Place(file=str(file)),
                hint="give the same ones, or leave out --resume to start a new run",
            )
    elif file.is_file():
        with folder_lock(out):
            set_aside(out)
    out.mkdir(parents=True, exist_ok=True)
    for side in SIDES:
        # a merged result of an earlier, interrupted run would be stale
        ResultFolder(out / side).clear()
    for name in COMPARISON_FILES:
        (out / name).unlink(missing_ok=True)
    write_text(file, plan.to_json())


def _warm_up(
    suite: Suite, openers: Mapping[str, Opener], folder: Path, passes: int, progress: Progress
) -> Status:
    """Run the trials on the targets in turn, and throw away what was recorded.

    Raises:
        TargetFault: a target failed; no result would say why.
    """
    status = Status.PASSED
    shutil.rmtree(folder, ignore_errors=True)
    runs = [trial for _ in range(passes) for trial in suite.trials]
    for number, trial in enumerate(runs):
        side = SIDES[number % 2]
        progress(number, len(runs), f"warm-up, {side.upper()}: {trial.id}")
        result = run_suite(_only(suite, replace(trial, repeats=1)), openers[side](), folder)
        status = result.status
        shutil.rmtree(folder, ignore_errors=True)
        if status is Status.FAULT:
            raise TargetFault(f"warm-up, {side.upper()}, {trial.id}: {result.trials[-1].reason}")
        if status is Status.INCOMPLETE:
            break
    return status


@contextmanager
def _ahead(
    suite: Suite, openers: Mapping[str, Opener], out: Path, plan: InterleavedPlan, workers: Workers
) -> Iterator[Mapping[str, Opener]]:
    """Give openers of targets that workers run ahead, all that is not finished; or those there are.

    Raises:
        InputError: a target can run one trial at a time only.
    """
    if workers == IN_PROCESS:
        yield openers
        return
    targets = {side: openers[side]() for side in SIDES}
    jobs: list[Job] = [
        (targets[side], _single(trial, number), 0)
        for number, order in enumerate(plan.order())
        for trial in suite.trials
        for side in order
        if not _finished(out / side / _name(number, trial))
    ]
    with ahead(jobs, workers) as turned:
        yield {side: partial(turned, target) for side, target in targets.items()}


def _single(trial: Trial, number: int) -> Trial:
    """Return a trial as it is run in a pair: with a new seed, the same for both sides' noise."""
    return replace(trial, repeats=1, seed=trial.seed + number)


def _only(suite: Suite, trial: Trial) -> Suite:
    return replace(suite, trials=(trial,))


def _name(number: int, trial: Trial) -> str:
    return f"{number:03d}-{trial.id}"


def _finished(folder: Path) -> bool:
    file = folder / "result.json"
    return file.is_file() and Result.read(file).status in (Status.PASSED, Status.FAILED)


def _repeat_of_whole(run: TrialResult, number: int, folder: str) -> TrialResult:
    """Return a run as a repeat of the whole, its recording named from the side's folder."""
    recording = f"{folder}/{run.recording}" if run.recording else ""
    return replace(run, repeat=number, recording=recording)


def _merged(
    suite: Suite,
    about: dict[str, Result],
    done: dict[str, list[TrialResult]],
    *,
    complete: bool,
) -> dict[str, Result]:
    return dict(_each(suite, about, done, complete=complete))


def _each(
    suite: Suite,
    about: dict[str, Result],
    done: dict[str, list[TrialResult]],
    *,
    complete: bool,
) -> Iterator[tuple[str, Result]]:
    order = {trial.id: place for place, trial in enumerate(suite.trials)}
    for side, result in about.items():
        trials = tuple(sorted(done[side], key=lambda run: (order[run.id], run.repeat)))
        status = Result.overall(trials, complete=complete)
        yield side, replace(result, trials=trials, status=status, not_run=())
