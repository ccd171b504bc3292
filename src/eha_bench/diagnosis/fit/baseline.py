"""The declared model, calibrated on all training runs: where every diagnosis starts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place, RecordingError
from eha_bench.core.interruption import checkpoints
from eha_bench.core.note import Note, merged_notes
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.beyond_ends import beyond_ends
from eha_bench.diagnosis.data.colour import FEWEST
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.data.gate import admit, restful_channels
from eha_bench.diagnosis.data.measured import Measured, notes_of_runs, pooled_noise
from eha_bench.diagnosis.data.onset import topics_from_onset
from eha_bench.diagnosis.data.quiet import quiet_stretches, with_colours, with_noise_colour
from eha_bench.diagnosis.data.stamps import scatter_notes, with_scatter
from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.unused_inputs import unused_inputs
from eha_bench.diagnosis.data.windows import (
    Window,
    cut_windows,
    from_another_angle,
    is_whole,
    steps_at_first,
    window_at,
)
from eha_bench.diagnosis.fit.beliefs import beliefs_of
from eha_bench.diagnosis.fit.chosen_windows import thinned_windows, thinning_notes
from eha_bench.diagnosis.fit.command_leads import command_leads, lead_notes, with_leads
from eha_bench.diagnosis.fit.evidence import refined_noise
from eha_bench.diagnosis.fit.friction_at_rest import at_rest, friction_at_rest_of
from eha_bench.diagnosis.fit.least_squares import Fit, free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.outlier_runs import notes_of, outlier_runs
from eha_bench.diagnosis.fit.own_parameters import with_clocks, with_own
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.residual_colour import NOTHING_SEEN, noise_of_residual
from eha_bench.diagnosis.fit.settled import settled_fit
from eha_bench.diagnosis.fit.start_angles import counts_on, own_angles
from eha_bench.diagnosis.fit.starts import MultistartFit, best_fit_of_starts
from eha_bench.diagnosis.fit.steady_windows import steady_problem, unsteady_notes
from eha_bench.diagnosis.fit.stretched_steps import is_stiffer, with_stretched_steps
from eha_bench.diagnosis.fit.telling_windows import note_of, telling_windows
from eha_bench.plants.remarks import held_parameters

STEP = 2e-4
"""Integration step of fits, s: five a tick at 1 kHz; its error is below 0.1 of usual noise."""

COARSE = 3.4e-4
"""Integration step while searching, where only differences between candidates count, s: three a
tick at 1 kHz."""

SCREENING = 5e-4
"""Integration step where only a simulation's change by a candidate counts, s."""

_FASTEST, _SLOWEST = 1.0 / 30e3, 0.5
"""Periods between which actuators are logged, s. Of seconds that are read as milliseconds those of
more than 30 Hz are beyond them, of milliseconds read as seconds those of less than 2 kHz."""


@dataclass
class Baseline:
    """A calibrated model and what it was calibrated on.

    Attributes:
        dataset: with the declared model.
        measured: training runs that passed the gate.
        problem: residuals over their windows.
        fit: of the parameters under `calibrate`, and of nuisance parameters.
        keys: what was fitted.
        nuisance: those of `keys` that the model file does not list.
        notes: what the gate found.
        starts: from how many it was fitted. agreed: how many of them ended at the same cost.
        left_out: runs of which the model explains nothing, by name.
    """

    dataset: Dataset
    measured: tuple[Measured, ...]
    problem: Problem
    fit: Fit
    keys: tuple[str, ...]
    nuisance: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())
    starts: int = 1
    agreed: int = 1
    left_out: tuple[str, ...] = ()

    def at_angles(self, starts: Mapping[str, StartAngle]) -> Baseline:
        """Return the same where runs begin at other angles of the shaft, by name."""
        measured = tuple(item.at_angles(starts) for item in self.measured)
        return replace(self, measured=measured, problem=self.problem.at_angles(starts))

    def noting_its_map(self, note: str) -> Baseline:
        """Return the same with a note, the first, on a channel map that its dataset corrects."""
        dataset = replace(self.dataset, notes=(*self.dataset.notes, note))
        return replace(self, dataset=dataset, notes=(note, *self.notes))


def no_progress(_stage: str, _fraction: float) -> None:
    """Say nothing."""


def gather(
    dataset: Dataset,
) -> tuple[tuple[Measured, ...], list[Window], dict[str, float], tuple[str, ...]]:
    """Read the training runs, and return them with their windows, their noise and notes.

    A log that cannot be read, or holds nothing, costs its own run: the others are there all the
    same.

    Raises:
        RecordingError: no log can be read.
        MissingChannelError: an input is not in a log.
        InputError: no run has anything to compare.
    """
    plant = dataset.model.plant
    compared = dataset.determined(plant)
    measured: list[Measured] = []
    unread: list[RecordingError] = []
    runs, recordings, unused = [], [], list[Note]()
    for run in with_own(plant.layout, dataset.training, dataset.model.per_run):
        try:
            topics = topics_from_onset(run, dataset.inputs, compared, plant.roles)
            recordings.append(on_ticks(topics, dataset.inputs, compared, run.stamped_late))
            runs.append(run)
            unused += unused_inputs(run, topics, dataset.inputs, dataset.model)
        except RecordingError as error:
            unread.append(error)
    restful = restful_channels(
        (name, item.recording[name]) for item in recordings for name in item.recording
    )
    for run, recording in zip(runs, recordings, strict=True):
        try:
            item = admit(
                run, recording, dataset.inputs, compared, restful=restful, roles=plant.roles
            )
            measured.append(item.ended(run.until))
        except RecordingError as error:
            unread.append(error)
    if unread and not measured:
        raise unread[0]
    measured = [*with_clocks(plant.layout, with_scatter(with_noise_colour(measured)))]
    noise = pooled_noise(measured, compared)
    if not noise:
        raise InputError(
            "no measured channel can be compared with the model",
            where=Place(file=dataset.source),
            hint=f"{plant.id} gives: {', '.join(compared)}",
        )
    windows = [window for item in measured for window in cut_windows(item, noise)]
    windows = thinned_windows(windows)
    notes = [
        *dataset.notes,
        *(f"CAUTION: {remark}" for remark in held_parameters(dataset.model)),
        *(f"a training run is left out: {error}" for error in unread),
    ]
    ends = plant.position_range(dataset.model.vector())
    notes += beyond_ends(measured, ends, plant.units)
    notes += [
        f"'{name}' is not compared: no input drives it"
        for name in plant.outputs
        if name not in compared and name not in dataset.inputs
    ]
    return (
        tuple(measured),
        windows,
        noise,
        (
            *notes,
            *merged_notes(unused),
            *_notes_of_time(measured),
            *_notes_of_constant_inputs(measured, plant.units),
            *_noise_notes(measured, plant.units),
            *_notes(measured),
            *merged_notes(_step_notes(measured)),
        ),
    )


class CalibrationInterrupted(KeyboardInterrupt):
    """Calibration was interrupted; `baseline` is as far as it had come."""

    def __init__(self, baseline: Baseline) -> None:
        super().__init__()
        self.baseline = baseline


def calibrated_baseline(
    dataset: Dataset, progress: ProgressHook = no_progress, *, kept: Collection[str] = ()
) -> Baseline:
    """Fit the parameters under `calibrate`, and nuisance parameters, to all training runs.

    Args:
        dataset: with the declared model. progress: called with the stage and what is done of it.
        kept: runs that are fitted also where the model explains nothing of them.

    Raises:
        InputError: nothing to calibrate with.
        CalibrationInterrupted: Ctrl-C once the data were read.
    """
    progress("read", 0.0)
    measured, windows, noise, notes = gather(dataset)
    best = [dataset.model.vector()]
    try:
        measured, windows = _at_their_angles(dataset, measured, windows, noise)
        found = _calibrate(dataset, measured, windows, noise, best, progress, kept)
    except KeyboardInterrupt as stop:
        with checkpoints(lambda: False):
            reached = _as_far_as(dataset, measured, windows, noise, best[-1])
        raise CalibrationInterrupted(replace(reached, notes=notes)) from stop
    return replace(found, notes=(*notes, *found.notes))


def _calibrate(
    dataset: Dataset,
    measured: tuple[Measured, ...],
    windows: list[Window],
    noise: dict[str, float],
    best: list[FloatArray],
    progress: ProgressHook,
    kept: Collection[str],
) -> Baseline:
    """Calibrate; the last of `best` is always the best vector so far."""
    plant = dataset.model.plant
    layout = plant.layout
    progress("calibrate", 0.1)
    declared, rough, arrival = _roughly(dataset, windows, noise, best)
    found = outlier_runs(rough, (declared, arrival.fit.residual))
    outliers = {name: channel for name, channel in found.items() if name not in kept}
    if outliers:
        measured = tuple(item for item in measured if item.run.name not in outliers)
        windows = [window for window in windows if window.measured.run.name not in outliers]
        noise = pooled_noise(measured, plant.outputs)
        declared, rough, arrival = _roughly(dataset, windows, noise, best)
    if late := rough.places.lateness(arrival.fit.vector):
        # windows begin where their samples were taken
        measured = tuple(replace(item, lateness=late) for item in measured)
        own = {item.run.name: item for item in measured}
        windows = [window_at(own[w.measured.run.name], w.first, w.last, noise) for w in windows]
        rough = rough.over(windows)
        rough.prepare(arrival.fit.vector)
    periods, rough, reached = command_leads(rough, arrival.fit)
    if periods:
        arrival = replace(arrival, fit=reached)
        measured, windows = with_leads(measured, windows, periods)
    seen = NOTHING_SEEN
    if not _rest_is_seen(measured):
        seen = noise_of_residual(rough, arrival.fit.vector)
    if seen.levels:
        measured = tuple(with_colours(item, seen.colours) for item in measured)
        noise = pooled_noise(measured, plant.outputs) | seen.levels
        windows = thinned_windows(
            [window for item in measured for window in cut_windows(item, noise)]
        )
        declared, rough, arrival = _roughly(dataset, windows, noise, best)
    rough, reached, told = _with_what_tells(rough, arrival.fit, measured)
    progress("calibrate", 0.4)
    fit = at_rest(rough, reached)
    best.append(fit.vector)
    progress("calibrate", 0.6)
    noise = refined_noise(rough, fit.residual, noise) | seen.levels
    uncut = rough.with_noise(noise).at_step(STEP)
    problem = steady_problem(uncut, fit.vector)
    problem.scale_to(problem.residual(fit.vector))
    keys = _keys(dataset, problem)
    nuisance = tuple(key for key in friction_at_rest_of(layout) if key not in keys)
    known = fit.columns if problem is uncut else None
    fit = levenberg_marquardt(
        problem, fit.vector, fit.free, known=known, refresh=1, watch=best.append
    )
    fit = settled_fit(problem, fit, best.append)
    progress("calibrate", 1.0)
    return Baseline(
        dataset,
        measured,
        problem,
        fit,
        (*keys, *nuisance),
        nuisance,
        (
            *notes_of(outliers),
            *told,
            *lead_notes(measured),
            *unsteady_notes(uncut.windows, problem.windows),
            *(colour_notes(measured) if seen.colours else ()),
        ),
        arrival.tried,
        arrival.agreed,
        tuple(outliers),
    )


def _with_what_tells(
    rough: Problem, fit: Fit, measured: Sequence[Measured]
) -> tuple[Problem, Fit, list[str]]:
    """Return a problem that has windows besides those chosen evenly, its fit, and what is said.

    The same where nothing was left out, or where what was tells nothing new.
    """
    more = telling_windows(rough, fit.vector, measured)
    if not more:
        return rough, fit, []
    order = {item.run.name: k for k, item in enumerate(measured)}
    windows = sorted(
        [*rough.windows, *more], key=lambda item: (order[item.measured.run.name], item.first)
    )
    wider = rough.over(windows)
    wider.prepare(fit.vector)
    wider.scale_to(wider.residual(fit.vector))
    return wider, levenberg_marquardt(wider, fit.vector, fit.free), [note_of(more)]


def _rest_is_seen(measured: Sequence[Measured]) -> bool:
    """Whether runs show their sensors' noise alone, while nothing moves, for long enough."""
    samples = 0
    for item in measured:
        for stretch in quiet_stretches(item):
            samples += max((values.size for values in stretch.values()), default=0)
            if samples >= FEWEST:
                return True
    return False


def _at_their_angles(
    dataset: Dataset, measured: tuple[Measured, ...], windows: list[Window], noise: dict[str, float]
) -> tuple[tuple[Measured, ...], list[Window]]:
    """Return runs and windows with the angles at which something declared that turns shows them."""
    vector = dataset.model.vector()
    if not counts_on(dataset.model.plant.layout, vector):
        return measured, windows
    starts = own_angles(Problem(dataset.model.plant, windows, noise, COARSE), vector)
    turned = {item.run.name: item.at_angles(starts) for item in measured}
    return tuple(turned.values()), [
        from_another_angle(item, turned[item.measured.run.name]) for item in windows
    ]


def _roughly(
    dataset: Dataset, windows: list[Window], noise: dict[str, float], best: list[FloatArray]
) -> tuple[FloatArray, Problem, MultistartFit]:
    """Return the residual of the declared model, and where first fits end with their problem."""
    rough = Problem(dataset.model.plant, windows, noise, COARSE, beliefs_of(dataset.model))
    vector = rough.places.lengthened(dataset.model.vector())
    long = with_stretched_steps(rough, vector)
    long.prepare(vector)
    first = long.residual(vector)
    long.scale_to(first)
    free = free_parameters(long.places, _keys(dataset, long), vector)
    arrival = best_fit_of_starts(long, vector, free, best.append)
    if is_stiffer(rough, long, arrival.fit):
        rough.prepare(vector)
        rough.scale_to(first)
        arrival = best_fit_of_starts(rough, vector, free, best.append)
    else:
        rough = long
    rough.scale_to(arrival.fit.residual)
    return first, rough, arrival


def _keys(dataset: Dataset, problem: Problem) -> tuple[str, ...]:
    """Return what a calibration estimates: for all runs, of each run's own, and of their clocks."""
    behind = (item.key for item in problem.places.behind)
    return tuple(dict.fromkeys((*dataset.model.calibrate, *behind)))


def _notes_of_time(measured: Sequence[Measured]) -> Iterator[str]:
    """Say that samples follow one another as no actuator's log does."""
    periods = [float(np.median(np.diff(item.time))) for item in measured if item.time.size > 1]
    period = float(np.median(periods)) if periods else _FASTEST
    if not _FASTEST <= period <= _SLOWEST:
        yield f"CAUTION: the logs have a sample every {period:.3g} s: check the unit of their time"


def _notes_of_constant_inputs(
    measured: Sequence[Measured], units: Mapping[str, str]
) -> Iterator[str]:
    """Say that no input ever changes; nothing where there is none."""
    names = dict.fromkeys(name for item in measured for name in item.inputs)
    own = {name: [item.inputs[name] for item in measured if name in item.inputs] for name in names}
    if not own or any(np.ptp(values) > 0.0 for inputs in own.values() for values in inputs):
        return
    asked = ", ".join(
        f"'{name}' is {' or '.join(dict.fromkeys(f'{values[0]:.4g}' for values in inputs))} "
        f"{units.get(name) or unit_of(name)}".strip()
        for name, inputs in own.items()
    )
    yield (
        f"no input changes within any training run ({asked}): if one should, it is mapped to "
        "another column"
    )


def _noise_notes(measured: Sequence[Measured], units: Mapping[str, str]) -> Iterator[str]:
    """Say what is known of noise that is not white, or that drives the simulations."""
    for name in dict.fromkeys(name for item in measured for name in item.input_noise):
        own = [item.input_noise[name] for item in measured if name in item.input_noise]
        level, unit = float(np.median(own)), units.get(name) or unit_of(name)
        yield (
            f"input '{name}' was measured, with a noise of {f'{level:.2g} {unit}'.strip()}: its "
            "effect on the simulation counts as noise"
        )
    yield from scatter_notes(measured)
    yield from colour_notes(measured)


def colour_notes(measured: Sequence[Measured]) -> Iterator[str]:
    """Say which channels' noise is not white."""
    for name in sorted({name for item in measured for name in item.colours}):
        colours = dict.fromkeys(item.colours[name] for item in measured if name in item.colours)
        # one for each sampling period
        known = sorted({f"{colour.correlations(2)[1]:.2f}" for colour in colours}, key=float)
        yield (
            f"the noise of '{name}' is not white: neighbouring samples "
            f"correlate by {' and '.join(known)}; the fit weighs it accordingly"
        )


def _step_notes(measured: Sequence[Measured]) -> Iterator[Note]:
    """Say which logs begin in the midst of a valve's command."""
    for item in measured:
        for name in () if is_whole(item) else steps_at_first(item):
            yield Note(
                "{run}: '{channel}' is on at the first sample, and what it was before is not in "
                "the log: it is fitted from where it moves, and tells nothing of a delay there; a "
                "log that begins before the step does",
                run=item.run.name,
                channel=name,
            )


def _notes(measured: Sequence[Measured]) -> tuple[str, ...]:
    notes = notes_of_runs(measured)
    return (*notes, *thinning_notes(measured))


def _as_far_as(
    dataset: Dataset,
    measured: tuple[Measured, ...],
    windows: list[Window],
    noise: dict[str, float],
    vector: FloatArray,
) -> Baseline:
    """Return a baseline at a vector that no fit has finished with."""
    layout = dataset.model.plant.layout
    problem = Problem(dataset.model.plant, windows, noise, COARSE, beliefs_of(dataset.model))
    keys = _keys(dataset, problem)
    nuisance = tuple(key for key in friction_at_rest_of(layout) if key not in keys)
    vector = problem.places.lengthened(vector)
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))
    creeps = (key for key in nuisance if vector[layout.index[key]] != 0.0)
    free = free_parameters(problem.places, (*keys, *creeps), vector)
    fit = levenberg_marquardt(problem, vector, free, iterations=0)
    return Baseline(dataset, measured, problem, fit, (*keys, *nuisance), nuisance)
