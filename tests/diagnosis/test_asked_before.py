"""What a valve was asked for before a log begins is estimated from how the run begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.data.measured import Measured, pooled_noise
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.replay.prediction import predict
from eha_bench.diagnosis.replay.replay import replay
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive

PLANT = """\
plant: valve_rod
nodes:
  supply: {kind: reservoir, pressure: 140 bar}
  tank:   {kind: reservoir, pressure: 2 bar}
  side_a: {kind: volume, bulk_modulus: 1.1 GPa}
  side_b: {kind: volume, bulk_modulus: 1.1 GPa}
  rod:    {kind: translation, mass: 40 kg}
elements:
  valve:    {kind: spool_valve, supply: supply, tank: tank, a: side_a, b: side_b, full_scale: 10 V,
             flow_gain: 1e-7 m^3/(s*Pa^0.5), natural_frequency: 250 rad/s, damping_ratio: 0.8}
  cylinder: {kind: cylinder, on: rod, a: side_a, b: side_b, area_a: 10 cm^2, area_b: 10 cm^2,
             volume_a: 100 cm^3, volume_b: 100 cm^3}
  gland:    {kind: friction, on: rod, viscous: 900 N*s/m}
inputs: {valve_command: valve.command}
channels: {pressure_a: side_a.pressure, pressure_b: side_b.pressure, rod_position: rod.position}
"""
NOISE = {"pressure_a": 1.5e4, "pressure_b": 1.5e4, "rod_position": 2e-5}
TIME = np.arange(0.0, 1.5, 2e-3)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    path = tmp_path_factory.mktemp("plant") / "plant.yaml"
    path.write_text(PLANT, encoding="utf-8")
    return load_model(path)


def recorded(model: Model, before: float, command: np.ndarray) -> Recording:
    """Record a rod that rests, or moves steadily, until the log begins."""
    start = {"pressure_a": 7.1e6, "pressure_b": 7.1e6, "rod_position": 0.0}
    lead = 250
    time = np.concatenate([TIME[0] - 2e-3 * np.arange(lead, 0, -1), TIME])
    asked = np.concatenate([np.full(lead, before), command])
    values = model.plant.simulate(
        model.vector(), Drive(time, {"valve_command": asked}, start), 1e-4
    )[lead:]
    random = np.random.default_rng(4)
    columns = {
        name: values[:, model.plant.outputs.index(name)] + size * random.standard_normal(TIME.size)
        for name, size in NOISE.items()
    }
    return Recording(TIME, {"valve_command": command, **columns})


def dataset(model: Model, recording: Recording) -> Dataset:
    run = Run("one", Path("one.csv"), None, False, False, Use.TRAIN, lambda: recording)
    return Dataset(model, ("valve_command",), (run,))


def wave(first: float) -> np.ndarray:
    return first + 2.0 * np.sin(2 * np.pi * 2.3 * TIME) + 0.5 * TIME


def measured(model: Model, recording: Recording) -> Measured:
    (found,), _, _, _ = gather(dataset(model, recording))
    return found


@pytest.mark.parametrize(("before", "first"), [(0.0, 0.6), (0.0, -2.0), (0.0, 0.2)])
def test_a_command_that_begins_with_the_log_is_not_what_the_spool_had(
    model: Model, before: float, first: float
) -> None:
    recording = recorded(model, before, wave(first))
    (found,) = predict(dataset(model, recording))
    for name in ("pressure_a", "pressure_b"):
        error = found.values[name] - recording[name]
        assert np.sqrt(np.mean(error[:100] ** 2)) < 2.0 * NOISE[name], name
    (note,) = (note for note in found.notes if "before the first sample" in note)
    said = float(note.rsplit(" ", 2)[-2])
    assert said == pytest.approx(before, abs=0.06)
    (item,) = replay([measured(model, recording)], [model], NOISE)
    (error,) = item.prediction_errors("pressure_a")
    assert np.sqrt(np.mean(error[:100] ** 2)) < 2.0 * NOISE["pressure_a"]


@pytest.mark.parametrize(
    ("before", "command"),
    [
        pytest.param(0.6, np.full(TIME.size, 0.6) + np.where(TIME > 0.3, 1.0, 0.0), id="rests"),
        pytest.param(0.0, wave(0.0), id="nothing is asked for"),
        pytest.param(0.6, wave(0.6), id="goes on as it was"),
    ],
)
def test_a_command_that_was_there_before_is_taken_as_it_is(
    model: Model, before: float, command: np.ndarray
) -> None:
    recording = recorded(model, before, command)
    (found,) = predict(dataset(model, recording))
    assert not [note for note in found.notes if "before the first sample" in note]


def test_a_command_that_is_held_for_some_ticks_does_not_rest(model: Model) -> None:
    held = wave(0.6)[(np.arange(TIME.size) // 5) * 5]  # a controller at 100 Hz
    (found,) = predict(dataset(model, recorded(model, 0.0, held)))
    (note,) = (note for note in found.notes if "before the first sample" in note)
    assert float(note.rsplit(" ", 2)[-2]) == pytest.approx(0.0, abs=0.06)


def test_a_fit_begins_where_the_motion_is_known(model: Model) -> None:
    """A twentieth of what a command goes through moves a machine as well as a step does."""
    jumps = measured(model, recorded(model, 0.0, wave(0.2)))
    rests = measured(model, recorded(model, 0.0, wave(0.0)))
    assert 0.05 * np.ptp(wave(0.2)) > 0.2
    assert cut_windows(jumps, pooled_noise([jumps], jumps.outputs))[0].first > 0
    assert cut_windows(rests, pooled_noise([rests], rests.outputs))[0].first == 0
