"""`predict`: free-run simulation of every run's outputs from its inputs and first sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eha_bench.core.atomic_file import replacing
from eha_bench.core.channels import unit_of
from eha_bench.core.output_folder import writable
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.data.gate import Measured, admit, pooled_noise
from eha_bench.diagnosis.data.noise import noise_of
from eha_bench.diagnosis.data.windows import cut
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.start_angles import counts_on, own_angles, said
from eha_bench.diagnosis.fit.start_state import start_of
from eha_bench.plants.model import Model, load_model

FloatArray = NDArray[np.float64]

STEP = 1e-4
"""Integration step of a prediction, s: its error is below a tenth of usual noise."""

_SPEEDS = ("motor_speed", "piston_velocity")
_PRESSURES = ("pressure_a", "pressure_b")


@dataclass(frozen=True)
class Prediction:
    """One run's simulated outputs at the log's time stamps.

    Attributes:
        run: its name. time: (n,) s, as in the log. values: channel -> (n,) SI.
        notes: what was found in the log (gaps of an input that were bridged), and what was taken
            for its start and is not in the first sample, one sentence each.
    """

    run: str
    time: FloatArray
    values: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()

    def write(self, path: Path) -> None:
        """Write Parquet: `time` in s, then one column a channel in SI; whole or not at all."""
        columns = {"time": self.time, **self.values}
        units = {"time": "s", **{name: unit_of(name) for name in self.values}}
        schema = pa.schema(
            [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns]
        )
        table = pa.table({name: pa.array(values) for name, values in columns.items()}, schema)
        with replacing(path) as part:
            pq.write_table(table, part)


def first_state(measured: Measured, model: Model) -> dict[str, float]:
    """Return the state at the first sample, from that sample alone.

    One sample carries its sensor's noise. Where it cannot be told from rest (speeds of nothing,
    both pressures at the charge pressure that the model declares), rest is taken.
    """
    state: dict[str, float] = {}
    if not model.plant.states:
        return state
    noise = {name: noise_of(column) for name in measured.outputs
             if (column := measured.column(name)) is not None}  # fmt: skip
    for name in measured.outputs:
        column = measured.column(name)
        if column is None:
            continue
        good = np.flatnonzero(np.isfinite(column))
        value = float(column[good[0]])
        if name in _SPEEDS and abs(value) < 4.0 * noise.get(name, 0.0):
            value = 0.0
        state[name] = value
    charge = _charge_pressure(model)
    if all(name in state for name in _PRESSURES):
        sigma = max(noise.get(name, 0.0) for name in _PRESSURES)
        charged = charge is not None and all(
            abs(state[name] - charge) < 4.0 * sigma for name in _PRESSURES
        )
        if charge is not None and charged:
            state["pressure_a"] = state["pressure_b"] = charge
        elif abs(state["pressure_a"] - state["pressure_b"]) < 4.0 * sigma:
            middle = 0.5 * (state["pressure_a"] + state["pressure_b"])
            state["pressure_a"] = state["pressure_b"] = middle
    elif charge is not None:
        for name in _PRESSURES:
            state.setdefault(name, charge)
    if "current" in state and abs(state["current"]) < 4.0 * noise.get("current", 0.0):
        state["current"] = 0.0
    if "piston_position" not in state and measured.run.locked:
        state["piston_position"] = measured.held.get("piston_position", 0.0)
    if measured.run.locked:
        state["piston_velocity"] = 0.0
    if measured.start.is_estimated:
        state["shaft_angle"] = measured.start.value
    return state


def _charge_pressure(model: Model) -> float | None:
    for effect in model.effects:
        if effect.id == "anti_cavitation":
            parameter = model.plant.layout.effect(effect.id).parameter("charge_pressure")
            # a quantity's value and default are numbers; only a choice's are text
            return float(effect.values.get("charge_pressure", parameter.default))  # type: ignore[arg-type]
    return None


def simulate_run(measured: Measured, model: Model, step: float = STEP) -> FloatArray:
    """Return the plant's outputs over a whole run, (n, outputs), from inputs and first sample."""
    return simulate_from(measured, model, first_state(measured, model), step)


def simulate_from(
    measured: Measured, model: Model, state: Mapping[str, float], step: float
) -> FloatArray:
    """Return the plant's outputs over a whole run, (n, outputs), from what its sensors read first.

    Args:
        measured: the run. model: what is simulated. state: channel -> first reading, SI.
        step: largest integration step, s.
    """
    at = model.plant.at(model.vector())
    drive = measured.drive(0, measured.time.size)
    return at.simulate(drive, start_of(at, drive, state), step)


def _at_its_angle(measured: Measured, model: Model) -> Measured:
    """Return a run whose shaft begins where what turns in the model shows it in the run."""
    vector = model.vector()
    noise = pooled_noise([measured], measured.outputs)
    if not noise or not counts_on(model.plant.layout, vector):
        return measured
    problem = Problem(model.plant, cut(measured, noise), noise, STEP)
    return measured.begun(own_angles(problem, vector))


def predict(
    dataset: Dataset | str | Path,
    model: Model | str | Path | None = None,
    out: str | Path | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Prediction, ...]:
    """Simulate every run of a dataset freely, from its inputs and its first sample.

    Channels that nothing among the inputs drives are left out. No first sample says at which angle
    the shaft stands: where the model has something on that is periodic in it, and the run shows
    clearly that it does not begin at zero, that one number is estimated from the run.

    Args:
        dataset: dataset.yaml, or as loaded.
        model: model.yaml, or as loaded; the dataset's own where not given.
        out: folder that gets one Parquet file a run.
        progress: called with the run's name and the fraction done.

    Raises:
        InputError: a file is wrong or missing, or `out` cannot be used.
        MissingChannelError: an input is not in a recording.
    """
    if not isinstance(dataset, Dataset):
        dataset = load_dataset(Path(dataset))
    if model is None:
        model = dataset.model
    elif not isinstance(model, Model):
        model = load_model(Path(model))
    if out is not None:
        writable(Path(out))
    plant = model.plant
    determined = plant.determined(dataset.inputs)
    found = []
    for number, run in enumerate(dataset.runs):
        if progress:
            progress(run.name, number / len(dataset.runs))
        recording = run.read()
        measured = admit(run, recording, dataset.inputs, determined, strict=False)
        measured = _at_its_angle(measured, model)
        values = simulate_run(measured, model)
        columns = {
            name: np.ascontiguousarray(values[:, at])
            for at, name in enumerate(plant.outputs)
            if name in determined and name not in dataset.inputs
        }
        if "pressure_a" in columns and "pressure_b" in columns:
            columns["pressure_difference"] = columns["pressure_a"] - columns["pressure_b"]
        notes = measured.notes
        if measured.start.is_estimated:
            notes += (said({run.name: measured.start}),)
        prediction = Prediction(run.name, np.array(recording.time), columns, notes)
        if out is not None:
            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            prediction.write(folder / f"{run.name}.parquet")
        found.append(prediction)
    if progress:
        progress("done", 1.0)
    return tuple(found)
