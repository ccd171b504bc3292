"""Sweeps, the kernel without effects, and plain C: three ways to the same numbers."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eha_bench.core.errors import InputError
from eha_bench.plants.eha_knee.plant import EhaKnee
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive, get_plant

STEP = 50e-6
N = 301
TIME = np.arange(N) / 1000.0
WAVES = {
    "stick and slip": 1.8 * np.sin(2 * np.pi * 7.0 * TIME),
    "reversing": 12.0 * np.sign(np.sin(2 * np.pi * 9.0 * TIME)),
    "into the end": np.full(N, 15.0),
    "over the limit": np.linspace(-200.0, 200.0, N),
}


@pytest.fixture(scope="module")
def plant() -> EhaKnee:
    found = get_plant("eha_knee")
    assert isinstance(found, EhaKnee)
    return found


def sets(plant: EhaKnee, count: int, seed: int) -> np.ndarray:
    """Parameter sets around the paper's, friction of the rod from none to a lot."""
    rng = np.random.default_rng(seed)
    vectors = np.repeat(plant.layout.defaults()[None], count, axis=0)
    own = [parameter.name for parameter in plant.layout.parameters]
    for column, name in enumerate(own):
        if name.endswith("creep_speed"):
            continue
        vectors[:, column] *= rng.uniform(0.7, 1.4, count)
    index = plant.layout.index
    vectors[:, index["rod_coulomb"]] = rng.choice([0.0, 5.0, 80.0], count)
    low = vectors[:, index["coulomb_torque"]]
    vectors[:, index["static_torque"]] = np.maximum(vectors[:, index["static_torque"]], low)
    return vectors


def one_by_one(plant: EhaKnee, vectors: np.ndarray, drive: Drive) -> np.ndarray:
    return np.stack([plant.simulate(vector, drive, STEP) for vector in vectors])


def assert_same(found: np.ndarray, wanted: np.ndarray, tolerance: float) -> None:
    scale = np.nanmax(np.abs(wanted), axis=(0, 1)) + 1e-300
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    assert np.nanmax(np.abs(found - wanted) / scale) <= tolerance


@pytest.mark.parametrize("wave", WAVES)
@pytest.mark.parametrize(("locked", "bypass"), [(False, False), (True, False), (True, True)])
def test_a_sweep_is_many_simulations(plant: EhaKnee, wave: str, locked: bool, bypass: bool) -> None:
    force = 300.0 * np.sin(2 * np.pi * 3.0 * TIME)
    drive = Drive(TIME, {"current_command": WAVES[wave], "force": force},
                  {"piston_position": 0.004, "pressure_a": 2e6}, locked, bypass)  # fmt: skip
    vectors = sets(plant, 11, seed=len(wave))
    wanted = one_by_one(plant, vectors, drive)
    # what stops within a step may do so a rounding sooner or later
    assert_same(plant.sweep(vectors, drive, STEP), wanted, 1e-9)


@settings(max_examples=20)
@given(
    st.integers(0, 1000), st.integers(1, 20), st.floats(0.0, 30.0), st.floats(0.3, 60.0),
    st.floats(-0.03, 0.03),
)  # fmt: skip
def test_any_sweep_is_many_simulations(
    seed: int, count: int, amplitude: float, frequency: float, position: float
) -> None:
    plant = get_plant("eha_knee")
    assert isinstance(plant, EhaKnee)
    time = np.sort(np.random.default_rng(seed).uniform(0.0, 0.05, 40)).round(5)
    time = np.unique(time)
    command = amplitude * np.sin(2 * np.pi * frequency * time)
    drive = Drive(time, {"current_command": command}, {"piston_position": position})
    vectors = sets(plant, count, seed)
    assert_same(plant.sweep(vectors, drive, STEP), one_by_one(plant, vectors, drive), 1e-8)


def test_what_does_not_go_in_step_is_simulated_one_by_one(plant: EhaKnee) -> None:
    index = plant.layout.index
    vectors = sets(plant, 6, seed=3)
    vectors[1, index["rod_creep_speed"]] = 0.01
    vectors[2, index["pump_creep_speed"]] = 1.0
    vectors[4, index["entrained_air.air_fraction"]] = 0.03
    drive = Drive(TIME, {"current_command": WAVES["reversing"]}, first=20)
    wanted = one_by_one(plant, vectors, drive)
    found = plant.sweep(vectors, drive, STEP)
    assert_same(found, wanted, 1e-9)
    np.testing.assert_array_equal(found[[1, 2, 4]], wanted[[1, 2, 4]])
    assert np.isnan(found[:, :20]).all()
    imposed = Drive(TIME, {"motor_speed": 20.0 * np.sin(9.0 * TIME)})
    np.testing.assert_array_equal(
        plant.sweep(vectors, imposed, STEP), one_by_one(plant, vectors, imposed)
    )


def test_a_sweep_refuses_what_a_simulation_refuses(plant: EhaKnee) -> None:
    drive = Drive(TIME, {"current_comand": np.zeros(N)})
    with pytest.raises(InputError, match="cannot be an input"):
        plant.sweep(sets(plant, 2, 0), drive, STEP)


def test_the_linear_drive_sweeps_too() -> None:
    model = Model("linear_drive", effects=(DeclaredEffect("coulomb_friction", {}),))
    vectors = np.stack([model.vector(), Model("linear_drive").vector()])
    drive = Drive(TIME, {"voltage": np.sin(9.0 * TIME)})
    found = model.plant.sweep(vectors, drive, 1e-4)
    np.testing.assert_array_equal(found[1], model.plant.simulate(vectors[1], drive, 1e-4))


@pytest.mark.parametrize("wave", WAVES)
def test_with_all_effects_off_the_full_kernel_is_the_bare_one(plant: EhaKnee, wave: str) -> None:
    rng = np.random.default_rng(1)
    vector = sets(plant, 1, seed=5)[0]
    strengths = {f"{effect.id}.{effect.strength.name}" for effect in plant.layout.effects}
    for key, parameter in plant.layout.items():
        if "." in key and key not in strengths and not parameter.choices and parameter.size == 1:
            high = min(parameter.high, 2.0 * abs(parameter.default) + 1e-9)
            low = max(parameter.low, parameter.default / 2.0)
            vector[plant.layout.index[key]] = rng.uniform(min(low, high), high)
    compiled, parameters, memory = plant.kernel_for(vector)
    assert parameters.size < vector.size
    outs = []
    for kernel, own, effects in (
        (compiled, parameters, memory),
        (plant.compiled, vector, np.zeros(plant.layout.memory)),
    ):
        out, state = np.full((N, 6), np.nan), plant.start_state(vector, {"pressure_a": 1e6})
        kernel.simulate(
            0, N - 1, TIME, WAVES[wave], np.zeros((N, 2)), np.zeros((N, 6)),
            np.zeros(6, dtype=np.bool_), False, False, STEP, True, own, effects, state, out,
        )  # fmt: skip
        outs.append(out)
    np.testing.assert_array_equal(*outs)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_plain_c_computes_the_same(plant: EhaKnee, tmp_path: Path, repository: Path) -> None:
    source, library = repository / "benchmarks" / "knee.c", tmp_path / "knee.so"
    command = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", str(library)]
    subprocess.run([*command, str(source), "-lm"], check=True)
    simulate = ctypes.CDLL(str(library)).simulate
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C")
    simulate.argtypes = [ctypes.c_int, pointer, pointer, pointer, ctypes.c_int, ctypes.c_int,
                         ctypes.c_double, pointer, pointer, pointer]  # fmt: skip
    vectors = sets(plant, 4, seed=9)
    vectors[2, plant.layout.index["rod_creep_speed"]] = 0.01
    vectors[3, plant.layout.index["pump_creep_speed"]] = 1.0
    force = 300.0 * np.sin(2 * np.pi * 3.0 * TIME)
    for wave in WAVES.values():
        for locked, bypass in ((False, False), (True, True)):
            drive = Drive(TIME, {"current_command": wave, "force": force}, {}, locked, bypass)
            for vector in vectors:
                out, state = np.empty((N, 6)), plant.start_state(vector, {})
                simulate(N, TIME, wave, force, locked, bypass, STEP, vector, state, out)
                assert_same(plant.simulate(vector, drive, STEP)[None], out[None], 1e-9)
