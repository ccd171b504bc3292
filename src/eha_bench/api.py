"""The Python face of running and scoring: the same as the commands, with their reports."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from eha_bench.bench.folder import REPORTS, RESULT
from eha_bench.bench.judging import RECORDINGS, score_recordings
from eha_bench.bench.run import run_suite
from eha_bench.bench.store import SuiteFolder
from eha_bench.control.controller_file import load_controllers
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError, InputError, Place, TargetFault
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.interruption import signals_raised_after
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.progress import Progress, silent
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.shipped import find
from eha_bench.core.trial import Trial
from eha_bench.core.workers import workers_from
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.diagnose import diagnose as close_the_loop
from eha_bench.diagnosis.outcome.diagnosis import WRITTEN as DIAGNOSIS_FILES
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.experiment.files import dataset_path, suite_path, write_proposal
from eha_bench.experiment.hypothesis import read_question
from eha_bench.experiment.proposal import Proposal
from eha_bench.experiment.propose import ASKED, WITHIN, propose
from eha_bench.posterior.file import beside, read_posterior
from eha_bench.recordings import read
from eha_bench.report import append_step_summary, markdown_summary, write_junit, write_report
from eha_bench.report.diagnosis_report import write_diagnosis_report
from eha_bench.report.experiment_report import write_experiment_report
from eha_bench.report.page import Fact
from eha_bench.report.probability_page import PAGE, write_probability_page
from eha_bench.report.sweep_page import POINTS, write_sweep_page
from eha_bench.report.tuning_page import write_tuning_page
from eha_bench.suites import Suite, load_suite
from eha_bench.sweeps.case import case_of
from eha_bench.sweeps.conditions import ANY, conditions_of
from eha_bench.sweeps.probability import SUMMARY, Probability, judged_only
from eha_bench.sweeps.probability import probability as passing
from eha_bench.sweeps.sweep import WRITTEN as SWEEP_FILES
from eha_bench.sweeps.sweep import SweepResult, prepared_sweep, run_sweep
from eha_bench.sweeps.sweep_file import load_sweep
from eha_bench.targets.crash import crashes_as_faults
from eha_bench.targets.resolve import open_target
from eha_bench.targets.target import Target
from eha_bench.tuning.aim import Robust
from eha_bench.tuning.files import WRITTEN as TUNED_FILES
from eha_bench.tuning.files import write_tuned
from eha_bench.tuning.tune import SearchEffort, Tuned, gains_space
from eha_bench.tuning.tune import tune as find_gains
from eha_bench.tuning.vary_file import load_vary

PROBABILITY_FILES = (SUMMARY, PAGE)
Loader = Callable[[], Recording]
Given: TypeAlias = str | Path | Mapping[str, Any]
"""A file, the name of a shipped one, or a dict of what the file would hold."""

_LOG = logging.getLogger("eha_bench")


@signals_raised_after()
def run(
    suite: Given,
    target: Given | None = None,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    retries: int = 0,
    time_limit: float = math.inf,
    workers: str | int | None = None,
    progress: Progress = silent,
) -> Result:
    """Run a suite on a target; write recordings, result.json and the reports.

    Args:
        suite: path of a suite.yaml, name of a shipped suite (`paper`), or a dict of what a
            suite.yaml would hold.
        target: `simulator`, a target.yaml or a model.yaml, also by a shipped name or as a dict; the
            suite's own target if None.
        out: result folder, an earlier run in it is set aside; `reports/<suite>/<time>` if None.
        resume: do only what an earlier, interrupted run of the same left undone: the one in `out`,
            or the suite's latest.
        retries: how often a trial is run again whose infrastructure failed (not its limits).
        time_limit: s after which the run stops.
        workers: number of processes, dask://host:port or ray://host:port, for simulated targets.
        progress: called at the start of every trial.

    Raises:
        EhaBenchError: bad input, or the folder cannot be used.
    """
    loaded = load_suite(suite)
    result = run_suite(
        loaded, target_for(loaded, target), Path(out) if out else SuiteFolder(loaded.name),
        resume=resume, retries=retries, time_limit=time_limit, workers=workers_from(workers),
        progress=progress,
    )  # fmt: skip
    return _with_reports(result, loaded)


def _with_reports(result: Result, loaded: Suite) -> Result:
    """Write the reports of a run next to its result, and return that.

    Raises:
        EhaBenchError: they cannot be written.
    """
    folder = result.folder
    assert folder is not None
    trials = {trial.id: trial for trial in loaded.trials}
    by_repeat = {(item.id, item.repeat): trials[item.id] for item in result.trials}
    try:
        write_reports(folder, result, by_repeat, folder)
    except OSError as error:
        missing = f"the report cannot be written ({error.strerror})"
        if result.status is not Status.FAULT:
            raise InputError(
                missing,
                where=Place(file=str(folder)),
                hint="make room, then 'eha-bench run --resume' writes it; the recordings are there",
            ) from error
        # a full disk must not hide why the rig was stopped
        reason = next(item.reason for item in result.trials if item.status is Status.FAULT)
        raise TargetFault(f"{reason}; {missing}") from error
    return result


@signals_raised_after()
def sweep(
    suite: Given,
    over: Given,
    target: Given | None = None,
    out: str | Path | None = None,
    *,
    resume: bool = False,
    workers: str | int | None = None,
    progress: Progress = silent,
) -> SweepResult:
    """Run a suite over gains, parameters, effects or keys of trials; write table and page.

    Args:
        suite, target: as for `run`; the target is a simulator.
        over: sweep.yaml, or a dict of what it would hold.
        out: folder that gets points.parquet, sweep.json and sweep.html.
        resume: do only what an earlier, interrupted sweep of the same left undone.
        workers: number of processes, dask://host:port or ray://host:port.
        progress: called after every point.

    Raises:
        EhaBenchError: bad input, or the folder cannot be used.
    """
    with noting_inputs() as read_files:
        loaded = load_suite(suite)
        case = case_of(loaded, target_for(loaded, target))
        file = load_sweep(over)
    shelf = Path(out) if out else SuiteFolder(f"{loaded.name}-sweep")
    if isinstance(shelf, Path):
        spare_inputs((shelf / name for name in SWEEP_FILES), read_files)
    found = run_sweep(
        case, file, shelf,
        resume=resume, workers=workers_from(workers), progress=progress,
    )  # fmt: skip
    words = ["eha-bench", "sweep", str(suite), "--over", str(over)]
    words += ["--target", str(target)] if target else []
    write_sweep_page(found, (*words, "--out", str(found.folder)))
    return found


def probability(
    suite: Given,
    posterior: str | Path,
    target: Given | None = None,
    out: str | Path | None = None,
    *,
    conditions: Given | None = None,
    draws: int = 200,
    seed: int = 0,
    workers: str | int | None = None,
    progress: Progress = silent,
) -> Probability:
    """Return how likely a suite passes over what recordings left unknown of the machine.

    Args:
        suite, target: as for `run`; the target is a simulator with the model that was fitted.
        posterior: diagnosis.json or calibration.json, or the folder of one.
        out: folder that gets probability.json and probability.html; nothing is written if None.
        conditions: sweep.yaml, or a dict of what it would hold, with ranges of the model's
            parameters that are also drawn: oil between cold and hot, a load.
        draws: machines that are drawn. seed: of the draws.
        workers: number of processes, dask://host:port or ray://host:port.
        progress: called after every draw.

    Raises:
        EhaBenchError: bad input, or the posterior of another model.
    """
    with noting_inputs() as read_files:
        loaded = load_suite(suite)
        case = case_of(loaded, target_for(loaded, target))
        known = read_posterior(Path(posterior), case.simulator.model)
        met = conditions_of(case, load_sweep(conditions)) if conditions is not None else ANY
    if out is not None:
        folder = writable(Path(out))
        spare_inputs((folder / name for name in PROBABILITY_FILES), read_files)
    with signals_raised_after(kept=out is not None):
        found = passing(
            case, known, draws,
            seed=seed, conditions=met, workers=workers_from(workers), progress=progress,
        )  # fmt: skip
        if out is not None:
            folder.mkdir(parents=True, exist_ok=True)
            found.write(folder)
            facts = (
                Fact("Posterior", str(posterior)),
                Fact("Draws", str(draws)),
                Fact("Conditions", "; ".join(item.about for item in met.factors) or "as fitted"),
            )
            identity = case.simulator.identity.name
            write_probability_page(found, folder, loaded.name, identity, facts)
    return found


@signals_raised_after()
def tune(  # noqa: PLR0913 - as the options of the command
    suite: Given,
    model: Given,
    vary: Given,
    out: str | Path,
    *,
    controller: str | Path | None = None,
    posterior: str | Path | None = None,
    conditions: Given | None = None,
    draws: int = 200,
    candidates: int = 240,
    robust: str | None = None,
    seed: int = 0,
    workers: str | int | None = None,
    progress: Progress = silent,
) -> Tuned:
    """Find the gains that pass with the highest probability, then with most margin.

    Args:
        suite: as for `run`. model: model.yaml, or a simulator's target.yaml.
        vary: vary.yaml, or a dict of what it would hold.
        out: folder that gets tuned.yaml (a controller), target.yaml, tuning.json and tuning.html.
        controller: where to begin; the suite's or the target's own if None.
        posterior: diagnosis.json or calibration.json; the one next to the model that wrote it if
            None, and no probability where there is none.
        conditions: as for `probability`.
        draws: machines that the best is proven on.
        candidates: gains that are tried; more where none passes.
        robust: `worst` or `cvar` in place of P(pass). seed: of search and draws.
        workers: number of processes, dask://host:port or ray://host:port.
        progress: called after every generation.

    Raises:
        EhaBenchError: bad input, or the posterior of another model.
    """
    folder = writable(Path(out))
    if robust is not None and robust not in set(Robust):
        raise InputError(f"--robust '{robust}' is not known", hint=f"known: {', '.join(Robust)}")
    with noting_inputs() as read_files:
        loaded = load_suite(suite)
        case = case_of(loaded, open_target(model, loaded.file))
        if controller is not None:
            own = load_controllers(find(controller, "controllers"))
            case = replace(case, simulator=case.simulator.varied(controllers=own))
        file = load_vary(vary)
        gains_space(case, file)
        at = Path(posterior) if posterior is not None else None
        if at is None and not isinstance(model, Mapping) and Path(model).is_file():
            at = beside(Path(model))
        known = None if at is None else read_posterior(at, case.simulator.model)
        met = conditions_of(case, load_sweep(conditions)) if conditions is not None else ANY
    spare_inputs((folder / name for name in TUNED_FILES), read_files)
    found = find_gains(
        case, file, known,
        effort=SearchEffort(candidates, min(draws, SearchEffort.few), draws, seed),
        aim=Robust(robust).aim if robust else None,
        conditions=met,
        workers=workers_from(workers), progress=progress,
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    write_tuned(found, folder)
    facts = (
        Fact("Controller before", case.simulator.controllers.name),
        Fact("Posterior", str(at) if at else "none"),
        Fact("Seed", str(seed)),
    )
    write_tuning_page(found, folder, facts)
    return found


def check_posterior(
    suite: Given,
    posterior: str | Path,
    target: Given | None = None,
    conditions: Given | None = None,
) -> None:
    """Raise an InputError where P(pass) of a suite cannot be computed, before anything is run."""
    loaded = load_suite(suite)
    case = judged_only(case_of(loaded, target_for(loaded, target)))
    if conditions is not None:
        conditions_of(case, load_sweep(conditions))
    read_posterior(Path(posterior), case.simulator.model)


@signals_raised_after()
def run_point(
    suite: Given,
    over: Given,
    point: int,
    target: Given | None = None,
    out: str | Path | None = None,
    *,
    progress: Progress = silent,
) -> Result:
    """Run one point of a sweep as `run` would, into `points/<point>` of the sweep's folder.

    Raises:
        EhaBenchError: bad input, or the sweep has no such point.
    """
    loaded = load_suite(suite)
    file = load_sweep(over)
    space, points = prepared_sweep(case_of(loaded, target_for(loaded, target)), file)
    if point >= len(points):
        raise InputError(
            f"the sweep has no point {point}",
            where=Place(file=str(file.path)),
            hint=f"its points are 0 to {len(points) - 1}",
        )
    shelf = SuiteFolder(f"{loaded.name}-sweep")
    folder = Path(out) if out else (shelf.latest() or shelf.claim())
    case = space.at(points[point])
    result = run_suite(case.suite, case.simulator, folder / POINTS / str(point), progress=progress)
    return _with_reports(result, case.suite)


def preview(suite: Given, target: Given | None = None) -> dict[str, tuple[str, ...]]:
    """Return what a run would do to its target, lines by trial id; nothing is opened or sent.

    Raises:
        EhaBenchError: bad input, or the target cannot run the suite.
    """
    loaded = load_suite(suite)
    opened = target_for(loaded, target)
    with crashes_as_faults():
        for trial in loaded.trials:
            opened.check(trial)
        return {trial.id: opened.preview(trial) for trial in loaded.trials}


def target_for(suite: Suite, target: Given | None) -> Target:
    """Return the target that a suite is run on: the one given, the suite's own, or the simulator.

    Raises:
        EhaBenchError: there is no such target, or its file is wrong.
    """
    return open_target(target or suite.file("target") or "simulator", suite.file)


def score_files(
    recordings: Sequence[str | Path],
    suite: Given | None = None,
    channels: str | Path | None = None,
    out: str | Path | None = None,
    *,
    trial: str | None = None,
    progress: Progress = silent,
) -> Result:
    """Score recordings made earlier or elsewhere; write result.json and the reports into `out`.

    In a result that is written, recordings are named relative to its folder, as those of a run are.

    Raises:
        EhaBenchError: a recording cannot be read, or belongs to no trial; `out` cannot be used.
    """
    folder = None if out is None else _for_scores(Path(out))
    with noting_inputs() as read_files:
        loaded = load_suite(suite) if suite else None
    map_file = Path(channels) if channels else None
    paths = [Path(item) for item in recordings]
    if folder is not None:
        written = (folder / name for name in (RESULT, *REPORTS))
        spare_inputs(written, (*paths, map_file, *read_files))
    result, trials = score_recordings(
        paths, suite=loaded, channels=map_file, trial=trial, progress=progress
    )
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        result = replace(
            result, trials=tuple(replace(t, recording=_from(folder, t)) for t in result.trials)
        )
        result.write(folder / RESULT)
        write_reports(folder, result, trials, folder, channels=map_file)
        result = replace(result, folder=folder)
    return result


def _for_scores(folder: Path) -> Path:
    """Return a folder that scores may be written into: not where a run keeps its own result."""
    file = writable(folder) / RESULT
    try:
        ran = file.is_file() and Result.read(file).target != RECORDINGS
    except EhaBenchError:
        ran = False  # nothing that could be read is lost
    if ran:
        raise InputError(
            "holds the result of a run, which the scores would replace",
            where=Place(file=str(folder)),
            hint="name another folder with --out",
        )
    return folder


def _from(folder: Path, item: TrialResult) -> str:
    """Return where a scored recording is, seen from the folder of the result."""
    path = Path(item.recording).resolve()
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return str(path)


def write_reports(
    folder: Path,
    result: Result,
    trials: dict[tuple[str, int], Trial],
    base: Path,
    *,
    channels: Path | None = None,
) -> Path:
    """Write report.html, junit.xml and summary.md; return the report's path."""
    loaders = {
        (item.id, item.repeat): _loader(base, item, channels)
        for item in result.trials
        if item.recording
    }
    write_junit(folder / "junit.xml", result)
    summary = markdown_summary(result)
    write_text(folder / "summary.md", summary)
    by_id = {trial_id: trial for (trial_id, _), trial in trials.items()}
    report = write_report(folder, result, loaders, by_id)
    tell_step_summary(summary)
    return report


def tell_step_summary(summary: str) -> None:
    """Append to GitHub's step summary; a failure to do so is a note and no verdict."""
    try:
        append_step_summary(summary)
    except InputError as error:
        _LOG.warning("note: %s", error)


def _loader(base: Path, item: TrialResult, channels: Path | None) -> Loader:
    path = base / item.recording
    return lambda: read(path, channels=channels)


def diagnose(
    dataset: Dataset | Given,
    out: str | Path | None = None,
    progress: Callable[[str, float], None] | None = None,
    *,
    workers: str | int | None = None,
) -> Diagnosis:
    """Close the loop: residual, cause, revised model, errors before and after.

    Ctrl-C (or SIGTERM) ends the search and keeps what was found until then (`complete` is False);
    once that is in `out`, the signal is raised again, so that it ends your program as well. Without
    `out`, Ctrl-C returns what was found: look at `complete` before you go on.

    Args:
        dataset: dataset.yaml, a dict of what it would hold, or as loaded.
        out: folder that gets diagnosis.html, diagnosis.json, revised.yaml and recalibrated.yaml.
        progress: called with the stage and the fraction of it done.
        workers: number of processes, dask://host:port or ray://host:port, to fit candidates on;
            threads of this process if None. The result is the same.

    Raises:
        InputError: a file is wrong or missing, or nothing can be compared.
        WorkError: a worker could not do what it was given.
    """
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
    tell = progress or (lambda _stage, _fraction: None)
    with signals_raised_after(kept=out is not None):
        found = close_the_loop(loaded, out, tell, workers_from(workers))
        if out is not None:
            source = Path(loaded.source)
            name = f"{source.resolve().parent.name}/{source.name}" if loaded.source else "dataset"
            write_diagnosis_report(Path(out), found, name, loaded.model)
    return found


def next_experiment(
    diagnosis: str | Path,
    out: str | Path | None = None,
    *,
    budget: float = 30.0,
    safety: str | Path | None = None,
    probability: float = ASKED,
    within: float = WITHIN,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Proposal:
    """Find the cheapest permitted experiment that separates what a diagnosis leaves open.

    Args:
        diagnosis: diagnosis.json, or the folder it is in.
        out: the suite to write; next to it a dataset that takes its recordings (`-dataset.yaml`),
            a page and the figures as JSON. Nothing is written if None.
        budget: bench time allowed, s.
        safety: target.yaml of a drive, or a suite, whose limits hold; None: nothing goes beyond
            what the recordings have been to.
        probability: of naming the right rival that is asked for.
        within: half of a 95 % interval, as a share of the parameter, that is asked for where
            parameters are what is open.
        seed: of all draws. progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, or the model has no command.
    """
    path = None if out is None else suite_path(out)
    with noting_inputs() as read_files:
        question = read_question(diagnosis)
    if path is not None:
        written = (path, dataset_path(path), path.with_suffix(".json"), path.with_suffix(".html"))
        own = (question.source.parent / name for name in DIAGNOSIS_FILES)
        files = (*read_files, *own, question.covered.dataset or None, safety)
        spare_inputs(written, files, "name another file with --out")
    tell = progress or (lambda _stage, _fraction: None)
    found = propose(
        question, budget=budget, safety=safety, probability=probability, within=within, seed=seed,
        progress=tell,
    )  # fmt: skip
    if path is not None:
        write_proposal(found, path)
        write_experiment_report(path.with_suffix(".html"), found, path.name)
    return found
