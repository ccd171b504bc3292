"""A calibration arrives from far away, and says where it did not."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.calibrate import calibrate
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.convergence import convergence, moved_notes
from eha_bench.diagnosis.fit.finish import _with_long_slopes
from eha_bench.diagnosis.fit.least_squares import Fit, Free
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.fit.uncertainty import open_parameters
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

SIZE = 4000
NOISE = np.random.default_rng(0).standard_normal(SIZE)
COLUMNS = np.random.default_rng(1).standard_normal((SIZE, 2))


@pytest.mark.parametrize(
    "factors",
    [
        (20.0, 0.05),
        pytest.param((20.0, 1.0), marks=pytest.mark.slow),
        pytest.param((0.05, 20.0), marks=pytest.mark.slow),
    ],
)
def test_a_start_twenty_times_off_arrives(tmp_path, factors):
    path = write_drive(tmp_path, friction=0.0, seconds=1.2)
    text = "model: linear_drive\nparameters: {{mass: {} kg, viscous_friction: {} N*s/m}}\n"
    text += "calibrate: [mass, viscous_friction]\n"
    (tmp_path / "model.yaml").write_text(text.format(95.0 * factors[0], 210.0 * factors[1]))
    found = calibrate(path, tmp_path / "out")
    assert found.parameters["mass"].value == pytest.approx(93.0, rel=0.02)
    assert found.parameters["viscous_friction"].value == pytest.approx(200.0, rel=0.02)
    content = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert content["convergence"]["converged"] is True
    assert content["convergence"]["residual_over_floor"] == pytest.approx(1.0, abs=0.15)
    assert content["covariance"]["parameters"][:2] == ["mass", "viscous_friction"]
    half = found.parameters["mass"].high - found.parameters["mass"].value
    deviation = content["covariance"]["matrix"][0][0] ** 0.5
    assert 0.3 * half < deviation < 0.6 * half
    assert content["seconds"] > 0.0
    assert any("CAUTION: mass has moved by a factor of" in note for note in found.notes)


def test_what_is_declared_as_nothing_is_found(tmp_path):
    path = write_drive(tmp_path, friction=0.0, seconds=1.2)
    text = "model: linear_drive\nparameters: {mass: 95 kg, viscous_friction: 0}\n"
    (tmp_path / "model.yaml").write_text(text + "calibrate: [mass, viscous_friction]\n")
    found = calibrate(path)
    assert found.parameters["viscous_friction"].value == pytest.approx(200.0, rel=0.02)


def fit_at(vector: np.ndarray, scale: float = 1.0, low: float = -np.inf) -> Fit:
    residual = scale * NOISE - COLUMNS @ vector
    soft, _ = soften(residual)
    free = (Free("a", 0, low, np.inf, 1.0), Free("b", 1, -np.inf, np.inf, 1.0))
    return Fit(vector, free, residual, -COLUMNS, float(soft @ soft))


def test_a_fit_short_of_its_minimum_has_not_converged():
    best = np.linalg.lstsq(COLUMNS, NOISE, rcond=None)[0]
    there, short = convergence(fit_at(best)), convergence(fit_at(best + np.array([0.2, 0.0])))
    assert there.converged
    assert there.has_intervals
    # 0.2 where one standard deviation is 1 / sqrt(4000)
    assert short.distance == pytest.approx(0.2 * np.sqrt(SIZE), rel=0.1)
    assert not short.has_intervals
    assert "has not converged" in short.notes()[0]


def test_no_interval_where_much_is_left():
    best = np.linalg.lstsq(COLUMNS, 3.0 * NOISE, rcond=None)[0]
    found = convergence(fit_at(best, 3.0))
    assert found.ratio == pytest.approx(3.0, rel=0.05)
    assert found.converged
    assert not found.has_intervals
    assert "after calibration the residual is 2.99 times its floor" in found.notes()[0]
    assert "no interval" in found.notes()[0]
    assert found.notes(["sensor_lag", "the learned curve"])[0].startswith(
        "with sensor_lag and the learned curve the residual is 2.99 times its floor: something else"
    )


def test_a_parameter_at_its_bound_holds_no_fit_up_and_is_told():
    fit = fit_at(np.array([0.5, float(COLUMNS[:, 1] @ NOISE) / SIZE]), low=0.5)
    found = convergence(fit)
    assert found.at_bounds == {"a": 0.5}
    assert found.converged


def test_what_went_far_is_told():
    keys = ("bulk_modulus", "leakage", "rotor_inertia")
    model = Model("eha_knee", {}, keys, (), {"rotor_inertia": 1e-5})
    declared = {key: model.value(key) for key in model.calibrate}
    assert moved_notes(model, declared, {}) == []
    moved = {**declared, "bulk_modulus": declared["bulk_modulus"] / 2500.0,
             "rotor_inertia": declared["rotor_inertia"] + 2e-5}  # fmt: skip
    notes = moved_notes(model, moved, {"leakage": 0.0})
    assert "factor of 0.0004" in notes[0]
    assert "leakage is at its bound" in notes[1]
    assert "more than the 1e-05" in notes[2]


class Rough:
    """A residual that follows one combination of two parameters, and noise of every difference."""

    soft = 1.0
    beliefs = ()
    step = 1e-3

    def at_step(self, _step: float) -> Rough:
        return self

    def residual(self, vector: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(abs(hash(vector.tobytes())) % 2**32)
        return NOISE + 30.0 * COLUMNS[:, 0] * (vector.sum() - 2.0) + 0.1 * rng.standard_normal(SIZE)


def test_what_only_differences_make_is_not_determined():
    vector = np.ones(2)
    problem = Rough()
    base = problem.residual(vector)
    free = tuple(Free(name, k, -np.inf, np.inf, 1.0) for k, name in enumerate("ab"))
    columns = [(problem.residual(vector + 0.01 * unit) - base) / 0.01 for unit in np.eye(2)]
    fit = Fit(vector, free, base, np.column_stack(columns), float(base @ base))
    assert open_parameters(fit) == frozenset()
    better = _with_long_slopes(problem, fit)
    apart = np.linalg.norm(better.jacobian @ [1.0, -1.0])
    assert apart < 0.2 * np.linalg.norm(fit.jacobian @ [1.0, -1.0])
    together = np.linalg.norm(better.jacobian @ [1.0, 1.0])
    assert together == pytest.approx(60.0 * np.sqrt(SIZE), rel=0.1)


@pytest.mark.slow
def test_what_can_be_scaled_together_is_named(tmp_path):
    """K_T, J, friction, D_p, leakage and 1 / beta of locked runs: any factor fits alike."""
    rng = np.random.default_rng(3)
    charge = DeclaredEffect("anti_cavitation",
                            {"charge_pressure": 6e5, "valve_conductance": 6e-10})  # fmt: skip
    true = {"viscous_torque": 0.0055, "bulk_modulus": 8.67e8, "coulomb_torque": 0.17}
    truth = Model("eha_knee", true, (), (charge,))
    time = np.arange(0.0, 3.0, 1e-3)
    lines = []
    for k in range(3):
        command = 7.0 * np.sin(2 * np.pi * (0.7 + 0.5 * k) * time + k) * np.clip(time - 0.3, 0, 1)
        command += 5.0 * np.sign(np.sin(2 * np.pi * 0.9 * time + k)) * (time > 0.3)
        start = {"piston_position": 0.0, "pressure_a": 6e5, "pressure_b": 6e5}
        drive = Drive(time, {"current_command": command}, start, locked=True)
        values = truth.plant.simulate(truth.vector(), drive, 1e-4).T
        out = dict(zip(truth.plant.outputs, values, strict=True))
        noise = {"current": 0.05, "motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}
        read = {n: out[n] + s * rng.standard_normal(time.size) for n, s in noise.items()}
        write(tmp_path / f"r{k}.mcap", Recording(time, {**read, "current_command": command}))
        lines.append(f"  - {{log: r{k}.mcap, piston: locked}}\n")
    keys = ["torque_constant", "rotor_inertia", "coulomb_torque", "static_torque",
            "viscous_torque", "pump_displacement", "leakage", "bulk_modulus"]  # fmt: skip
    declared = Model("eha_knee", {"torque_constant": 0.1495, "rotor_inertia": 0.0012},
                     tuple(keys), (charge,))  # fmt: skip
    declared.write(tmp_path / "model.yaml")
    path = tmp_path / "dataset.yaml"
    path.write_text("model: model.yaml\nruns:\n" + "".join(lines))
    found = calibrate(load_dataset(path))
    words = next(text for text in found.undetermined if "only in combination" in text)
    assert all(key in words for key in keys)
    for key in keys:
        item = found.parameters[key]
        assert item.low < truth.value(key) < item.high or not np.isfinite(item.low), key
