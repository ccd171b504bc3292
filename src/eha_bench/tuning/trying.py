"""Tries candidates on machines; trials that no gain moves are run once a machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.workers import Workers
from eha_bench.metrics import score_limits
from eha_bench.plants.model import Model
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.evaluation import PointResult, figures_of_case, limits_of
from eha_bench.sweeps.probability import judged_only
from eha_bench.sweeps.remainder import with_remainder
from eha_bench.sweeps.space import Point, Space


@dataclass(frozen=True)
class Machine:
    """A machine that candidates are tried on: a model, and the number of its draw, -1 for none.

    The number chooses the noise of the sensors; `remainder` is what the model leaves unexplained.
    """

    number: int
    model: Model
    remainder: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Job:
    point: Point
    machine: Machine


@dataclass(frozen=True)
class _MachineRun:
    """Runs a space at a point on a machine; picklable."""

    space: Space

    def __call__(self, job: _Job) -> PointResult:
        case = self.space.at(job.point)
        simulator = case.simulator.varied(model=job.machine.model)
        simulator = with_remainder(simulator, job.machine.remainder)
        noise = max(job.machine.number, 0)
        return figures_of_case(replace(case, simulator=simulator), noise, scorer=score_limits)


def _never() -> bool:
    return False


@dataclass
class GainTrials:
    """Candidates over machines.

    Attributes:
        space: the gains, over the trials that have a limit. workers: where they are run.
        known: results of the trials that no gain of the space moves, by the machine's number.
    """

    space: Space
    workers: Workers
    known: dict[int, PointResult] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Set apart the trials that the gains move, and those that they do not."""
        case = judged_only(self.space.case)
        self.space = replace(self.space, case=case)
        modes = [factor.key for factor in self.space.factors]
        names = {
            trial.id: not case.simulator.imposes(trial)
            and any(key.startswith(f"{trial.mode.name}.") for key in modes)
            for trial in case.suite.trials
        }
        self._moved = _with_trials(case, {name for name, moved in names.items() if moved})
        self._still = _with_trials(case, {name for name, moved in names.items() if not moved})
        self._order = [names[limit.trial] for limit in limits_of(case.suite)]

    @property
    def moves(self) -> bool:
        """Whether any trial with a limit is run under a controller whose gains are varied."""
        return bool(self._moved.suite.trials)

    def margins(
        self,
        points: Sequence[Point],
        machines: Sequence[Machine],
        stop: Callable[[], bool] = _never,
    ) -> list[FloatArray]:
        """Return candidates' margins, each (machines, limits), in the suite's order.

        Args:
            points: the candidates. machines: that each is run on.
            stop: whether to stop; then only those that were done by then are returned.
        """
        rows = self.results(points, machines, stop)
        return [np.array([item.margins for item in row]) for row in rows]

    def results(
        self,
        points: Sequence[Point],
        machines: Sequence[Machine],
        stop: Callable[[], bool] = _never,
    ) -> list[list[PointResult]]:
        """Return candidates' results on every machine; arguments as of `margins`."""
        self._learn(machines)
        moving = replace(self.space, case=self._moved)
        jobs = [_Job(point, machine) for point in points for machine in machines]
        found = []
        with closing(self.workers.ordered(_MachineRun(moving), jobs)) as outcomes:
            for outcome in outcomes:
                found.append(outcome.get())
                if stop():
                    break
        size = len(machines)
        return [
            [
                self._joined(found[k * size + j], self.known[machine.number])
                for j, machine in enumerate(machines)
            ]
            for k in range(len(found) // size)
        ]

    def _learn(self, machines: Sequence[Machine]) -> None:
        """Run what the gains do not move, once on each machine."""
        new = [machine for machine in machines if machine.number not in self.known]
        still = Space(self._still, ())
        found = self.workers.map(_MachineRun(still), [_Job((), machine) for machine in new])
        self.known |= {machine.number: result for machine, result in zip(new, found, strict=True)}

    def _joined(self, moved: PointResult, still: PointResult) -> PointResult:
        both = {True: iter(moved.margins), False: iter(still.margins)}
        margins = tuple(next(both[name]) for name in self._order)
        ranked = ("passed", "failed", "incomplete", "fault")
        status = max(moved.status, still.status, key=lambda item: ranked.index(item.value))
        return PointResult(
            status,
            margins,
            {**moved.values, **still.values},
            {**moved.units, **still.units},
            moved.reason or still.reason,
        )


def _with_trials(case: Case, names: set[str]) -> Case:
    trials = tuple(trial for trial in case.suite.trials if trial.id in names)
    return replace(case, suite=replace(case.suite, trials=trials))
