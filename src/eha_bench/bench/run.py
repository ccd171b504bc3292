"""Runs a suite on a target: every trial and repeat becomes a recording and is scored."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

import numpy as np

from eha_bench.bench.ahead import ahead
from eha_bench.bench.circumstances import Circumstances
from eha_bench.bench.folder import ResultFolder
from eha_bench.bench.judging import judge, judge_together, repeats_summaries
from eha_bench.bench.loop_health import loop_note
from eha_bench.bench.provenance import NO_DIGESTS, environment, file_sha256, now
from eha_bench.bench.safety import breach
from eha_bench.bench.stop_condition import StopCondition
from eha_bench.bench.store import SuiteFolder
from eha_bench.core.errors import (
    EhaBenchError,
    InputError,
    Place,
    RecordingError,
    SafetyStop,
    TargetFault,
)
from eha_bench.core.interruption import Interruption
from eha_bench.core.progress import Progress, silent
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import Trial
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.metrics.scoring import load_metrics
from eha_bench.recordings.writer import write_mcap
from eha_bench.suites import Suite
from eha_bench.suites.reach import check_reach
from eha_bench.targets.checked_run import checked_run
from eha_bench.targets.crash import crashes_as_faults
from eha_bench.targets.target import Ending, Journal, Outcome, Stopping, Target

_STATUS = {
    Ending.INTERRUPTED: Status.INCOMPLETE,
    Ending.SAFETY_STOP: Status.FAULT,
    Ending.FAULT: Status.FAULT,
    Ending.INFRASTRUCTURE: Status.FAULT,
}
_LOG = logging.getLogger("eha_bench")
_RETRY_AFTER = 1.0
"""Seconds before a trial is tried again: an adapter may need to come back."""


class _NotSaved(TargetFault):
    """The result could not be written, which no result can say."""


@dataclass
class _SuiteRun:
    """A run in progress: what is done so far, written after every trial."""

    suite: Suite
    target: Target
    folder: ResultFolder
    provenance: dict[str, str]
    done: dict[tuple[str, int], TrialResult] = field(default_factory=dict)
    circumstances: Circumstances = field(default_factory=Circumstances)

    @property
    def jobs(self) -> list[tuple[Trial, int]]:
        """Every trial and repeat, in the order of the suite."""
        return [(trial, n) for trial in self.suite.trials for n in range(trial.repeats)]

    def result(self, *, complete: bool) -> Result:
        order = [(trial.id, repeat) for trial, repeat in self.jobs]
        trials = tuple(self.done[key] for key in order if key in self.done)
        return Result(
            suite=self.suite.name,
            target=self.target.identity.name,
            status=Result.overall(trials, complete=complete),
            trials=trials,
            provenance={
                **self.provenance,
                **self.circumstances.oil(),
                "finished": now() if complete else "",
            },
            description=self.suite.description,
            # not at every save of a long run
            repeats=repeats_summaries(trials, self.suite.trials) if complete else (),
            not_run=tuple(key for key in order if key not in self.done),
        )

    def save(self, *, complete: bool) -> Result:
        result = self.result(complete=complete)
        try:
            result.write(self.folder.result)
        except OSError as error:
            stopped = [f"{t.reason}; " for t in result.trials if t.status is Status.FAULT]
            raise _NotSaved(
                f"{''.join(stopped[-1:])}the result cannot be written ({error.strerror})",
                hint="make room; the recordings are readable up to where the disk was full",
            ) from error
        return result

    def stop(self, ending: Ending, fault: EhaBenchError) -> Result:
        """Save what faulted outside of a trial, as that of the trial it kept from running.

        Where none is left to run, it is that of the last one, which keeps its scores.
        """
        waiting = [(trial.id, number) for trial, number in self.jobs]
        trial, repeat = next((job for job in waiting if job not in self.done), waiting[-1])
        last = self.done.get((trial, repeat), TrialResult(trial, repeat, Status.FAULT, "", ""))
        reason = "; ".join(filter(None, (last.reason, f"{ending.value}: {fault}")))
        self.done[trial, repeat] = replace(last, status=Status.FAULT, reason=reason)
        self.provenance["stopped_by"] = ending.value
        return self.save(complete=False)


def run_suite(
    suite: Suite,
    target: Target,
    out: Path | SuiteFolder,
    *,
    resume: bool = False,
    retries: int = 0,
    time_limit: float = math.inf,
    workers: Workers = IN_PROCESS,
    progress: Progress = silent,
) -> Result:
    """Run every trial and repeat of a suite, write recordings and result.json into `out`.

    An earlier run in that folder is set aside; on a shelf, every run gets its own folder.
    A run that is interrupted (Ctrl-C) or stopped by a fault leaves readable recordings and a
    result that says so; with `resume`, what an earlier run of the same suite on the same target
    finished is kept and only the rest is run. `retries` is how often a trial is run again whose
    infrastructure failed (the target did not answer, its loop was not healthy enough to be
    scored), never one that failed or was stopped; after `time_limit` s the run stops.
    With `workers`, a simulated target runs trials ahead, several at a time, to the same recordings.

    Raises:
        EhaBenchError: the suite cannot run on this target, one of its metrics cannot be loaded,
            `out` cannot be used, or what is to be resumed is a run of something else.
    """
    load_metrics(suite.trials)
    broken = _fault_of_check(suite, target)
    digests = {"suite_sha256": suite.sha256, **target.identity.digests}
    folder = ResultFolder(_folder(out, resume=resume))
    with folder.open_for_run(resume=resume):
        kept = _finished_runs(folder, digests) if resume else {}
        folder.clear()
        provenance = {**environment(suite.path.parent), "started": now(), **NO_DIGESTS, **digests}
        run = _SuiteRun(suite, target, folder, provenance, dict(kept))
        run.save(complete=False)
        result = _run_rest(run, broken, workers, retries, time_limit, progress)
    return replace(result, folder=folder.path)


def _folder(out: Path | SuiteFolder, *, resume: bool) -> Path:
    """Return the folder of a run: the one given, the newest of a shelf to resume, or a new one."""
    if isinstance(out, Path):
        return out
    latest = out.latest() if resume else None
    if resume and latest is None:
        _LOG.warning("note: %s holds no run to resume; a new one starts", out.path)
    return latest or out.claim()


def _run_rest(
    run: _SuiteRun,
    broken: TargetFault | None,
    workers: Workers,
    retries: int,
    time_limit: float,
    progress: Progress,
) -> Result:
    """Run what is not done yet, and judge all repeats together."""
    suite, kept = run.suite, set(run.done)
    jobs = [(trial, repeat) for trial, repeat in run.jobs if (trial.id, repeat) not in kept]
    stopped = None
    if jobs and broken is not None:
        stopped = run.stop(Ending.FAULT, broken)
    elif jobs:
        stopped = _run_all(run, jobs, workers, retries, time_limit, progress)
    if stopped is not None:
        return stopped
    for trial in suite.trials:
        keys = [(trial.id, repeat) for repeat in range(trial.repeats)]
        together = judge_together([run.done[key] for key in keys], trial.limits)
        run.done.update(zip(keys, together, strict=True))
    progress(len(jobs), len(jobs), "done")
    return run.save(complete=True)


def _run_all(
    run: _SuiteRun,
    jobs: Sequence[tuple[Trial, int]],
    workers: Workers,
    retries: int,
    time_limit: float,
    progress: Progress,
) -> Result | None:
    """Run what is left to do; return the result as it was saved if that came to no end."""
    target, known = run.target, [(run.target, *job) for job in jobs]
    try:
        with (
            ahead(known, workers) as turned,
            Interruption() as interrupted,
            _Held(turned(target)) as own,
        ):
            run.target = own
            budget = StopCondition(interrupted, time_limit)
            for number, (trial, repeat) in enumerate(jobs):
                progress(number, len(jobs), f"{trial.id} ({repeat + 1}/{trial.repeats})")
                result, ending = _attempts(run, trial, repeat, budget, retries)
                run.done[trial.id, repeat] = result
                if ending is not Ending.COMPLETE or (budget() and number + 1 < len(jobs)):
                    run.provenance["stopped_by"] = budget.reason if budget() else ending.value
                    return run.save(complete=False)
                run.save(complete=False)
    except KeyboardInterrupt:
        # asked for twice: what is done stands
        run.provenance["stopped_by"] = "interrupted"
        return run.save(complete=False)
    except _NotSaved:
        raise
    except TargetFault as fault:
        return run.stop(_ending_of(fault), fault)
    return None


class _Held:
    """A target that is held; what crashes while it is taken or left is its fault."""

    def __init__(self, target: Target) -> None:
        self._target = target

    def __enter__(self) -> Target:
        with crashes_as_faults():
            return self._target.__enter__()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with crashes_as_faults():
            self._target.__exit__(kind, error, trace)


def _fault_of_check(suite: Suite, target: Target) -> TargetFault | None:
    """Return what went wrong with a target that was asked whether it can run the suite, if any did.

    Raises:
        EhaBenchError: it cannot.
    """
    for trial in suite.trials:
        if isinstance(trial.signal, FromRecording):
            trial.signal(np.zeros(1))  # says why it cannot be run
        try:
            with crashes_as_faults():
                reach = target.reach(trial.channel)
                check_reach(trial, reach, f"{trial.channel} of {target.identity.name} goes from")
                target.check(trial)
        except TargetFault as fault:
            return TargetFault(f"cannot run '{trial.id}': {fault}")
    return None


def _ending_of(fault: EhaBenchError) -> Ending:
    return Ending.SAFETY_STOP if isinstance(fault, SafetyStop) else Ending.FAULT


def _finished_runs(
    folder: ResultFolder, digests: Mapping[str, str]
) -> dict[tuple[str, int], TrialResult]:
    """Return what an earlier run of the same suite on the same target finished.

    Raises:
        InputError: it ran something else.
    """
    previous = folder.previous()
    if previous is None:
        return {}
    changed = [
        key.removesuffix("_sha256")
        for key, value in digests.items()
        if previous.provenance.get(key, "") != value
    ]
    if changed:
        raise InputError(
            f"holds a run of another {' and another '.join(changed)}, which cannot be resumed",
            where=Place(file=str(folder.path)),
            hint="leave out --resume to start a new run, or name that run's folder with --out",
        )
    finished = (Status.PASSED, Status.FAILED)
    return {
        (trial.id, trial.repeat): trial
        for trial in previous.trials
        if trial.status in finished and folder.holds(trial)
    }


def _attempts(
    run: _SuiteRun, trial: Trial, repeat: int, budget: StopCondition, retries: int
) -> tuple[TrialResult, Ending]:
    """Run a repeat, and again as long as only its infrastructure failed and tries are left."""
    notes: tuple[str, ...] = ()
    for left in range(retries, -1, -1):
        result, ending = _run_one(run, trial, repeat, budget)
        unjudged = ending is Ending.COMPLETE and result.status is Status.INCOMPLETE
        if not left or budget() or not (ending is Ending.INFRASTRUCTURE or unjudged):
            break
        notes += (f"run again: {result.reason}",)
        run.provenance["retries"] = str(int(run.provenance.get("retries", "0")) + 1)
        time.sleep(_RETRY_AFTER)
    return replace(result, notes=(*result.notes, *notes)), ending


def _run_one(
    run: _SuiteRun, trial: Trial, repeat: int, stopping: Stopping
) -> tuple[TrialResult, Ending]:
    started = time.time_ns()
    path = run.folder.recording(trial.id, repeat)
    metadata, attachments = _metadata(run, trial, repeat), _attachments(run, trial)
    outcome = _outcome(run.target, trial, repeat, stopping, Journal(path, metadata, attachments))
    if outcome.ending is Ending.INTERRUPTED and isinstance(stopping, StopCondition):
        outcome = replace(outcome, reason=stopping.reason)
    outcome = _kept_safe(outcome, trial)
    ending, reason = outcome.ending, outcome.reason
    relative = path.relative_to(run.folder.path).as_posix()
    metadata |= outcome.recording.metadata
    metadata |= {"ending": ending.value, "ending_reason": reason}
    recording = replace(
        outcome.recording,
        metadata=metadata,
        attachments=attachments,
        epoch_ns=outcome.recording.epoch_ns or started,
    )
    if len(recording):
        try:
            write_mcap(path, recording)
        except RecordingError as error:
            # the disk is full: what was written while the trial ran is what there is
            relative = relative if path.is_file() else ""
            reason = f"{reason}; {error.what}" if reason else f"the recording {error.what}"
            ending = Ending.FAULT if ending is Ending.COMPLETE else ending
    else:
        relative = ""
    if ending is not Ending.COMPLETE:
        digest = file_sha256(path) if relative else ""
        status, reason = _STATUS[ending], f"{ending.value}: {reason}"
        notes = tuple(filter(None, (loop_note(metadata),)))
        stopped = TrialResult(
            trial.id, repeat, status, relative, digest, reason=reason, notes=notes
        )
        return stopped, ending
    judged = judge(outcome.recording, trial, repeat, unsafe="")
    run.circumstances.add(outcome.recording)
    return replace(judged, recording=relative, sha256=file_sha256(path)), ending


def _outcome(
    target: Target, trial: Trial, repeat: int, stopping: Stopping, journal: Journal
) -> Outcome:
    """Run a repeat; a fault or a crash that the target lets out is how the run of it ended.

    Raises:
        EhaBenchError: the input was wrong after all.
    """
    try:
        with crashes_as_faults():
            target.keep_journal(journal)
        return checked_run(target, trial, repeat, stopping)
    except EhaBenchError as error:
        if error.exit_status == InputError.exit_status:
            raise
        # a fault or a crash in another process has come as a WorkError
        return Outcome(Recording(np.zeros(0), {}), _ending_of(error), str(error))


def _kept_safe(outcome: Outcome, trial: Trial) -> Outcome:
    """Return an outcome; as a safety stop where the target ran on beyond a safety limit."""
    if outcome.ending not in (Ending.COMPLETE, Ending.INTERRUPTED):
        return outcome
    broken = breach(outcome.recording, trial)
    if not broken:
        return outcome
    reason = f"{broken}, and the target ran on; let its run ask trial.violation(...) at every tick"
    return replace(outcome, ending=Ending.SAFETY_STOP, reason=reason)


def _metadata(run: _SuiteRun, trial: Trial, repeat: int) -> dict[str, str]:
    """Return what a recording says of its run, known before it begins."""
    return {
        "suite": run.suite.name,
        "trial": trial.id,
        "repeat": str(repeat),
        "seed": str(trial.seed + repeat),
        "target": run.target.identity.name,
        **run.provenance,
    }


def _attachments(run: _SuiteRun, trial: Trial) -> dict[str, bytes]:
    """Return the files that are needed to score a recording again, alone."""
    return {
        "suite.yaml": run.suite.text.encode(),
        "trial.json": trial.source.encode(),
        **run.target.identity.attachments,
    }
