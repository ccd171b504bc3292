"""A target that runs its trials ahead, several at a time: simulations wait for nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from types import TracebackType
from typing import Self

from eha_bench.core.errors import InputError
from eha_bench.core.trial import Trial
from eha_bench.core.workers import Outcome as Done
from eha_bench.core.workers import Workers
from eha_bench.targets.target import Identity, Outcome, Stopping, Target, never

Job = tuple[Trial, int]


class Ahead(Target):
    """The outcomes of known jobs in their order, computed by workers while others are scored.

    A job that comes out of turn (a retry) is run here.
    """

    def __init__(self, target: Target, jobs: Sequence[Job], workers: Workers) -> None:
        """Prepare; nothing runs before the first outcome is asked for.

        Raises:
            InputError: the target can run one trial at a time only.
        """
        if not target.concurrent:
            raise InputError(
                f"{target.identity.name} runs one trial at a time", hint="leave out --workers"
            )
        self._target = target
        self._expected = [(trial.id, repeat) for trial, repeat in jobs]
        self._jobs = [(target, trial, repeat) for trial, repeat in jobs]
        self._workers = workers
        self._coming: Iterator[Done[Outcome]] | None = None

    @property
    def identity(self) -> Identity:
        """That of the target."""
        return self._target.identity

    def check(self, trial: Trial) -> None:
        """Ask the target."""
        self._target.check(trial)

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Return the outcome of the next job, which may be there already.

        Raises:
            WorkError: it could not be run anywhere.
        """
        if not self._expected or self._expected[0] != (trial.id, repeat):
            return self._target.run(trial, repeat, stopping)
        self._expected.pop(0)
        if self._coming is None:
            self._coming = self._workers.ordered(_run, self._jobs)
        return next(self._coming).get()

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
        """Drop what is still running, and leave the target."""
        if self._coming is not None:
            with closing(self._coming):  # type: ignore[type-var]  # it is a generator
                pass
        self._target.__exit__(kind, error, trace)


def _run(job: tuple[Target, Trial, int]) -> Outcome:
    target, trial, repeat = job
    return target.run(trial, repeat)
