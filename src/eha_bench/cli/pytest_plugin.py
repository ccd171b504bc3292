"""A pytest plug-in: `pytest --eha-suite suites/smoke.yaml`, one test an acceptance limit.

The suite is run once, when the first of its tests is; only trials are run of which a test was
selected (`-k`). Everything heavy is imported there: pytest loads this module in every project.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from eha_bench.core.limit import AcceptanceLimit
    from eha_bench.core.result import Result, TrialResult
    from eha_bench.core.trial import Trial
    from eha_bench.suites import Suite


class LimitMissed(Exception):
    """An acceptance limit was not kept, or it could not be judged."""


class RunStopped(Exception):
    """A run did not finish, so the trial's limits cannot be judged."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--eha-suite`, `--eha-target` and `--eha-out`."""
    group = parser.getgroup("eha-bench", "acceptance suites of eha-bench")
    group.addoption(
        "--eha-suite", action="append", default=[], metavar="SUITE",
        help="run this suite.yaml, one test an acceptance limit (may be given several times)",
    )  # fmt: skip
    group.addoption(
        "--eha-target", default=None, metavar="TARGET",
        help="simulator, a target.yaml or a model.yaml (default: the suite's own)",
    )  # fmt: skip
    group.addoption(
        "--eha-out", default="reports", metavar="DIR",
        help="folder for the result folders of the suites (default: reports)",
    )  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    """Collect the suites; nothing but them where no test files are named."""
    suites = [str(path) for path in config.getoption("--eha-suite")]
    if not suites:
        return
    named = config.args if config.args_source is pytest.Config.ArgsSource.ARGS else []
    config.args = list(dict.fromkeys((*named, *suites)))


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> SuiteCollector | None:
    """Take the files that `--eha-suite` names."""
    wanted = parent.config.getoption("--eha-suite")
    if any(file_path == Path(path).resolve() for path in wanted):
        node: SuiteCollector = SuiteCollector.from_parent(parent, path=file_path)
        return node
    return None


class SuiteCollector(pytest.File):
    """A suite: collects a test for each limit, and runs it when the first of them runs."""

    def collect(self) -> Iterator[LimitItem]:
        """Yield a test for every limit of every trial."""
        for trial in self.suite.trials:
            for limit in trial.limits:
                channel = "" if limit.channel == trial.channel else f" of {limit.channel or 'run'}"
                name = f"{trial.id}: {limit.metric}{channel} {limit.text}"
                yield LimitItem.from_parent(self, name=name, trial=trial, limit=limit)

    @cached_property
    def suite(self) -> Suite:
        """The suite.

        Raises:
            CollectError: it is not valid.
        """
        from eha_bench.core.errors import EhaBenchError
        from eha_bench.suites import load_suite

        try:
            return load_suite(self.path)
        except EhaBenchError as error:
            raise self.CollectError(str(error)) from error

    @property
    def folder(self) -> Path:
        """Where the result is written; each worker of pytest-xdist has its own folder."""
        worker = os.environ.get("PYTEST_XDIST_WORKER", "")
        name = f"{self.suite.name}-{worker}" if worker else self.suite.name
        return Path(self.config.getoption("--eha-out")) / name

    @cached_property
    def outcome(self) -> Result | Exception:
        """The result of the trials of which a test was selected, or what kept them from running."""
        from eha_bench.comparison_api import run_trials
        from eha_bench.core.errors import EhaBenchError

        items = [item for item in self.session.items if isinstance(item, LimitItem)]
        trials = {item.trial.id for item in items if item.parent is self}
        target = self.config.getoption("--eha-target")
        try:
            return run_trials(self.suite, trials, target, self.folder)
        except EhaBenchError as error:
            return RunStopped(str(error))


class LimitItem(pytest.Item):
    """The test of one acceptance limit, over all repeats of its trial."""

    parent: SuiteCollector

    def __init__(self, *, trial: Trial, limit: AcceptanceLimit, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.trial = trial
        self.limit = limit

    def runtest(self) -> None:
        """Hold the scores of all repeats against the limit."""
        from eha_bench.core.result import Status

        outcome = self.parent.outcome
        if isinstance(outcome, Exception):
            raise outcome
        self.add_report_section("call", "eha-bench", str(self.parent.folder / "report.html"))
        runs = [run for run in outcome.trials if run.id == self.trial.id]
        stopped = [run for run in runs if run.status in (Status.FAULT, Status.INCOMPLETE)]
        if outcome.provenance.get("stopped_by", "") == "interrupted":
            pytest.exit("the suite was interrupted")
        if stopped or not runs:
            why = stopped[0].reason if stopped else "an earlier trial stopped the run"
            raise RunStopped(f"{self.trial.id} did not finish: {why}")
        missed = [line for run in runs for line in self._misses(run)]
        if missed:
            raise LimitMissed("\n".join(missed))

    def _misses(self, run: TrialResult) -> Iterator[str]:
        limit = self.limit
        for score in run.scores:
            if (score.metric, score.channel, score.limit) != (
                limit.metric, limit.channel, limit.text,
            ):  # fmt: skip
                continue
            self.user_properties.append((f"{limit.metric}[{run.repeat}]", f"{score.value:.6g}"))
            if score.status.rejects:
                value = f"{score.value:.6g} {score.unit}".strip()
                reason = score.reason
                found = reason if score.status.value == "not_scored" else value
                yield (
                    f"repeat {run.repeat}: {limit.metric} {score.status.value.replace('_', ' ')}: "
                    f"{found} (limit {limit.text})"
                )
            return
        yield f"repeat {run.repeat}: {limit.metric} was not scored"

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None
    ) -> str | Any:
        """Return what was missed, without a traceback: no code is at fault."""
        if isinstance(excinfo.value, (LimitMissed, RunStopped)):
            return f"{excinfo.value}\nreport: {self.parent.folder / 'report.html'}"
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return file and name for the summary."""
        return self.path, None, self.name
