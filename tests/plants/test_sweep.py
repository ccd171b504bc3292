"""Sweeps, the kernel without effects, and plain C: three ways to the same numbers."""

import ctypes
import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eha_bench.core.errors import InputError
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.network import vector_math
from eha_bench.plants.network.file import load_plant, plant_of
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.vector_math import vectorised_law
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

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
def plant() -> NetworkPlant:
    found = get_plant("eha_knee")
    assert isinstance(found, NetworkPlant)
    return found


def sets(plant: NetworkPlant, count: int, seed: int) -> np.ndarray:
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


def one_by_one(plant: NetworkPlant, vectors: np.ndarray, drive: Drive) -> np.ndarray:
    return np.stack([plant.simulate(vector, drive, STEP) for vector in vectors])


def assert_same(found: np.ndarray, wanted: np.ndarray, tolerance: float) -> None:
    scale = np.nanmax(np.abs(wanted), axis=(0, 1)) + 1e-300
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    assert np.nanmax(np.abs(found - wanted) / scale) <= tolerance


@pytest.mark.parametrize("wave", WAVES)
@pytest.mark.parametrize(("locked", "bypass"), [(False, False), (True, False), (True, True)])
def test_a_sweep_is_many_simulations(
    plant: NetworkPlant, wave: str, locked: bool, bypass: bool
) -> None:
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
    assert isinstance(plant, NetworkPlant)
    time = np.sort(np.random.default_rng(seed).uniform(0.0, 0.05, 40)).round(5)
    time = np.unique(time)
    command = amplitude * np.sin(2 * np.pi * frequency * time)
    drive = Drive(time, {"current_command": command}, {"piston_position": position})
    vectors = sets(plant, count, seed)
    assert_same(plant.sweep(vectors, drive, STEP), one_by_one(plant, vectors, drive), 1e-8)


def test_what_does_not_go_in_step_is_simulated_one_by_one(plant: NetworkPlant) -> None:
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


def test_a_sweep_refuses_what_a_simulation_refuses(plant: NetworkPlant) -> None:
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
def test_with_all_effects_off_the_full_kernel_is_the_bare_one(
    plant: NetworkPlant, wave: str
) -> None:
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
    drive = Drive(TIME, {"current_command": WAVES[wave]})
    inputs = plant.inputs_of(drive, vector)
    full = plant.compiled, vector, np.zeros(plant._hooks.memory)
    outs = []
    for kernel, own, signals in ((compiled, parameters, memory), full):
        out, shown = np.full((N, 6), np.nan), np.zeros(plant.system.size + 1)
        state = plant.start_state({"pressure_a": 1e6}, kernel, own, signals)
        kernel.simulate(
            0, N - 1, inputs.time, inputs.values, inputs.given, inputs.imposed, inputs.is_imposed,
            False, False, STEP, True, own, signals, shown, state, out,
        )  # fmt: skip
        outs.append(out)
    np.testing.assert_array_equal(*outs)


def built(folder: Path, source: Path) -> Callable[..., None]:
    """Return `simulate` of a C file, compiled so that sums and products are rounded one by one."""
    library = folder / f"{source.stem}.so"
    command = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", str(library)]
    subprocess.run([*command, str(source), "-lm"], check=True)
    simulate: Callable[..., None] = ctypes.CDLL(str(library)).simulate
    return simulate


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_plain_c_computes_the_same(plant: NetworkPlant, tmp_path: Path, repository: Path) -> None:
    simulate = built(tmp_path, repository / "benchmarks" / "knee.c")
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
                out, state = np.empty((N, 6)), np.zeros(7)
                state[2:4] = vector[plant.layout.index["initial_pressure"]]
                simulate(N, TIME, wave, force, locked, bypass, STEP, vector, state, out)
                assert_same(plant.simulate(vector, drive, STEP)[None], out[None], 1e-9)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("locked", [False, True])
def test_plain_c_moves_a_valve_and_its_cylinder_the_same(
    tmp_path: Path, repository: Path, locked: bool
) -> None:
    simulate = built(tmp_path, repository / "benchmarks" / "valve_cylinder.c")
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C")
    simulate.argtypes = [ctypes.c_int, pointer, pointer, ctypes.c_int, ctypes.c_double, pointer,
                         pointer, pointer]  # fmt: skip
    plant = load_plant(repository / RIGS["valve and cylinder"][0])
    for damping in (0.7, 1.0, 1.6):
        for wave in (3.0 * np.sin(20.0 * TIME), 9.0 * np.sign(np.sin(31.0 * TIME))):
            vector = plant.layout.defaults()
            vector[plant.layout.index["valve.damping_ratio"]] = damping
            vector[plant.layout.index["valve.null_bias"]] = 0.01
            out, state = np.empty((N, 4)), np.zeros(5)
            state[1] = 0.1
            drive = Drive(TIME, {"valve_command": wave}, {"piston_position": 0.1}, locked)
            simulate(N, TIME, wave, locked, STEP, vector, state, out)
            assert_same(plant.simulate(vector, drive, STEP)[None], out[None], 1e-9)


# --- other networks ----------------------------------------------------------------------------

RIGS = {
    "valve and cylinder": ("fixtures/rigs/valve_cylinder/plant.yaml", "valve_command", 6.0),
    "geared servo": ("fixtures/rigs/geared_servo/plant.yaml", "duty", 0.4),
    "linear drive": ("suites/plants/linear_drive.yaml", "voltage", 5.0),
}


@pytest.mark.parametrize(
    "rig",
    [
        pytest.param("valve and cylinder", marks=pytest.mark.slow),
        pytest.param("geared servo", marks=pytest.mark.slow),
        "linear drive",
    ],
)
def test_a_sweep_of_any_network_is_many_simulations(rig: str, repository: Path) -> None:
    path, command, amplitude = RIGS[rig]
    plant = load_plant(repository / path)
    rng = np.random.default_rng(0)
    vectors = np.repeat(plant.layout.defaults()[None], 11, axis=0)
    for key, place in plant.bare.index.items():
        if not key.endswith("creep_speed"):
            vectors[:, place] *= rng.uniform(0.8, 1.2, len(vectors))
    assert plant.command == command
    for wave in (np.sin(40.0 * TIME), np.sign(np.sin(30.0 * TIME))):
        drive = Drive(TIME, {command: amplitude * wave}, first=4)
        wanted = one_by_one(plant, vectors, drive)
        assert np.isfinite(wanted[:, 4:]).all()
        assert_same(plant.sweep(vectors, drive, STEP), wanted, 1e-9)
    assert plant.sweep_kernel is not None


CIRCUIT = {
    "plant": "valves",
    "nodes": {
        "shaft": {"kind": "rotation", "inertia": "0.002 kg*m^2"},
        "chamber_a": {"kind": "volume", "bulk_modulus": "1.1 GPa", "pressure": "3 bar"},
        "chamber_b": {"kind": "volume", "bulk_modulus": "1.1 GPa", "pressure": "3 bar"},
        "gas": {"kind": "volume"},
        "rod": {"kind": "translation", "mass": "80 kg", "stroke": ["-60 mm", "60 mm"]},
    },
    "elements": {
        "motor": {"kind": "motor", "on": "shaft", "torque_constant": "0.2 N*m/A",
                  "current_limit": "30 A"},
        "drag": {"kind": "friction", "on": "shaft", "coulomb": "0.2 N*m",
                 "viscous": "0.005 N*m*s/rad"},
        "pump": {"kind": "pump", "on": "shaft", "from": "chamber_b", "to": "chamber_a",
                 "displacement": "4e-7 m^3/rad"},
        "leak": {"kind": "laminar_leakage", "between": ["chamber_a", "chamber_b"],
                 "conductance": "1e-12 m^3/(s*Pa)"},
        "cylinder": {"kind": "cylinder", "on": "rod", "a": "chamber_a", "b": "chamber_b",
                     "area_a": "8 cm^2", "area_b": "5 cm^2", "dead_volume_a": "20 cm^3",
                     "dead_volume_b": "20 cm^3"},
        "accumulator": {"kind": "accumulator", "on": "gas", "precharge": "3 bar",
                        "gas_volume": "300 cm^3", "mid_stroke_of": "cylinder"},
        "check_a": {"kind": "check_valve", "from": "gas", "to": "chamber_a",
                    "cracking_pressure": "0.2 bar", "conductance": "1e-9 m^3/(s*Pa)"},
        "check_b": {"kind": "check_valve", "from": "gas", "to": "chamber_b",
                    "cracking_pressure": "0.2 bar", "conductance": "1e-9 m^3/(s*Pa)"},
        "return_a": {"kind": "pilot_check_valve", "from": "chamber_a", "to": "gas",
                     "pilot": "chamber_b", "ratio": 3, "cracking_pressure": "0.5 bar",
                     "opening_range": "3 bar", "conductance": "1e-9 m^3/(s*Pa)"},
        "return_b": {"kind": "pilot_check_valve", "from": "chamber_b", "to": "gas",
                     "pilot": "chamber_a", "ratio": 3, "cracking_pressure": "0.5 bar",
                     "opening_range": "3 bar", "conductance": "1e-9 m^3/(s*Pa)"},
        "seals": {"kind": "friction", "on": "rod", "coulomb": "100 N", "viscous": "900 N*s/m"},
    },
    "inputs": {"current_command": "motor.current"},
    "channels": {"pressure_a": "chamber_a.pressure", "pressure_b": "chamber_b.pressure",
                 "gas_pressure": "gas.pressure", "piston_position": "rod.position"},
}  # fmt: skip


@pytest.mark.slow  # compiles two kernels
@pytest.mark.parametrize("step", [20e-6, 100e-6])
def test_a_sweep_meets_valves_that_switch(step: float) -> None:
    plant = plant_of(CIRCUIT)
    vectors = np.repeat(plant.layout.defaults()[None], 8, axis=0)
    vectors[:, plant.layout.index["leak.conductance"]] *= np.linspace(0.5, 20.0, 8)
    drive = Drive(TIME, {"current_command": 9.0 * np.sign(np.sin(25.0 * TIME))})
    wanted = np.stack([plant.simulate(vector, drive, step) for vector in vectors])
    assert_same(plant.sweep(vectors, drive, step), wanted, 1e-8)
    assert plant.sweep_kernel is not None


SERVO = {
    "plant": "servo",
    "nodes": {"shaft": {"kind": "rotation", "inertia": "0.01 kg*m^2"}},
    "elements": {
        "motor": {"kind": "motor", "on": "shaft", "resistance": "2 ohm",
                  "torque_constant": "0.3 N*m/A", "voltage_limit": "12 V"},
        "loop": {"kind": "position_servo", "on": "shaft", "motor": "motor",
                 "proportional": "30 V/rad", "derivative": "0.2 V*s/rad", "period": "1 ms"},
        "pendulum": {"kind": "pendulum", "on": "shaft", "mass": "1 kg", "length": "200 mm"},
        "bearing": {"kind": "friction", "on": "shaft", "coulomb": "0.1 N*m",
                    "viscous": "0.01 N*m*s/rad"},
    },
    "inputs": {"position_command": "loop.reference", "voltage_command": "motor.voltage"},
    "channels": {"angle": "shaft.angle", "velocity": "shaft.speed"},
}  # fmt: skip


@pytest.mark.slow  # compiles two kernels
def test_a_controller_inside_a_plant_is_swept_one_by_one() -> None:
    plant = plant_of(SERVO)
    vectors = np.repeat(plant.layout.defaults()[None], 4, axis=0)
    vectors[:, plant.layout.index["bearing.coulomb"]] *= np.linspace(0.5, 2.0, 4)
    open_loop = Drive(TIME, {"voltage_command": 6.0 * np.sin(9.0 * TIME)})
    wanted = one_by_one(plant, vectors, open_loop)
    assert_same(plant.sweep(vectors, open_loop, STEP), wanted, 1e-9)
    drive = Drive(TIME, {"position_command": 0.2 * np.sin(9.0 * TIME)})
    np.testing.assert_array_equal(
        plant.sweep(vectors, drive, STEP), one_by_one(plant, vectors, drive)
    )


def looping(speed: float) -> float:
    total = 0.0
    for _ in range(3):
        total += speed
    return total


def powered(speed: float, order: float) -> float:
    return speed**order


def calling(speed: float) -> float:
    return math.erf(speed)


def through(speed: float) -> float:
    return abs(powered(speed, 2.0))


def plain(speed: float) -> float:
    return min(math.exp(-speed), math.tau) if speed > 0.0 else math.fabs(math.cos(speed))


def test_what_cannot_be_vectorised_is_known_beforehand() -> None:
    for law in (looping, powered, calling, through):
        assert vectorised_law(law) is None
    twin = vectorised_law(plain)
    assert twin is not None
    assert numba.njit(twin)(0.3) == pytest.approx(math.exp(-0.3), rel=1e-15)


@pytest.mark.parametrize(
    ("name", "low", "high", "absolute"),
    [("exp", -700.0, 700.0, 0.0), ("log", 1e-300, 1e300, 1e-16), ("tanh", -30.0, 30.0, 0.0),
     ("sin", -1e5, 1e5, 2e-16), ("cos", -1e5, 1e5, 2e-16)],
)  # fmt: skip
def test_vector_functions_are_the_c_librarys(
    name: str, low: float, high: float, absolute: float
) -> None:
    own = getattr(vector_math, name)
    compiled = numba.njit(own.py_func)
    rng = np.random.default_rng(0)
    points = [*rng.uniform(low, high, 2000), *rng.uniform(max(low, 1e-3), 3.0, 2000)]
    for x in points:
        wanted = getattr(math, name)(x)
        assert abs(compiled(x) - wanted) <= 6e-16 * abs(wanted) + absolute
    assert math.isnan(compiled(math.nan))
    if name != "tanh":
        assert math.isnan(compiled(1e309))


def test_a_power_is_the_c_librarys() -> None:
    compiled = numba.njit(vector_math.pow.py_func)
    rng = np.random.default_rng(0)
    for x, y in zip(rng.uniform(0.05, 20.0, 2000), rng.uniform(-3.0, 3.0, 2000), strict=True):
        assert compiled(x, y) == pytest.approx(x**y, rel=5e-15)
    assert math.isnan(compiled(-1.0, 2.0))
