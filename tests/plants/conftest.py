"""What the tests of plants share: runs of both plants, and an independent solver of the knee."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.plants.plant import Drive
from eha_bench.plants.registry import get_plant

COLUMN = {
    "current": 0,
    "motor_speed": 1,
    "pressure_a": 2,
    "pressure_b": 3,
    "piston_position": 4,
    "piston_velocity": 5,
}

# the physical model of the notes: light rotor, check valves, charged
PHYSICAL = {
    "rotor_inertia": 0.001,
    "leakage": 1e-13,
    "current_limit": 36.0,
    "initial_pressure": 0.6e6,
}
CHECK_VALVES = DeclaredEffect("anti_cavitation")


@dataclass(frozen=True)
class Knee:
    """The knee EHA with everything but a command chosen."""

    parameters: Mapping[str, float] = field(default_factory=lambda: PHYSICAL)
    effects: tuple[DeclaredEffect, ...] = (CHECK_VALVES,)

    def model(self, *effects: DeclaredEffect, **parameters: float) -> Model:
        """Return the model with further effects and parameters."""
        return Model("eha_knee", {**self.parameters, **parameters}, (), (*self.effects, *effects))

    def run(
        self,
        time: FloatArray,
        inputs: Mapping[str, FloatArray] | FloatArray,
        *effects: DeclaredEffect,
        locked: bool = True,
        bypass: bool = False,
        initial: Mapping[str, float] | None = None,
        step: float = 25e-6,
        first: int = 0,
        **parameters: float,
    ) -> dict[str, FloatArray]:
        """Simulate and return the outputs by channel."""
        if not isinstance(inputs, Mapping):
            inputs = {"current_command": np.broadcast_to(np.asarray(inputs, float), time.shape)}
        drive = Drive(time, inputs, initial or {}, locked, bypass, first)
        vector = self.model(*effects, **parameters).vector()
        out = get_plant("eha_knee").simulate(vector, drive, step)
        return {name: out[:, column] for name, column in COLUMN.items()}


@pytest.fixture(scope="session")
def knee() -> Knee:
    """The physical knee: light rotor, check valves, charged."""
    return Knee()


@pytest.fixture(scope="session")
def printed_knee() -> Knee:
    """The knee as printed in the paper: no check valves, heavier rotor."""
    return Knee({"current_limit": 46.0}, ())


@pytest.fixture(scope="session")
def bare_knee() -> Knee:
    """A knee without friction and leakage: what is left has closed forms."""
    nothing = dict.fromkeys(
        ("viscous_torque", "coulomb_torque", "static_torque", "leakage", "rod_viscous",
         "rod_coulomb"), 0.0,
    )  # fmt: skip
    return Knee({**PHYSICAL, **nothing}, ())


@pytest.fixture(scope="session")
def effect() -> Callable[..., DeclaredEffect]:
    """Declare an effect: effect("current_lag", time_constant=2e-3)."""

    def declare(name: str, **values: Any) -> DeclaredEffect:
        return DeclaredEffect(name, values)

    return declare


class HybridKnee:
    """The knee as a hybrid automaton, solved by SciPy's implicit Radau with events.

    Written from the equations of the paper notes, apart from the product's code: modes
    (shaft and rod slide up, slide down or stick), the events that end each, and a stiff solver
    at tight tolerance between them.
    """

    def __init__(self, values: Mapping[str, float], charge: float = 0.0, valve: float = 0.0):
        self.p = dict(values)
        self.charge, self.valve = charge, valve

    def stribeck(self, w: float) -> float:
        p = self.p
        return p["coulomb_torque"] + (p["static_torque"] - p["coulomb_torque"]) * float(
            np.exp(-((w / p["stribeck_speed"]) ** 2))
        )

    def shaft(self, i: float, y: FloatArray) -> float:
        p = self.p
        torque = p["torque_constant"] * i - p["pump_displacement"] * (y[1] - y[2])
        return torque - p["viscous_torque"] * y[0]

    def rod(self, y: FloatArray) -> float:
        p = self.p
        push = p["piston_area_a"] * y[1] - p["piston_area_b"] * y[2] - p["external_force"]
        return push - p["rod_viscous"] * y[4]

    def field(self, i: float, m: int, r: int, bypass: float) -> Callable[..., FloatArray]:
        p = self.p

        def rates(_: float, y: FloatArray) -> FloatArray:
            w, pa, pb, x, v = y
            leak = (p["leakage"] + bypass) * (pa - pb)
            pump = p["pump_displacement"] * w
            fill_a = self.valve * max(0.0, self.charge - pa)
            fill_b = self.valve * max(0.0, self.charge - pb)
            va = p["volume_a"] + p["piston_area_a"] * x
            vb = p["volume_b"] - p["piston_area_b"] * x
            dw = (self.shaft(i, y) - m * self.stribeck(w)) / p["rotor_inertia"] if m else 0.0
            dv = (self.rod(y) - r * p["rod_coulomb"]) / p["load_mass"] if r else 0.0
            beta = p["bulk_modulus"]
            return np.array(
                [
                    dw,
                    beta / va * (pump - p["piston_area_a"] * v - leak + fill_a),
                    beta / vb * (-pump + p["piston_area_b"] * v + leak + fill_b),
                    v,
                    dv,
                ]
            )

        return rates

    def mode(self, speed: float, net: float, level: float) -> int:
        if speed != 0.0:
            return 1 if speed > 0 else -1
        if abs(net) > level * (1 + 1e-12):
            return 1 if net > 0 else -1
        return 0

    def simulate(
        self, times: FloatArray, commands: FloatArray, start: FloatArray, *, locked: bool,
        bypass: float = 0.0, rtol: float = 1e-9,
    ) -> FloatArray:  # fmt: skip
        """Return w, p_a, p_b, x, v at the times, (n, 5)."""
        y = np.array(start, dtype=float)
        rows = [y.copy()]
        scale = np.array([1e-6, 1e-3, 1e-3, 1e-10, 1e-9])
        for k in range(times.size - 1):
            t, end, i = times[k], times[k + 1], commands[k]
            while t < end - 1e-12:
                m = self.mode(y[0], self.shaft(i, y), self.p["static_torque"])
                r = 0 if locked else self.mode(y[4], self.rod(y), self.p["rod_coulomb"])
                events = [self.event(i, m, r, which) for which in ("shaft", "rod")]
                if locked:
                    events = events[:1]
                out = solve_ivp(
                    self.field(i, m, r, bypass), (t, end), y, method="Radau", rtol=rtol,
                    atol=scale, events=events, max_step=2e-3,
                )  # fmt: skip
                y, t = out.y[:, -1].copy(), out.t[-1]
                if out.status == 1:
                    which = [len(found) > 0 for found in out.t_events]
                    if which[0] and m:
                        y[0] = 0.0
                    if len(which) > 1 and which[1] and r:
                        y[4] = 0.0
                    # a break-away is left by a nudge: at the event itself it still holds
                    if which[0] and not m:
                        y[0] = 1e-12 * np.sign(self.shaft(i, y))
                    if len(which) > 1 and which[1] and not r:
                        y[4] = 1e-14 * np.sign(self.rod(y))
            rows.append(y.copy())
        return np.array(rows)

    def event(self, i: float, m: int, r: int, which: str) -> Callable[..., float]:
        """Return the function whose zero ends the mode of shaft or rod."""

        def stops(_: float, y: FloatArray) -> float:
            return float(y[0] if which == "shaft" else y[4])

        def breaks(_: float, y: FloatArray) -> float:
            if which == "shaft":
                return self.p["static_torque"] - abs(self.shaft(i, y))
            return self.p["rod_coulomb"] - abs(self.rod(y))

        moving = m if which == "shaft" else r
        found = stops if moving else breaks
        found.terminal = True
        found.direction = -moving if moving else -1
        return found


@pytest.fixture(scope="session")
def hybrid() -> Callable[[Knee], HybridKnee]:
    """The independent solver for a knee's parameters."""

    def of(knee: Knee, **parameters: float) -> HybridKnee:
        model = knee.model(**parameters)
        names = [parameter.name for parameter in model.plant.layout.parameters]
        valves = {"charge": 0.6e6, "valve": 6e-10} if knee.effects else {}
        return HybridKnee({name: model.value(name) for name in names}, **valves)

    return of
