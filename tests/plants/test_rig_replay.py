"""The kernel with one effect replays recordings of another simulator of the rig to the noise.

The parameters were fitted to these recordings; the effect's strength is the one that the answers
beside them say. Other equations, another integrator: agreement down to the noise is no accident.
"""

from __future__ import annotations

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.plants.model import DeclaredEffect, load_model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

# noise and quantisation of the rig
SIGMA = {
    "current": 0.05, "motor_speed": 0.1, "pressure_a": 0.0303e6, "pressure_b": 0.0303e6,
    "piston_position": 4.04e-6, "piston_velocity": 1e-3,
}  # fmt: skip
FITTED = (
    "coulomb_torque", "static_torque", "viscous_torque", "leakage", "bulk_modulus", "rotor_inertia",
)  # fmt: skip
CASES = {
    "A": (DeclaredEffect("entrained_air", {"air_fraction": 0.025}),
          (0.9403, 0.9998, 1.0164, 0.9246, 0.9438, 1.0686)),
    "B": (DeclaredEffect("pressure_dependent_friction", {"friction_coefficient": 0.04}),
          (0.9603, 1.0712, 0.9502, 0.9487, 0.9759, 0.9568)),
    "C": (DeclaredEffect("current_lag", {"time_constant": 2e-3}),
          (1.0589, 1.0566, 1.0495, 0.9618, 0.9324, 1.0714)),
    "D": (None, (1.0530, 0.9776, 1.0324, 1.0576, 1.0226, 1.0077)),
    "E": (DeclaredEffect("pressure_sensor_lag", {"time_constant": 3e-3}),
          (1.0316, 1.0503, 0.9745, 0.9272, 1.0114, 0.9434)),
}  # fmt: skip


def _chi_squared(folder, log, channels, model, *, locked, bypass):
    recording = eb.read(str(folder / log), channels=str(folder / channels))
    time = np.asarray(recording.time)
    start = {} if locked else {"piston_position": float(recording["reference"][0])}
    drive = Drive(
        time - time[0], {"current_command": recording["current_command"]}, start, locked, bypass
    )
    out = get_plant("eha_knee").simulate(model.vector(), drive, 50e-6)
    outputs = get_plant("eha_knee").outputs
    return {
        name: float(np.mean(((recording[name] - out[:, k]) / SIGMA[name]) ** 2))
        for k, name in enumerate(outputs)
    }


@pytest.mark.parametrize("case", sorted(CASES))
def test_locked_and_bypass_runs_are_replayed_to_the_noise(shared_data, case) -> None:
    folder = shared_data / "rig_samples" / case
    effect, factors = CASES[case]
    model = load_model(folder / "model.yaml")
    values = {
        name: model.value(name) * factor for name, factor in zip(FITTED, factors, strict=True)
    }
    model = model.with_parameters({**values, "initial_pressure": 0.6e6})
    if effect is not None:
        model = model.with_effect(effect)
    for log, channels, bypass in (
        ("locked_steps.mcap", "channels_1.yaml", False),
        ("locked_prbs.mcap", "channels_0.yaml", False),
        ("bypass_ramps.mcap", "channels_0.yaml", True),
    ):
        found = _chi_squared(folder, log, channels, model, locked=True, bypass=bypass)
        for name, value in found.items():
            assert 0.9 < value < 1.15, f"{log} {name}: {value:.3f}"


def test_free_runs_are_replayed_to_the_noise_with_a_rod_that_creeps(shared_data) -> None:
    folder = shared_data / "rig_samples" / "D"
    model = load_model(folder / "model.yaml")
    values = {
        name: model.value(name) * factor for name, factor in zip(FITTED, CASES["D"][1], strict=True)
    }
    rod = {
        "rod_viscous": 1.042 * 800.0, "rod_coulomb": 1.034 * 60.0, "external_force": 0.9947 * 300.0,
        "rod_creep_speed": 1e-4, "initial_pressure": 0.6e6,
    }  # fmt: skip
    model = model.with_parameters({**values, **rod})
    for log in ("free_steps.mcap", "free_swing.mcap", "free_sine.mcap"):
        found = _chi_squared(folder, log, "channels_2.yaml", model, locked=False, bypass=False)
        for name, value in found.items():
            assert 0.9 < value < 1.3, f"{log} {name}: {value:.3f}"
