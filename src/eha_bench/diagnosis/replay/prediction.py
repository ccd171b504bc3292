"""`predict`: free-run simulation of every run's outputs from its inputs and first sample."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.atomic_file import replacing, write_text
from eha_bench.core.channels import unit_of
from eha_bench.core.extras import require
from eha_bench.core.finite import finite_or_none
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.beyond_ends import beyond_ends
from eha_bench.diagnosis.data.dataset import Dataset, Run, load_dataset
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured, pooled_noise
from eha_bench.diagnosis.data.onset import topics_from_onset
from eha_bench.diagnosis.data.pauses import parted_at_pauses
from eha_bench.diagnosis.data.ticks import nearest, on_ticks
from eha_bench.diagnosis.data.unused_inputs import unused_inputs
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.first_part import first_part
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.start_angles import (
    angles_note,
    counts_on,
    own_angles,
    periodic_effects,
    without_periodic,
)
from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.diagnosis.replay.asked_before import asked_before_notes, with_asked_before
from eha_bench.diagnosis.replay.first_sample import first_sample
from eha_bench.plants.model import Model, model_from

STEP = 1e-4
"""Integration step of a prediction, s: its error is below a tenth of usual noise."""

_SAME = 0.1
"""What a stamp is off a tick at most and still is that tick's, in periods."""

SCHEMA_VERSION = 1
SUMMARY = "prediction.json"


def _file_of(run: str) -> str:
    """Return the name of a run's Parquet file."""
    return f"{run}.parquet"


@dataclass(frozen=True)
class Prediction:
    """One run's simulated outputs at the log's time stamps.

    Attributes:
        run: its name. time: (n,) s since `epoch_ns`, as `read` gives it for the log.
        values: channel -> (n,) SI.
        notes: what was found in the log (gaps of an input that were bridged), and what was taken
            for its start and is not in the first sample, one sentence each.
        errors: channel -> root mean square of measured less predicted, SI, where the log measures
            it; infinite where the simulation diverges.
        epoch_ns: time zero by the log's own clock, ns (a table's that starts at 5 s: 5e9).
        units: SI units of channels that eha_bench does not know.
    """

    run: str
    time: FloatArray
    values: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    epoch_ns: int = 0
    units: Mapping[str, str] = field(default_factory=dict)

    def unit(self, channel: str) -> str:
        """Return the SI unit of a channel."""
        return self.units.get(channel, unit_of(channel))

    @property
    def file(self) -> str:
        """Name of its Parquet file."""
        return _file_of(self.run)

    def to_dict(self) -> dict[str, Any]:
        """Return what prediction.json says of it; an error that is not computable is null."""
        return {
            "run": self.run,
            "file": self.file,
            "epoch_ns": self.epoch_ns,
            "samples": int(self.time.size),
            "channels": list(self.values),
            "error": {
                name: {"rms": finite_or_none(value), "unit": self.unit(name)}
                for name, value in self.errors.items()
            },
            "notes": list(self.notes),
        }

    def write(self, path: Path) -> None:
        """Write Parquet: `time` in s, then one column a channel in SI; whole or not at all.

        A column's metadata hold its `unit`, the table's the `epoch_ns` that `time` counts from.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = {"time": self.time, **self.values}
        units = {"time": "s", **{name: self.unit(name) for name in self.values}}
        schema = pa.schema(
            [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns],
            metadata={"epoch_ns": str(self.epoch_ns)},
        )
        table = pa.table({name: pa.array(values) for name, values in columns.items()}, schema)
        with replacing(path) as part:
            pq.write_table(table, part)


_FEW = 20
"""Samples over which it shows whether anything depends on an angle."""
_TURNED = (0.3, 7.0, -7.0, 100.0, -100.0)
"""Angles by which a start is turned for that, rad: springs, weights and stops show."""


def simulate_from(
    measured: Measured, model: Model, state: Mapping[str, float], step: float
) -> FloatArray:
    """Return the plant's outputs over a whole run, (n, outputs), from what its sensors read first.

    A small error of the speed adds up to a wrong angle, and what is periodic in it loses its phase.
    So where the model has such an effect on and nothing reads that angle, it is the integral of the
    measured speed.

    Args:
        measured: the run. model: what is simulated. state: channel -> first reading, SI.
        step: largest integration step, s.
    """
    at = model.plant.at(measured.run.vector(model.plant.layout, model.vector()))
    drive = measured.drive(0, measured.time.size)
    anchors = {
        name: np.concatenate([np.full(drive.first, np.nan), angle])
        for name, angle in _anchors(measured, model, state, step).items()
    }
    drive = replace(drive, anchors=anchors)
    return at.simulate(drive, start_of(at, drive, state), step)[drive.first :]


def _anchors(
    measured: Measured, model: Model, state: Mapping[str, float], step: float
) -> Mapping[str, FloatArray]:
    """Return the angle that a simulation takes from the speed that was measured, by its state.

    Only where nothing else in the plant depends on that angle: a spring that is held where a sensor
    has drifted to would pull at everything.
    """
    layout, vector = model.plant.layout, model.vector()
    unread = any(
        not spot.angle
        for effect in periodic_effects(layout, vector)
        for spot in effect.spots_at(layout.choice_values(effect, vector))
    )
    turning = measured.turning if unread else None
    if turning is None or turning.channel in measured.inputs:
        return {}
    angle = measured.known_shaft_angle
    if angle is None or _acts_elsewhere(measured, model, state, step):
        return {}
    return {turning.angle: angle}


def _acts_elsewhere(
    measured: Measured, model: Model, state: Mapping[str, float], step: float
) -> bool:
    """Whether anything but what is periodic depends on the angle that nothing reads."""
    assert measured.turning is not None
    at = model.plant.at(without_periodic(model.plant.layout, model.vector()))
    drive = measured.drive(0, min(_FEW, measured.time.size))
    start = {measured.turning.angle: 0.0, **start_of(at, drive, state)}
    plain = at.simulate(drive, start, step)
    for turned in _TURNED:
        other = {**start, measured.turning.angle: start[measured.turning.angle] + turned}
        if not np.array_equal(at.simulate(drive, other, step), plain, equal_nan=True):
            return True
    return False


def _with_its_own(measured: Measured, model: Model) -> Measured:
    """Return a run with its own parameters (`per_run`) as its first part has it."""
    noise = pooled_noise([measured], measured.outputs)
    if not model.per_run or not noise:
        return measured
    found = first_part(measured, model, noise)
    own = replace(measured, notes=(*measured.notes, *found.notes()))
    return own.knowing(found.values)


def _at_its_angle(measured: Measured, model: Model) -> Measured:
    """Return a run with the start angle that effects of the angle in the model show."""
    vector = model.vector()
    noise = pooled_noise([measured], measured.outputs)
    if not noise or not counts_on(model.plant.layout, vector):
        return measured
    problem = Problem(model.plant, cut_windows(measured, noise), noise, STEP)
    return measured.at_angles(own_angles(problem, vector))


def predict(
    dataset: Dataset | str | Path | Mapping[str, Any],
    model: Model | str | Path | Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Prediction, ...]:
    """Simulate every run of a dataset freely, from its inputs and its first sample.

    What repeats with the turn of a shaft whose angle nothing reads follows the integral of its
    measured speed, and a note says so.

    Where a log pauses, nobody knows what drove the machine: each part of it starts from its own
    first sample, and a note says so.

    Channels that nothing among the inputs drives are left out. What the log does not tell of a
    run's start is assumed at rest, and noted. No first sample says at which angle
    the shaft stands: where the model has something on that is periodic in it, and the run shows
    clearly that it does not begin at zero, that one number is estimated from the run. What the
    model has under `per_run` is estimated from the first part of each run, and noted.

    Args:
        dataset: dataset.yaml, a dict of what it would hold, or as loaded.
        model: model.yaml, the name of a shipped one, a dict, or as loaded; the dataset's own where
            not given.
        out: folder that gets one Parquet file a run, and prediction.json; their `time` counts from
            `epoch_ns`, as that of `read` does.
        progress: called with the run's name and the fraction done.

    Raises:
        InputError: a file is wrong or missing, `out` cannot be used, or no output of the plant is
            driven by the inputs.
        MissingChannelError: an input is not in a recording.
    """
    if out is not None:
        require("pyarrow", "parquet", "a Parquet file for each run")
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(dataset)
    with noting_inputs() as read:
        if model is None:
            model = dataset.model
        elif not isinstance(model, Model):
            model = model_from(model)
    compared = dataset.determined(model.plant)
    if out is not None:
        folder = writable(Path(out))
        written = (SUMMARY, *(_file_of(run.name) for run in dataset.runs))
        spare_inputs((folder / name for name in written), (*dataset.files, *read))
    found = []
    for number, run in enumerate(dataset.runs):
        if progress:
            progress(run.name, number / len(dataset.runs))
        parts = [
            _prediction_of(part, dataset.inputs, compared, model)
            for part in parted_at_pauses([run.read_once()], ())
        ]
        prediction = _joined(run, parts, model)
        if out is not None:
            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            prediction.write(folder / prediction.file)
        found.append(prediction)
    if out is not None:
        write_text(Path(out) / SUMMARY, _summary(found))
    if progress:
        progress("done", 1.0)
    return tuple(found)


class _PredictedPart(NamedTuple):
    """Prediction of a log, or of what it holds between two pauses.

    Attributes:
        recording: its readings. values: channel -> simulated at their stamps, (n,) SI.
        residuals: channel -> (k,) measured less predicted, SI. notes: one sentence each.
    """

    recording: Recording
    values: Mapping[str, FloatArray]
    residuals: Mapping[str, FloatArray]
    notes: tuple[str, ...]


def _prediction_of(
    run: Run, inputs: Sequence[str], compared: Sequence[str], model: Model
) -> _PredictedPart:
    """Return the prediction of a run, or of a part of one, at the stamps of its recording."""
    plant = model.plant
    recording = run.read()
    topics = topics_from_onset(run, inputs, compared, plant.roles)
    sampled = on_ticks(topics, inputs, compared, run.stamped_late)
    measured = admit(run, sampled, inputs, compared, strict=False, roles=plant.roles)
    measured = _at_its_angle(_with_its_own(measured, model), model)
    start = first_sample(measured, model)
    measured = with_asked_before(measured, model, start.state)
    values = simulate_from(measured, model, start.state, STEP)
    determined = plant.determined(tuple(measured.inputs))
    columns = {
        name: np.ascontiguousarray(values[:, at])
        for at, name in enumerate(plant.outputs)
        if name in determined and name not in measured.inputs
    }
    if "pressure_a" in columns and "pressure_b" in columns:
        columns["pressure_difference"] = columns["pressure_a"] - columns["pressure_b"]
    derived = plant.derived(model.vector(), columns)
    columns |= {n: v for n, v in derived.items() if n in recording and n not in measured.inputs}
    residuals = _residuals(columns, measured, sampled.recording)
    # of one topic, ticks with rows that were lost or put in before the first
    if sampled.is_of_several or len(sampled.recording) != len(recording):
        columns = _at_stamps(columns, sampled.recording, recording)
    notes = (
        *unused_inputs(run, topics, inputs, model),
        *measured.notes,
        *beyond_ends([measured], plant.position_range(model.vector()), plant.units),
        *start.notes,
        *asked_before_notes(measured, model),
    )
    if _anchors(measured, model, start.state, STEP) and measured.turning:
        speed = measured.turning.channel
        notes += (
            f"{measured.run.name}: what repeats with the turn follows the angle that the measured "
            f"'{speed}' adds up to",
        )
    if measured.start.is_estimated:
        notes += (angles_note({measured.run.name: measured.start}),)
    return _PredictedPart(recording, columns, residuals, notes)


def _joined(run: Run, parts: Sequence[_PredictedPart], model: Model) -> Prediction:
    """Return the prediction of a run from those of its parts; between them nothing is predicted."""
    recording = parts[0].recording if len(parts) == 1 else run.read()
    time = np.array(recording.time)
    values = {}
    for name in dict.fromkeys(name for part in parts for name in part.values):
        values[name] = np.full(time.size, np.nan)
        for part in parts:
            if name in part.values:
                at = np.searchsorted(time, part.recording.time)
                values[name][at] = part.values[name]
    residuals: dict[str, list[FloatArray]] = {}
    for part in parts:
        for name, own in part.residuals.items():
            residuals.setdefault(name, []).append(own)
    return Prediction(
        run.name,
        time,
        values,
        tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        {name: _rms(np.concatenate(own)) for name, own in residuals.items()},
        recording.epoch_ns,
        model.plant.units,
    )


def _rms(residual: FloatArray) -> float:
    """Return the root mean square; infinite where a simulation diverges."""
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(residual**2)))


def _at_stamps(
    columns: Mapping[str, FloatArray], ticks: Recording, recording: Recording
) -> dict[str, FloatArray]:
    """Return what was simulated at ticks at the stamps of a recording; zero may be another.

    A reading that is stamped a little off a tick was taken at it.
    """
    apart = (recording.epoch_ns - ticks.epoch_ns) / 1e9
    stamps = np.array(recording.time) + apart
    at = nearest(ticks.time, stamps)
    same = np.abs(stamps - ticks.time[at]) <= _SAME * ticks.sample_period
    stamps[same] = ticks.time[at[same]]
    return {name: np.interp(stamps, ticks.time, values) for name, values in columns.items()}


def _residuals(
    columns: Mapping[str, FloatArray], measured: Measured, recording: Recording
) -> dict[str, FloatArray]:
    """Return measured less predicted of every channel that the log measures, SI.

    What the gate does not believe has no say: an error against a dead sensor is none.
    """
    found = {}
    for name, values in columns.items():
        column = _comparable_values(name, measured, recording)
        if column is None or not (there := np.isfinite(column)).any():
            continue
        taken = measured.at_sample_instants(name, values, {})[there]
        found[name] = column[there] - np.where(np.isfinite(taken), taken, np.inf)
    return found


def _comparable_values(name: str, measured: Measured, recording: Recording) -> FloatArray | None:
    """Return what of a channel may be compared with its prediction, (n,) with NaN, or None."""
    if name in measured.outputs:
        return measured.column(name)
    if name in measured.still:
        return measured.still[name]
    if name in recording.values and name not in measured.first:
        return None
    if name in recording.values:
        raw = recording[name]
        return None if np.nanmax(raw) == np.nanmin(raw) else raw
    first, second = (measured.column(part) for part in ("pressure_a", "pressure_b"))
    if name == "pressure_difference" and first is not None and second is not None:
        return first - second
    return None


def _summary(found: Sequence[Prediction]) -> str:
    """Return prediction.json's text."""
    content = {"schema_version": SCHEMA_VERSION, "runs": [item.to_dict() for item in found]}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
