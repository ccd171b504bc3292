"""One run against plain C, sweeps against plain C, other solvers, and the start on a new machine.

    python -m benchmarks.simulation [--rounds 25] [--no-cold] [--json FILE]

`knee.c` is compiled by the system's compiler (`cc -O3`, or $CC); it holds the same equations and
takes the same steps, and its results must agree, or nothing is printed. Times are the processor's,
of one thread; ours and C's rounds alternate, and the best of each is taken. SciPy and JAX stand
beside where they are installed.
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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.table import Row, write_rows
from numpy.typing import NDArray

from eha_bench.plants.eha_knee import equations
from eha_bench.plants.eha_knee.plant import EhaKnee
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive, get_plant

FloatArray = NDArray[np.float64]

STEP = 25e-6
SETS = 64
MOST_C, LEAST_SWEEP = 1.1, 3.0
COLD_S, WARM_S = 30.0, 1.0
LATER = 3
"""Later starts, of which the fastest counts: the first finds its files on the disk."""


def drives(seconds: float) -> dict[str, Drive]:
    """Inputs that move freely, that reverse against a locked piston, and with an open bypass."""
    t = np.arange(round(1000 * seconds) + 1) / 1000.0
    return {
        "free rod": Drive(t, {"current_command": 6.0 * np.sin(4 * np.pi * t)}),
        "locked": Drive(t, {"current_command": 12.0 * np.sign(np.sin(6 * np.pi * t))}, locked=True),
        "bypass": Drive(
            t, {"current_command": 6.0 * np.sin(2 * np.pi * t)}, locked=True, bypass_open=True
        ),
    }


class PlainC:
    """The reference, compiled anew."""

    def __init__(self, folder: Path) -> None:
        library = folder / "knee.so"
        compiler = os.environ.get("CC", "cc")
        command = [compiler, "-O3", "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*command, str(Path(__file__).with_name("knee.c")), "-lm"], check=True)
        self._simulate = ctypes.CDLL(str(library)).simulate
        array = np.ctypeslib.ndpointer(np.float64, flags="C")
        self._simulate.argtypes = [
            ctypes.c_int, array, array, array, ctypes.c_int, ctypes.c_int, ctypes.c_double, array,
            array, array,
        ]  # fmt: skip

    def __call__(self, plant: EhaKnee, vector: FloatArray, drive: Drive) -> FloatArray:
        n = drive.time.size
        out, state = np.empty((n, 6)), plant.start_state(vector, drive.initial)
        command = drive.inputs["current_command"]
        self._simulate(
            n, drive.time, command, np.zeros(n), drive.locked, drive.bypass_open, STEP, vector,
            state, out,
        )  # fmt: skip
        return out


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


def parameter_sets(plant: EhaKnee) -> FloatArray:
    """A fifth around the paper's parameters, up and down."""
    rng = np.random.default_rng(0)
    vectors = np.repeat(plant.layout.defaults()[None], SETS, axis=0)
    for name in ("torque_constant", "rotor_inertia", "viscous_torque", "coulomb_torque",
                 "leakage", "bulk_modulus", "load_mass", "rod_viscous"):  # fmt: skip
        vectors[:, plant.layout.index[name]] *= rng.uniform(0.8, 1.2, SETS)
    return vectors


def agrees(found: FloatArray, wanted: FloatArray, tolerance: float) -> None:
    """Stop where two ways to compute the same do not."""
    scale = np.abs(wanted).max(axis=tuple(range(wanted.ndim - 1))) + 1e-300
    worst = float((np.abs(found - wanted) / scale).max())
    if not worst <= tolerance:
        raise SystemExit(f"the results differ by {worst:.2g} of the range: nothing is comparable")


def against_c(plant: EhaKnee, c: PlainC, rounds: int) -> Iterator[Row]:
    """Yield one run and a sweep beside C."""
    vector = plant.layout.defaults()
    air = Model("eha_knee", effects=(DeclaredEffect("entrained_air", {"air_fraction": 0.01}),))
    with_effect = air.vector()
    # all inputs in every round: a moment in which the machine is slow is in no figure alone
    long = drives(5.0)
    acts: list[Callable[[], object]] = []
    for drive in long.values():
        agrees(plant.simulate(vector, drive, STEP), c(plant, vector, drive), 1e-9)
        acts += [
            partial(c, plant, vector, drive),
            partial(plant.simulate, vector, drive, STEP),
            partial(plant.simulate, with_effect, drive, STEP),
        ]
    found = best(acts, rounds)
    steps = 5.0 / STEP
    for name, plain, ours, effect in zip(long, found[::3], found[1::3], found[2::3], strict=True):
        note = f"{ours / steps * 1e9:.0f} ns a step"
        yield Row(f"one run / plain C, {name}", ours / plain, "", "<", MOST_C, note)
        yield Row(f"one run with an effect / plain C without, {name}", effect / plain)
    vectors = parameter_sets(plant)
    short = drives(1.0)
    acts = []
    for drive in short.values():
        wanted = np.stack([c(plant, v, drive) for v in vectors])
        agrees(plant.sweep(vectors, drive, STEP), wanted, 1e-8)
        acts += [
            lambda d=drive: [c(plant, v, d) for v in vectors],  # type: ignore[misc]
            partial(plant.sweep, vectors, drive, STEP),
        ]
    found = best(acts, rounds)
    for name, plain, ours in zip(short, found[::2], found[1::2], strict=True):
        note = f"{ours / SETS * 1e3:.2f} ms a set and second"
        yield Row(f"sweep, plain C / ours a set, {name}", plain / ours, "", ">", LEAST_SWEEP, note)


def by_scipy(plant: EhaKnee, vector: FloatArray, drive: Drive) -> FloatArray:
    """LSODA on the same compiled equations, an interval of held input at a time.

    With friction that creeps: with friction that sticks it would hardly come off the ground.
    """
    from scipy.integrate import solve_ivp

    memory = np.zeros(plant.layout.memory)
    area = vector[equations.A_B]

    def slopes(t: float, y: FloatArray, i: float) -> list[float]:
        f = equations.rates(
            1e-6, i, y[0], y[1], y[2], y[3], y[4], y[5], t, 1.0, 1.0, 0.0, area, vector, memory
        )  # fmt: skip
        return [f[0], y[0], f[1], f[2], y[5], f[3]]

    y = plant.start_state(vector, drive.initial)[:6]
    found = [y]
    for k in range(drive.time.size - 1):
        span = (drive.time[k], drive.time[k + 1])
        i = float(drive.inputs["current_command"][k])
        y = solve_ivp(slopes, span, y, "LSODA", args=(i,), rtol=1e-6, atol=1e-9).y[:, -1]
        found.append(y)
    return np.array(found)


def by_jax(vectors: FloatArray, drive: Drive) -> Callable[[], object]:
    """The same steps, vectorised over the sets and compiled by XLA; stops are not located."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    e = equations
    P = jnp.asarray(vectors.T)
    count = round(float(drive.time[1] - drive.time[0]) / STEP)
    gamma = 1.0 - 1.0 / np.sqrt(2.0)

    def rates(y: Any, i: Any) -> Any:
        w, a, b, x, v = y
        level = P[e.T_CF] + (P[e.T_SF] - P[e.T_CF]) * jnp.exp(-((w / P[e.W_S]) ** 2))
        net = P[e.K_T] * i - P[e.D_P] * (a - b) - P[e.B_PM] * w
        c_a = P[e.BETA] / (P[e.V_A] + P[e.A_A] * x)
        c_b = P[e.BETA] / (P[e.V_B] - P[e.A_B] * x)
        q = P[e.D_P] * w - P[e.L_IN] * (a - b)
        force = P[e.A_A] * a - P[e.A_B] * b - P[e.B_ROD] * v - P[e.F_ROD] * jnp.sign(v)
        slopes = ((net - jnp.sign(w) * level) / P[e.J], c_a * (q - P[e.A_A] * v),
                  c_b * (P[e.A_B] * v - q), v, force / P[e.M])  # fmt: skip
        return slopes, c_a, c_b

    def step(y: Any, i: Any) -> Any:
        (f_w, f_a, f_b, f_x, f_v), c_a, c_b = rates(y, i)
        s, g = gamma * STEP, P[e.L_IN]
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

        rest = jnp.broadcast_to(P[e.P_INITIAL], (vectors.shape[0],))
        zero = jnp.zeros(vectors.shape[0])
        return jax.lax.scan(tick, (zero, rest, rest, zero, zero), commands)[1]

    commands = jnp.asarray(drive.inputs["current_command"])
    return lambda: run(commands).block_until_ready()


def peers(plant: EhaKnee, rounds: int) -> Iterator[Row]:
    """Yield other ways to simulate the same."""
    vector = plant.layout.defaults()
    vector[plant.layout.index["rod_creep_speed"]] = 1e-3
    vector[plant.layout.index["pump_creep_speed"]] = 1.0
    short = drives(0.05)["free rod"]
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
    vectors, drive = parameter_sets(plant), drives(0.2)["free rod"]
    run = by_jax(vectors, drive)
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
    plant = get_plant("eha_knee")
    assert isinstance(plant, EhaKnee)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        parts = [against_c(plant, PlainC(Path(name)), given.rounds), peers(plant, given.rounds)]
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
