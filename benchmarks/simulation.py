"""One run against plain C, sweeps against plain C, other solvers, and the start on a new machine.

    python -m benchmarks.simulation [--rounds 25] [--no-cold] [--json FILE]

Two plants, each with a reference in C that holds the same equations and takes the same steps:
`knee.c`, and `valve_cylinder.c` for the rig in `fixtures/rigs/valve_cylinder`. They are compiled by
the system's compiler (`cc -O3`, or $CC), and their results must agree, or nothing is printed. Times
are the processor's, of one thread; ours and C's rounds alternate, and the best of each is taken.
SciPy and JAX stand beside where they are installed.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.table import Row, write_rows

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.network.file import load_plant, shipped_plant
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.plant import Drive

STEP = 25e-6
SETS = 64
MOST_C, LEAST_SWEEP = 1.1, 4.0
COLD_S, WARM_S = 15.0, 0.8
LATER = 3
"""Later starts, of which the fastest counts: the first finds its files on the disk."""

_ROOT = Path(__file__).parent
_VECTOR = np.ctypeslib.ndpointer(np.float64, flags="C")


@dataclass(frozen=True)
class Case:
    """A plant with its reference in C.

    Attributes:
        plant: as the bench compiles it. drives: name -> inputs, of a number of seconds.
        c: what C computes for parameters and a drive, (n, outputs).
        swept: parameters that a sweep draws. effect: strength of one to switch on.
    """

    plant: NetworkPlant
    drives: Callable[[float], dict[str, Drive]]
    c: Callable[[FloatArray, Drive], FloatArray]
    swept: tuple[str, ...]
    effect: str


def c_function(folder: Path, name: str, arguments: list[Any]) -> Callable[..., None]:
    """Return `simulate` of a C file, compiled again."""
    library = folder / f"{name}.so"
    compiler = os.environ.get("CC", "cc")
    command = [compiler, "-O3", "-shared", "-fPIC", "-o", str(library)]
    subprocess.run([*command, str(_ROOT / f"{name}.c"), "-lm"], check=True)
    simulate: Callable[..., None] = ctypes.CDLL(str(library)).simulate
    simulate.argtypes = arguments
    return simulate


def _ticks(seconds: float) -> FloatArray:
    return np.arange(round(1000 * seconds) + 1) / 1000.0


def knee(folder: Path) -> Case:
    """The knee: moving freely, reversing against a locked piston, and with an open bypass."""
    plant = shipped_plant("eha_knee")
    simulate = c_function(folder, "knee", [
        ctypes.c_int, _VECTOR, _VECTOR, _VECTOR, ctypes.c_int, ctypes.c_int, ctypes.c_double,
        _VECTOR, _VECTOR, _VECTOR,
    ])  # fmt: skip
    rest = plant.layout.index["initial_pressure"]

    def drives(seconds: float) -> dict[str, Drive]:
        t = _ticks(seconds)
        reversing, slow = 12.0 * np.sign(np.sin(6 * np.pi * t)), 6.0 * np.sin(2 * np.pi * t)
        return {
            "free rod": Drive(t, {"current_command": 6.0 * np.sin(4 * np.pi * t)}),
            "locked": Drive(t, {"current_command": reversing}, locked=True),
            "bypass": Drive(t, {"current_command": slow}, locked=True, bypass_open=True),
        }

    def c(vector: FloatArray, drive: Drive) -> FloatArray:
        n = drive.time.size
        out, state = np.empty((n, 6)), np.zeros(7)
        state[2:4] = vector[rest]
        simulate(
            n, drive.time, drive.inputs["current_command"], np.zeros(n), drive.locked,
            drive.bypass_open, STEP, vector, state, out,
        )  # fmt: skip
        return out

    swept = ("torque_constant", "rotor_inertia", "viscous_torque", "coulomb_torque", "leakage",
             "bulk_modulus", "load_mass", "rod_viscous")  # fmt: skip
    return Case(plant, drives, c, swept, "entrained_air.air_fraction")


def valve_cylinder(folder: Path) -> Case:
    """The valve-driven cylinder: strokes, small square waves, and against a locked rod."""
    plant = load_plant(_ROOT.parent / "fixtures" / "rigs" / "valve_cylinder" / "plant.yaml")
    simulate = c_function(folder, "valve_cylinder", [
        ctypes.c_int, _VECTOR, _VECTOR, ctypes.c_int, ctypes.c_double, _VECTOR, _VECTOR, _VECTOR,
    ])  # fmt: skip
    rest = [plant.layout.index[f"{name}.pressure"] for name in ("inlet", "chamber_a", "chamber_b")]

    def drives(seconds: float) -> dict[str, Drive]:
        t = _ticks(seconds)
        square = np.sign(np.sin(6 * np.pi * t + 0.1))
        return {
            "stroke": Drive(t, {"valve_command": 3.0 * np.sin(4 * np.pi * t)}),
            "square": Drive(t, {"valve_command": square}),
            "locked rod": Drive(t, {"valve_command": 2.0 * np.sin(60 * np.pi * t)}, locked=True),
        }

    def c(vector: FloatArray, drive: Drive) -> FloatArray:
        n = drive.time.size
        out, state = np.empty((n, 4)), np.zeros(5)
        state[2:] = vector[rest]
        simulate(
            n, drive.time, drive.inputs["valve_command"], drive.locked, STEP, vector, state, out
        )
        return out

    swept = ("oil.bulk_modulus", "rod.mass", "valve.flow_gain", "valve.natural_frequency",
             "valve.damping_ratio", "rod_friction.coulomb", "rod_friction.viscous")  # fmt: skip
    return Case(plant, drives, c, swept, "entrained_air.air_fraction")


def best(acts: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Return the least processor time of each act, their rounds taken in turn."""
    found = [float("inf")] * len(acts)
    for act in acts:
        act()
    for _ in range(rounds):
        for place, act in enumerate(acts):
            began = time.thread_time()
            act()
            found[place] = min(found[place], time.thread_time() - began)
    return found


def parameter_sets(case: Case) -> FloatArray:
    """A fifth around the declared parameters, up and down."""
    rng = np.random.default_rng(0)
    vectors = np.repeat(case.plant.layout.defaults()[None], SETS, axis=0)
    for name in case.swept:
        vectors[:, case.plant.layout.index[name]] *= rng.uniform(0.8, 1.2, SETS)
    return vectors


def agrees(found: FloatArray, wanted: FloatArray, tolerance: float) -> None:
    """Stop where two ways to compute the same do not."""
    scale = np.abs(wanted).max(axis=tuple(range(wanted.ndim - 1))) + 1e-300
    worst = float((np.abs(found - wanted) / scale).max())
    if not worst <= tolerance:
        raise SystemExit(f"the results differ by {worst:.2g} of the range: nothing is comparable")


def against_c(case: Case, rounds: int) -> Iterator[Row]:
    """Yield one run and a sweep beside C."""
    plant = case.plant
    vector = plant.layout.defaults()
    with_effect = vector.copy()
    with_effect[plant.layout.index[case.effect]] = 0.01
    # all inputs in every round: a moment in which the machine is slow is in no figure alone
    long = case.drives(5.0)
    acts: list[Callable[[], object]] = []
    for drive in long.values():
        agrees(plant.simulate(vector, drive, STEP), case.c(vector, drive), 1e-9)
        acts += [
            partial(case.c, vector, drive),
            partial(plant.simulate, vector, drive, STEP),
            partial(plant.simulate, with_effect, drive, STEP),
        ]
    found = best(acts, rounds)
    steps = 5.0 / STEP
    for name, plain, ours, effect in zip(long, found[::3], found[1::3], found[2::3], strict=True):
        note = f"{ours / steps * 1e9:.0f} ns a step"
        what = f"{plant.id}, {name}"
        yield Row(f"{what}: one run / plain C", ours / plain, "", "<", MOST_C, note)
        yield Row(f"{what}: one run with an effect / plain C without", effect / plain)
    vectors = parameter_sets(case)
    short = case.drives(1.0)
    acts = []
    for drive in short.values():
        wanted = np.stack([case.c(v, drive) for v in vectors])
        agrees(plant.sweep(vectors, drive, STEP), wanted, 1e-8)
        acts += [
            lambda d=drive: [case.c(v, d) for v in vectors],
            partial(plant.sweep, vectors, drive, STEP),
        ]
    found = best(acts, rounds)
    for name, plain, ours in zip(short, found[::2], found[1::2], strict=True):
        note = f"{ours / SETS * 1e3:.2f} ms a set and second"
        what = f"{plant.id}, {name}: sweep, plain C / ours a set"
        yield Row(what, plain / ours, "", ">", LEAST_SWEEP, note)


def by_scipy(plant: NetworkPlant, vector: FloatArray, drive: Drive) -> FloatArray:
    """LSODA on the same compiled equations of the knee, an interval of held input at a time.

    With friction that creeps: with friction that sticks it would hardly come off the ground.
    """
    import numba
    from scipy.integrate import solve_ivp

    from eha_bench.plants.pointer import pointer

    kernel, parameters, memory = plant.kernel_for(vector)
    rates = kernel.rates
    current = plant.system.signals["motor.current"]

    @numba.njit
    def slopes(t, y, i, own, signals, shown):
        signals[current] = i
        P, S, X = pointer(own), pointer(signals), pointer(shown)
        f = rates(1e-6, 1.0, 1.0, y[0], y[1], y[2], y[3], y[4], y[5], t, X, P, S)
        return np.array([f[0], y[0], f[2], y[2], f[4], f[6]])

    y = np.zeros(6)
    found = [y]
    for k in range(drive.time.size - 1):
        span = (drive.time[k], drive.time[k + 1])
        own = (float(drive.inputs["current_command"][k]), parameters, memory, np.zeros(7))
        y = solve_ivp(slopes, span, y, "LSODA", args=own, rtol=1e-6, atol=1e-9).y[:, -1]
        found.append(y)
    return np.array(found)


def by_jax(plant: NetworkPlant, vectors: FloatArray, drive: Drive) -> Callable[[], object]:
    """The same steps of the knee over all sets, compiled by XLA; stops are not located."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    P = {name: jnp.asarray(vectors[:, place]) for name, place in plant.bare.index.items()}
    count = round(float(drive.time[1] - drive.time[0]) / STEP)
    gamma = 1.0 - 1.0 / np.sqrt(2.0)

    def rates(y: Any, i: Any) -> Any:
        w, a, b, x, v = y
        fade = jnp.exp(-((w / P["stribeck_speed"]) ** 2))
        level = P["coulomb_torque"] + (P["static_torque"] - P["coulomb_torque"]) * fade
        d_p, a_a, a_b = P["pump_displacement"], P["piston_area_a"], P["piston_area_b"]
        net = P["torque_constant"] * i - d_p * (a - b) - P["viscous_torque"] * w
        c_a = P["bulk_modulus"] / (P["volume_a"] + a_a * x)
        c_b = P["bulk_modulus"] / (P["volume_b"] - a_b * x)
        q = d_p * w - P["leakage"] * (a - b)
        force = a_a * a - a_b * b - P["rod_viscous"] * v - P["rod_coulomb"] * jnp.sign(v)
        f_w = (net - jnp.sign(w) * level) / P["rotor_inertia"]
        slopes = (f_w, c_a * (q - a_a * v), c_b * (a_b * v - q), v, force / P["load_mass"])
        return slopes, c_a, c_b

    def step(y: Any, i: Any) -> Any:
        (f_w, f_a, f_b, f_x, f_v), c_a, c_b = rates(y, i)
        s, g = gamma * STEP, P["leakage"]
        m_aa, m_ab, m_ba, m_bb = 1 + s * c_a * g, s * c_a * g, s * c_b * g, 1 + s * c_b * g
        det = m_aa * m_bb - m_ab * m_ba
        k_a, k_b = (m_bb * f_a + m_ab * f_b) / det, (m_aa * f_b + m_ba * f_a) / det
        k = (f_w, k_a, k_b, f_x, f_v)
        (e_w, e_a, e_b, _, e_v), _, _ = rates([u + STEP * d for u, d in zip(y, k, strict=True)], i)
        r_a, r_b = e_a - 2 * k_a, e_b - 2 * k_b
        l_a, l_b = (m_bb * r_a + m_ab * r_b) / det, (m_aa * r_b + m_ba * r_a) / det
        return (y[0] + STEP * 0.5 * (f_w + e_w), y[1] + STEP * (1.5 * k_a + 0.5 * l_a),
                y[2] + STEP * (1.5 * k_b + 0.5 * l_b), y[3] + STEP * (y[4] + 0.5 * STEP * f_v),
                y[4] + STEP * 0.5 * (f_v + e_v))  # fmt: skip

    @jax.jit
    def run(commands: Any) -> Any:
        def tick(y: Any, i: Any) -> Any:
            return jax.lax.fori_loop(0, count, lambda _, z: step(z, i), y), jnp.stack(y)

        rest = jnp.broadcast_to(P["initial_pressure"], (vectors.shape[0],))
        zero = jnp.zeros(vectors.shape[0])
        return jax.lax.scan(tick, (zero, rest, rest, zero, zero), commands)[1]

    commands = jnp.asarray(drive.inputs["current_command"])
    return lambda: run(commands).block_until_ready()


def peers(case: Case, rounds: int) -> Iterator[Row]:
    """Yield other ways to simulate the knee."""
    plant = case.plant
    vector = plant.layout.defaults()
    vector[plant.layout.index["rod_creep_speed"]] = 1e-3
    vector[plant.layout.index["pump_creep_speed"]] = 1.0
    short = case.drives(0.05)["free rod"]
    ours, theirs = best(
        [
            lambda: plant.simulate(vector, short, STEP),
            lambda: by_scipy(plant, vector, short),
        ],
        1,
    )
    yield Row("one run, SciPy's LSODA / ours", theirs / ours)
    if importlib.util.find_spec("jax") is None:
        print("JAX is not installed: not compared", file=sys.stderr)
        return
    vectors, drive = parameter_sets(case), case.drives(0.2)["free rod"]
    run = by_jax(plant, vectors, drive)
    found = [float("inf"), float("inf")]
    for _ in range(rounds + 1):  # XLA computes on threads of its own: the clock on the wall
        for place, act in enumerate((lambda: plant.sweep(vectors, drive, STEP), run)):
            began = time.perf_counter()
            act()
            found[place] = min(found[place], time.perf_counter() - began)
    yield Row(f"sweep of {SETS} sets, JAX / ours", found[1] / found[0], note="wall, JAX all cores")


_START = """
import time, resource
import numpy as np
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
def spent():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
t = np.arange(11) / 1000
drive = Drive(t, {"current_command": np.zeros(11)})
bare = Model("eha_knee")
bare.plant.simulate(bare.vector(), drive, 1e-4); a = spent()
air = Model("eha_knee", effects=(DeclaredEffect("entrained_air", {}),))
air.plant.simulate(air.vector(), drive, 1e-4); b = spent()
bare.plant.sweep(np.stack([bare.vector()] * 8), drive, 1e-4)
print(a, b - a, spent() - b)
"""


def _started(environment: Mapping[str, str]) -> tuple[float, ...]:
    """Return the processor seconds of a new process's first run, its first effect and sweep."""
    done = subprocess.run(
        [sys.executable, "-c", _START], env=environment, capture_output=True, text=True, check=True
    )
    return tuple(float(text) for text in done.stdout.split())


def starts(folder: Path) -> Iterator[Row]:
    """Yield what the first run on a machine costs, and a later one, in processor seconds."""
    environment = os.environ | {"EHA_BENCH_CACHE": str(folder / "kernels")}
    kinds = (("first start on a machine", COLD_S, 1), ("later start", WARM_S, LATER))
    for name, limit, times in kinds:
        bare, full, sweep = min(_started(environment) for _ in range(times))
        note = "processor time; imports included"
        yield Row(f"{name}, a run without effects", bare, "s", "<", limit, note)
        yield Row(f"{name}, then one with effects", full, "s", "<", limit)
        yield Row(f"{name}, then a sweep", sweep, "s", "<", limit)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--no-cold", action="store_true", help="leave the first start out")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        ours, other = knee(Path(name)), valve_cylinder(Path(name))
        parts = [
            against_c(ours, given.rounds),
            against_c(other, given.rounds),
            peers(ours, given.rounds),
        ]
        if not given.no_cold:
            parts.append(starts(Path(name)))
        for part in parts:
            for row in part:
                rows.append(row)
                print(row, flush=True)
    write_rows(given.json, rows)
    return int(any(row.verdict == "missed" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
