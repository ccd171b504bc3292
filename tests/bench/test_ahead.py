"""Trials run ahead by workers are the trials of one process."""

import json
import pickle
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eha_bench
from eha_bench.bench.ahead import PendingOutcomes, PrecomputedTarget
from eha_bench.core.errors import InputError
from eha_bench.core.interruption import Interruption
from eha_bench.core.trial import Trial
from eha_bench.core.workers import InProcess, Workers
from eha_bench.core.workers import ItemOutcome as Done
from eha_bench.suites import load_suite
from eha_bench.targets.resolve import open_target
from eha_bench.targets.target import Identity, Outcome, Stopping, Target, never

SUITE = """\
name: small
defaults: {duration: 60 ms}
trials:
  - id: pressure
    mode: pressure
    repeats: 2
    setup: {piston: locked}
    signal: {kind: step, final: 5 MPa, at: 5 ms}
    accept: {response_time: < 1 s}
  - id: current
    mode: current
    signal: {kind: sine, amplitude: 3 A, frequency: 20 Hz}
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    path = tmp_path / "suite.yaml"
    path.write_text(SUITE)
    return path


def test_what_comes_ahead_is_what_a_run_gives(suite: Path) -> None:
    target = open_target("simulator")
    jobs = [(trial, n) for trial in load_suite(suite).trials for n in range(trial.repeats)]
    away = pickle.loads(pickle.dumps(target))
    with PrecomputedTarget(
        target, PendingOutcomes([(target, *job) for job in jobs], InProcess())
    ) as ahead:
        found = [ahead.run(*job) for job in jobs]
        again = ahead.run(*jobs[1])  # out of turn
    assert ahead.identity == target.identity == away.identity
    # outcomes travel, too
    found = pickle.loads(pickle.dumps(found))
    for (trial, repeat), outcome in zip([*jobs, jobs[1]], [*found, again], strict=True):
        for other in (target.run(trial, repeat), away.run(trial, repeat)):
            for name, values in other.recording.values.items():
                np.testing.assert_array_equal(outcome.recording[name], values)
            assert outcome.recording.metadata == other.recording.metadata


class Drive(Target):
    """Something that there is one of."""

    @property
    def identity(self) -> Identity:
        return Identity("can:drive")

    def check(self, trial: Trial) -> None:
        pass

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        raise AssertionError


def test_a_drive_is_not_run_by_several(suite: Path) -> None:
    jobs = [(Drive(), load_suite(suite).trials[0], 0)]
    with pytest.raises(InputError, match="can:drive runs one trial at a time; leave out --workers"):
        PendingOutcomes(jobs, InProcess())


@pytest.mark.slow
def test_a_suite_on_processes_scores_the_same(suite: Path, tmp_path: Path) -> None:
    one = eha_bench.run(suite, out=tmp_path / "one")
    two = eha_bench.run(suite, out=tmp_path / "two", workers=2)
    assert [item.scores for item in one.trials] == [item.scores for item in two.trials]
    for item in one.trials:
        first, second = (eha_bench.read(tmp_path / n / item.recording) for n in ("one", "two"))
        for name in first:
            np.testing.assert_array_equal(first[name], second[name])


@pytest.mark.slow
def test_pairs_on_processes_are_those_of_one(suite: Path, tmp_path: Path) -> None:
    model = tmp_path / "stiff.yaml"
    model.write_text("model: eha_knee\nparameters: {bulk_modulus: 1.2 GPa}\n")
    found = []
    for name, workers in (("one", None), ("two", 2)):
        done = eha_bench.ab(suite, "simulator", model, tmp_path / name, repeats=8, workers=workers)
        assert done.comparison is not None
        found.append((done.run.pairs, json.loads(done.comparison.to_json())["metrics"]))
    assert found[0] == found[1]


class Frozen(Workers):
    """Workers that never answer."""

    @property
    def count(self) -> int:
        return 1

    def _each(
        self, function: Callable[[Any], Any], numbered: Sequence[tuple[int, Any]]
    ) -> Generator[Done[Any], None, None]:
        while True:
            time.sleep(0.01)
        yield Done(0)


def test_a_stop_is_not_held_up_by_workers_that_never_answer(
    suite: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eha_bench.bench.ahead._GRACE", 0.2)
    target = open_target("simulator")
    trial = load_suite(suite).trials[0]
    # a time limit has come: nobody has pressed Ctrl-C at all
    with (
        Interruption(),
        PrecomputedTarget(target, PendingOutcomes([(target, trial, 0)], Frozen())) as ahead,
        pytest.raises(KeyboardInterrupt),
    ):
        ahead.run(trial, 0, lambda: True)
