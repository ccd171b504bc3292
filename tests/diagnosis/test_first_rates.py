"""Runs that begin in motion, of which only the position is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data import first_rates as rates_module
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.data.first_rates import _rate, first_rates
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import gather
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.replay.prediction import predict

STEP = 0.0015
"""Step of the angle's sensor, rad."""
PLANT = """\
plant: arm
nodes:
  joint: {kind: rotation, inertia: 0.012 kg*m^2}
elements:
  arm:   {kind: pendulum, on: joint, mass: 0.5 kg, length: 0.2 m, hanging_angle: -90 deg}
  train: {kind: friction, on: joint, viscous: 0.03 N*m*s/rad}
inputs: {}
channels: {angle: joint.angle}
calibrate: [joint.inertia, train.viscous]
"""


def fall(time: FloatArray, dry: float, begins: float) -> FloatArray:
    """Return (n,) angles of an arm that falls and swings, by another integrator, rad.

    Args:
        time: (n,) s. dry: friction, N*m. begins: angle at which it is let go.
    """

    def rates(_: float, state: FloatArray) -> tuple[float, float]:
        angle, speed = state
        torque = -0.5 * 9.80665 * 0.2 * np.cos(angle) - 0.02 * speed - dry * np.tanh(speed / 0.01)
        return speed, torque / (0.01 + 0.5 * 0.2**2)

    found = solve_ivp(rates, (0.0, time[-1]), (begins, 0.0), t_eval=time, rtol=1e-10, atol=1e-12)
    return np.asarray(found.y[0])


def logs(folder: Path, dry: float, cut: int) -> Path:
    """Write a dataset of three swings, of which each log begins `cut` rows after the release."""
    (folder / "plant.yaml").write_text(PLANT)
    (folder / "channels.yaml").write_text(
        "time: {column: time, unit: s}\n"
        f"channels: {{angle: {{column: angle, unit: rad, resolution: {STEP} rad}}}}\n"
    )
    rows = []
    for number, begins in enumerate((0.0, 0.5, 0.25)):
        time = np.arange(0.0, 2.0, 0.01)
        angle = np.round(fall(time, dry, begins) / STEP) * STEP
        table = np.column_stack([time[cut:] - time[cut], angle[cut:]])
        np.savetxt(folder / f"{number}.csv", table, delimiter=",", header="time,angle", comments="")
        rows.append(f"  - {{log: {number}.csv, use: {'holdout' if number == 2 else 'train'}}}\n")
    path = folder / "dataset.yaml"
    path.write_text(
        "model: plant.yaml\nchannels: channels.yaml\ninputs: []\nruns:\n" + "".join(rows)
    )
    return path


@pytest.mark.parametrize("cut", [12, 25, 40])
def test_a_run_that_begins_in_motion_tells_its_rate(tmp_path: Path, cut: int) -> None:
    """Known answer: the speed of the other integrator at that row."""
    measured, *_ = gather(load_dataset(logs(tmp_path, 0.1, cut)))
    for item, begins in zip(measured, (0.0, 0.5), strict=True):
        before, after = fall(np.array([0.0, cut * 0.01 - 1e-4, cut * 0.01 + 1e-4]), 0.1, begins)[1:]
        rate = first_rates(item)["joint_speed"]
        assert rate.value == pytest.approx((after - before) / 2e-4, abs=3.0 * rate.spread)
        assert rate.spread < 0.2


def test_a_run_from_rest_has_none(tmp_path: Path) -> None:
    measured, *_ = gather(load_dataset(logs(tmp_path, 0.1, 0)))
    assert [first_rates(item) for item in measured] == [{}, {}]


@pytest.mark.parametrize("power", [2, 3, 4])
def test_what_begins_at_rest_has_no_rate(power: int) -> None:
    """A step of the acceleration, a jolt and what follows it; hardly any noise hides them."""
    noise = np.random.default_rng(power)
    time = np.arange(200) * 1e-3
    rate = _rate(time, 40.0 * time**power + 1e-7 * noise.standard_normal(200))
    assert rate is None or abs(rate.value) < 5.0 * rate.spread


def test_rates_lie_within_what_is_said_of_them() -> None:
    """Coverage over noise: 95 % of the rates, and more, as what one more term changes counts."""
    noise = np.random.default_rng(5)
    time = np.arange(200) * 1e-3
    inside = []
    for _ in range(300):
        values = 0.7 * time + 3.0 * time**2 - 8.0 * time**3 + 1e-4 * noise.standard_normal(200)
        rate = _rate(time, values)
        if rate is not None:
            inside.append(abs(rate.value - 0.7) < 1.96 * rate.spread)
    assert len(inside) > 240
    assert np.mean(inside) >= 0.95


def test_dry_friction_of_a_fall_that_was_cut_out_of_its_motion(tmp_path: Path) -> None:
    """A plant without any input, and logs that begin in the fall: it was `none`."""
    found = diagnose(logs(tmp_path, 0.1, 15))
    assert found.verdict is Verdict.EFFECT
    assert [item.id for item in found.effects] == ["coulomb_friction"]
    force = found.effects[0].parameters["friction_force"]
    assert force.value == pytest.approx(0.1, rel=0.1)


def test_a_prediction_says_at_what_speed_it_starts(tmp_path: Path) -> None:
    path = logs(tmp_path, 0.0, 15)
    for item in predict(path, tmp_path / "plant.yaml"):
        assert any(
            "no 'joint_speed' in the log: it starts at" in note and "as its position moves" in note
            for note in item.notes
        )


def test_a_plant_without_inputs_needs_none_in_the_dataset(tmp_path: Path) -> None:
    path = logs(tmp_path, 0.1, 15)
    path.write_text(path.read_text().replace("inputs: []\n", ""))
    assert load_dataset(path).inputs == ()


def test_readings_that_do_not_move_yet_begin_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """A servo that is told to move in the first row: a polynomial has it swing back first."""
    step = 2.0 * np.pi / 4096.0
    # what a fast motion leaves of its second differences
    monkeypatch.setattr(rates_module, "noise_of", lambda _: step)
    ticks = np.array([0, 0, 11, 40, 73, 107, 136, 161, 182, 197, 208, 214])
    stamps = [0.0, 20.0, 41.1, 61.6, 80.6, 100.5, 119.9, 139.9, 161.0, 181.3, 201.3, 220.0]
    found = _rate(1e-3 * np.array(stamps), ticks * step)
    assert found is None or abs(found.value) < 5.0 * found.spread


def test_readings_that_move_from_the_first_one_on_begin_in_motion() -> None:
    time = 0.02 * np.arange(40)
    noise = 2e-4 * np.random.default_rng(2).standard_normal(time.size)
    found = _rate(time, 0.9 * time + 0.4 * time**2 + noise)
    assert found is not None
    assert found.value == pytest.approx(0.9, abs=5.0 * found.spread)
