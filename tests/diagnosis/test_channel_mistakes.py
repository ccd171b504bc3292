"""Channels of the opposite sign, and exchanged ones: named and read right, and nothing else is."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.data.map_correction import Exchanged, Reversed
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.ended_runs import baseline_up_to_jumps
from eha_bench.diagnosis.fit.baseline import calibrated_baseline
from eha_bench.diagnosis.fit.channel_mistakes import _reversals, suspects
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive
from eha_bench.report.diagnosis_text import headline

PLANT = """\
plant: two_shafts
nodes:
  shaft: {kind: rotation, inertia: 9e-4 kg*m^2}
  wheel: {kind: rotation, inertia: 2e-3 kg*m^2}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  belt:  {kind: coupling, between: [shaft, wheel], stiffness: 4 N*m/rad, damping: 0.02 N*m*s/rad}
  drag:  {kind: friction, on: shaft, viscous: 0.004 N*m*s/rad}
  brush: {kind: friction, on: wheel, viscous: 0.004 N*m*s/rad, coulomb: %s N*m}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed, wheel_speed: wheel.speed}
calibrate: [shaft.inertia, wheel.inertia, drag.viscous, brush.viscous]
"""
SPEEDS = ("motor_speed", "wheel_speed")


def rig(
    folder: Path,
    mistake: Reversed | Exchanged | None = None,
    coulomb: float = 0.0,
    late: int = 0,
) -> Path:
    """Write three runs of the plant, logged with a mistake or late, and a dataset of them."""
    (folder / "true.yaml").write_text(PLANT % coulomb, encoding="utf-8")
    (folder / "plant.yaml").write_text(PLANT % 0.0, encoding="utf-8")
    model = load_model(folder / "true.yaml")
    vector = model.vector() * 1.05
    generator = np.random.default_rng(4)
    time = 2e-3 * np.arange(500)
    lines = ["model: plant.yaml", "inputs: [current_command]", "channels: map.yaml", "runs:"]
    for number, use in enumerate(("train", "train", "holdout")):
        current = np.repeat(generator.uniform(-6.0, 6.0, 20), 25)
        if late:
            current = 5.0 * np.sin(2.0 * np.pi * 5.0 * time + number)
        start = dict.fromkeys(SPEEDS, 0.0)
        out = model.plant.simulate(vector, Drive(time, {"current_command": current}, start), 2e-4)
        read = {
            name: out[:, model.plant.outputs.index(name)] + 0.05 * generator.standard_normal(500)
            for name in SPEEDS
        }
        read = {name: np.roll(values, late) for name, values in read.items()}
        log = Recording(time, {"current_command": current, **read})
        log = log if mistake is None else mistake.of(log)
        names = ("current_command", *SPEEDS)
        rows = np.column_stack([time, *(log[name] for name in names)])
        header = ",".join(("t", *names))
        np.savetxt(folder / f"{number}.csv", rows, "%.7g", ",", header=header, comments="")
        lines.append(f"  - {{log: {number}.csv, use: {use}}}")
    (folder / "map.yaml").write_text(
        "time: {column: t, unit: s}\nchannels:\n  current_command: {column: current_command}\n"
        "  motor_speed: {column: motor_speed, unit: rad/s}\n"
        "  wheel_speed: {column: wheel_speed, unit: rad/s}\n",
        encoding="utf-8",
    )
    (folder / "dataset.yaml").write_text("\n".join(lines), encoding="utf-8")
    return folder / "dataset.yaml"


@pytest.mark.parametrize(
    ("channels", "also"),
    [
        (("wheel_speed",), ()),
        # an opposite command is an opposite sign of all that follows it
        (SPEEDS, ("current_command",)),
        (("current_command",), ("current_command",)),
    ],
)
def test_an_opposite_sign_is_named_and_read_right(
    tmp_path: Path, channels: tuple[str, ...], also: tuple[str, ...]
) -> None:
    mistake = Reversed(tuple((name, 0.0) for name in channels))
    base = baseline_up_to_jumps(load_dataset(rig(tmp_path, mistake)))
    note = base.notes[0]
    named = also or channels
    assert note.startswith(f"CAUTION: opposite sign of '{named[0]}'")
    assert "correct `scale` in map.yaml" in note
    if also:
        assert note.endswith("; 'motor_speed' and 'wheel_speed' reversed would do as well")
    assert base.fit.cost < base.problem.size


def test_exchanged_channels_are_named(tmp_path: Path) -> None:
    base = baseline_up_to_jumps(load_dataset(rig(tmp_path, Exchanged(*SPEEDS))))
    assert base.notes[0].startswith("CAUTION: 'motor_speed' and 'wheel_speed' are exchanged")
    assert base.fit.cost < base.problem.size


def test_a_mistake_is_no_cause_and_held_out_runs_are_read_without_it(tmp_path: Path) -> None:
    found = diagnose(rig(tmp_path, Reversed((("wheel_speed", 0.0),))))
    assert found.verdict == "none"
    assert any(note.startswith("CAUTION: opposite sign of 'wheel_speed'") for note in found.notes)
    assert found.misread == ("'wheel_speed' reversed",)
    status, verdict, _ = headline(found)
    assert status == "warned"
    assert verdict.endswith("but its channel map is wrong: 'wheel_speed' reversed is right")
    for error in found.holdout.values():
        assert error.before < 1.3 * error.noise_floor


@pytest.mark.parametrize("coulomb", [0.0, 0.3])
def test_what_is_missing_in_the_machine_suspects_no_channel(tmp_path: Path, coulomb: float) -> None:
    base = calibrated_baseline(load_dataset(rig(tmp_path, coulomb=coulomb)))
    assert suspects(base) == []


def test_what_may_be_late_is_not_reversed(tmp_path: Path) -> None:
    # half a period of its 5 Hz: the sign, or a delay
    base = calibrated_baseline(load_dataset(rig(tmp_path, late=50)))
    assert base.fit.cost > 100.0 * base.problem.size
    assert suspects(base) == []


def test_a_map_that_no_training_run_has_stays_as_it_is(tmp_path: Path) -> None:
    dataset = rig(tmp_path, Reversed((("wheel_speed", 0.0),)))
    other = tmp_path / "right"
    other.mkdir()
    rig(other)
    text = dataset.read_text(encoding="utf-8")
    held_out = "{log: right/2.csv, channels: right/map.yaml, use: holdout}"
    dataset.write_text(text.replace("{log: 2.csv, use: holdout}", held_out), encoding="utf-8")
    base = baseline_up_to_jumps(load_dataset(dataset))
    assert base.notes[0].startswith("CAUTION: opposite sign of 'wheel_speed'")
    own, (run,) = load_dataset(dataset).held_out[0].read(), base.dataset.held_out
    np.testing.assert_array_equal(run.read()["wheel_speed"], own["wheel_speed"])


def test_a_map_that_reads_it_right_stays_as_it_is(tmp_path: Path) -> None:
    dataset = rig(tmp_path, Reversed((("wheel_speed", 0.0),)))
    # two runs more, of logs with another map, in which the sign is right
    other = tmp_path / "right"
    other.mkdir()
    rig(other)
    (other / "map.yaml").rename(other / "own.yaml")
    lines = [f"  - {{log: right/{k}.csv, channels: right/own.yaml}}" for k in range(2)]
    dataset.write_text("\n".join([dataset.read_text(encoding="utf-8"), *lines]), encoding="utf-8")
    base = baseline_up_to_jumps(load_dataset(dataset))
    assert base.notes[0].endswith("correct `scale` in map.yaml")
    assert base.fit.cost < base.problem.size


@pytest.mark.parametrize(
    ("stroke", "read", "sums"),
    [
        # from the other end, and the rod rests at one, in the noise of its sensor
        ((0.0, 0.25), (0.0, 0.25), {0.25}),
        # its sign, of a stroke that is even about zero
        ((-0.1, 0.1), (-0.1, 0.05), {0.0}),
        # either, about the middle of a stroke that is not
        ((-0.1, 0.3), (-0.05, 0.05), {0.0, 0.2}),
    ],
)
def test_a_position_counts_from_its_other_end(
    stroke: tuple[float, float], read: tuple[float, float], sums: set[float]
) -> None:
    noise = 5e-5 * np.random.default_rng(1).standard_normal(500)
    column = np.clip(np.linspace(-1.0, 1.0, 500), -0.5, 0.5)
    column = read[0] + (read[1] - read[0]) * (column + 0.5) + noise
    plant = SimpleNamespace(position_range=lambda _: {"rod": stroke})
    base: Any = SimpleNamespace(
        problem=SimpleNamespace(plant=plant),
        dataset=SimpleNamespace(model=SimpleNamespace(vector=lambda: np.zeros(0))),
        measured=[SimpleNamespace(column=lambda _: column)],
    )
    found = {item.sums[0][1] for item in _reversals(base, ["rod"])}
    assert sorted(found) == pytest.approx(sorted(sums))
