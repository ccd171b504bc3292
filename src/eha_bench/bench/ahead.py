"""Targets that run their trials ahead, several at a time: simulations wait for nothing."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from types import TracebackType
from typing import Self

from eha_bench.core.errors import InputError
from eha_bench.core.limit import Bounds
from eha_bench.core.trial import Trial
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.core.workers import ItemOutcome as Done
from eha_bench.targets.checked_run import checked_run
from eha_bench.targets.target import Identity, Outcome, Stopping, Target, never

_GLANCE = 0.2
"""How often it is looked whether a stop was asked for, s."""
_GRACE = 3.0
"""Time for an outcome after a stop was asked for, s."""

Job = tuple[Target, Trial, int]


class PendingOutcomes:
    """The outcomes of known jobs in their order, computed by workers while others are scored."""

    def __init__(self, jobs: Sequence[Job], workers: Workers) -> None:
        """Prepare; nothing runs before the first outcome is asked for.

        Raises:
            InputError: a target can run one trial at a time only.
        """
        for target in {id(target): target for target, _, _ in jobs}.values():
            if not target.concurrent:
                raise InputError(
                    f"{target.identity.name} runs one trial at a time", hint="leave out --workers"
                )
        self._jobs = list(jobs)
        self._workers = workers
        self._outcomes: Generator[Done[Outcome], None, None] | None = None

    def starts_with(self, target: Target, trial: Trial, repeat: int) -> bool:
        """Whether this job is the next one."""
        if not self._jobs:
            return False
        own, first, number = self._jobs[0]
        asked = (trial.id, trial.seed, repeat)
        return own is target and (first.id, first.seed, number) == asked

    def take(self, stopping: Stopping) -> Outcome:
        """Return the outcome of the next job, which may be there already.

        Raises:
            WorkError: it could not be run anywhere.
            KeyboardInterrupt: a stop was asked for, and no worker answered.
        """
        if self._outcomes is None:
            self._outcomes = self._workers.ordered(_run, list(self._jobs))
        self._jobs.pop(0)
        with _interrupt_on_stop(stopping):
            return next(self._outcomes).get()

    def close(self) -> None:
        """Drop what is still running."""
        if self._outcomes is not None:
            self._outcomes.close()


class PrecomputedTarget(Target):
    """A target whose outcomes are those that come; a job out of turn (a retry) is run here."""

    def __init__(self, target: Target, coming: PendingOutcomes) -> None:
        self._target = target
        self._coming = coming

    @property
    def identity(self) -> Identity:
        """That of the target."""
        return self._target.identity

    def reach(self, channel: str) -> Bounds:
        """Ask the target."""
        return self._target.reach(channel)

    def check(self, trial: Trial) -> None:
        """Ask the target."""
        self._target.check(trial)

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Return the outcome of a job.

        Raises:
            WorkError: it could not be run anywhere.
        """
        if self._coming.starts_with(self._target, trial, repeat):
            return self._coming.take(stopping)
        return checked_run(self._target, trial, repeat, stopping)

    def __enter__(self) -> Self:
        """Take hold of the target."""
        self._target.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the target."""
        self._target.__exit__(kind, error, trace)


@contextmanager
def _interrupt_on_stop(stopping: Stopping) -> Iterator[None]:
    """Interrupt a wait that goes on although a stop was asked for: the worker may be gone.

    It is the second Ctrl-C, which a person at the terminal would send.
    """
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_GLANCE):
            if stopping() and not over.wait(_GRACE):
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


@contextmanager
def ahead(jobs: Sequence[Job], workers: Workers) -> Iterator[Callable[[Target], Target]]:
    """Yield a function that makes a target run the jobs ahead; `IN_PROCESS` changes nothing.

    Raises:
        InputError: a target can run one trial at a time only.
    """
    if workers == IN_PROCESS:
        yield lambda target: target
        return
    with closing(PendingOutcomes(jobs, workers)) as coming:
        yield lambda target: PrecomputedTarget(target, coming)


def _run(job: Job) -> Outcome:
    target, trial, repeat = job
    return checked_run(target, trial, repeat, never)
