"""Where something acts that no known effect explains, and what it depends on.

In windows of 0.1 s, each from its own start state, an error cannot travel far from the balance it
enters. For every balance a curve of one variable is offered (hat functions as the effect `learned`
has them; for the time also a sine and its second harmonic at any frequency), its sensitivities are
found by simulation, and the curve that explains most on runs left out says equation and variable.
It is then fitted over the long windows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eha_bench.diagnosis.candidates import LEARNED
from eha_bench.diagnosis.evidence import Groups, compare, groups_of
from eha_bench.diagnosis.fit import Fit, Free, jacobian
from eha_bench.diagnosis.gate import Measured
from eha_bench.diagnosis.problem import Problem, soften
from eha_bench.diagnosis.windows import shaft_angle, window_at
from eha_bench.plants.plant import Plant

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

WINDOW = 0.1
_BUDGET = 6.0
_BUDGET_OF_FEW = 30.0
_HATS = 6
_AS_GOOD = 0.9


@dataclass(frozen=True)
class Template:
    """One place where a curve may act, and the variable it may depend on."""

    equation: str
    form: str
    place: str
    variable: str


@dataclass(frozen=True)
class Located:
    """A template with what its curve explains.

    Attributes:
        template: equation, form, place, variable.
        share: part of the short windows' excess that it explains on runs left out.
        knots: (k,) values of the variable; values: (k,) the curve there.
        period: of the variable, 0 where not periodic.
    """

    template: Template
    share: float
    knots: FloatArray
    values: FloatArray
    period: float = 0.0


TEMPLATES = (
    *(Template("actuation", "gain", "motor", u) for u in ("time", "motor_speed", "current")),
    *(Template("actuation", "additive", "drive", u) for u in ("time", "current_command")),
    *(
        Template("torque", "additive", "motor", u)
        for u in ("time", "motor_speed", "pressure_difference", "pressure_sum")
    ),
    *(
        Template("torque", "friction", "motor", u)
        for u in ("time", "motor_speed", "pressure_difference", "pressure_sum")
    ),
    *(
        Template("flow", "additive", "a_to_b", u)
        for u in ("time", "pressure_difference", "motor_speed")
    ),
    *(Template("flow", "additive", "chamber_a", u) for u in ("time", "pressure_a")),
    *(Template("flow", "additive", "chamber_b", u) for u in ("time", "pressure_b")),
    *(
        Template("flow", "gain", "a_to_b", u)
        for u in ("time", "motor_speed", "pressure_difference")
    ),
    *(
        Template("force", "additive", "motor", u)
        for u in ("time", "piston_position", "piston_velocity")
    ),
    *(
        Template("force", "friction", "motor", u)
        for u in ("time", "piston_position", "pressure_sum")
    ),
    *(
        Template("measurement", "additive", sensor, u)
        for sensor in ("current", "motor_speed", "pressure_a", "pressure_b", "piston_position",
                       "piston_velocity")
        for u in (sensor, "time")
    ),
)  # fmt: skip


def variables_of(measured: Measured) -> dict[str, FloatArray]:
    """Return what a curve may depend on, by name, (n,), as measured (NaN where not)."""
    found: dict[str, FloatArray] = {"time": measured.time}
    for name in (*measured.inputs, *measured.outputs):
        column = measured.inputs.get(name)
        if column is None:
            column = measured.column(name)
        if column is not None:
            found[name] = column
    if "pressure_a" in found and "pressure_b" in found:
        found["pressure_difference"] = found["pressure_a"] - found["pressure_b"]
        found["pressure_sum"] = found["pressure_a"] + found["pressure_b"]
    angle = shaft_angle(measured)
    if angle is not None:
        found["shaft_angle"] = angle
    return found


def medium_problem(problem: Problem, length: float = WINDOW) -> Problem:
    """Return the problem over short windows spread evenly over all runs."""
    runs: dict[str, Measured] = {}
    for window in problem.windows:
        runs.setdefault(window.measured.run.name, window.measured)
    # few runs are long ones: what happens in them may be far apart
    budget = _BUDGET if len(runs) > 3 else _BUDGET_OF_FEW
    share = budget / len(runs)
    windows = []
    for measured in runs.values():
        time = measured.time
        size = max(6, round(length / float(np.median(np.diff(time)))))
        places = np.arange(0, time.size - size, size)
        most = max(2, round(share / length))
        if places.size > most:
            # evenly, but not in step with anything periodic
            places = places[np.unique(np.linspace(0, places.size - 1, most).round().astype(int))]
        windows += [window_at(measured, int(k), int(k) + size, problem.noise) for k in places]
    return Problem(problem.plant, windows, problem.noise, problem.step)


class Locator:
    """Offers curves to the residual over short windows.

    Args:
        problem: the long problem, for its runs and noise.
        fit: the best that is known. step: integration step, s.
    """

    def __init__(self, problem: Problem, fit: Fit, step: float) -> None:
        self.plant: Plant = problem.plant
        self.short = medium_problem(problem.at_step(step))
        self.fit = fit
        self.short.prepare(fit.vector)
        self.base = self.short.residual(fit.vector)
        self.free = fit.free
        self.matrix = jacobian(self.short, fit.vector, self.free, self.base)
        self.groups: Groups = groups_of(self.short)
        self.short.scale_to(self.base)
        self.limit = 1e3 * self.short.soft
        soft, weight = soften(self.base, self.short.soft)
        weighted = self.matrix * weight[:, None]
        own = -np.linalg.lstsq(weighted.T @ weighted, weighted.T @ soft, rcond=1e-10)[0]
        self.before = self._pseudo(self.free, self.base + self.matrix @ own, self.matrix)
        soft, _ = soften(self.before.residual, self.short.soft)
        self.excess = max(float(soft @ soft) - 0.973 * soft.size, 1.0)
        self.variables: dict[str, tuple[float, float]] = {}
        for window in self.short.windows:
            for name, values in variables_of(window.measured).items():
                part = values[window.first : window.last]
                part = part[np.isfinite(part)]
                if part.size:
                    low, high = self.variables.get(name, (np.inf, -np.inf))
                    self.variables[name] = (
                        min(low, float(part.min())),
                        max(high, float(part.max())),
                    )

    def vector(self, template: Template, low: float, high: float, values: FloatArray) -> FloatArray:
        """Return the fit's vector with a curve on."""
        return curve_on(self.plant, self.fit.vector, template, low, high, values)

    def locate(self, template: Template) -> Located | None:
        """Return what a template's curve explains, None where its variable does not vary."""
        if template.variable not in self.variables or not self._applies(template):
            return None
        if template.variable == "time":
            return self._of_time(template)
        low, high = self.variables[template.variable]
        if not high > low:
            return None
        size = self._size(template)
        knots = np.linspace(low, high, _HATS)
        columns = []
        fine = np.linspace(low, high, self._count())
        for k in range(_HATS):
            hat = np.interp(fine, knots, np.eye(_HATS)[k]) * size
            moved = self.short.residual(self.vector(template, low, high, hat))
            columns.append(np.clip(moved - self.base, -self.limit, self.limit))
        share, amplitudes = self._explained(np.column_stack(columns))
        return Located(template, share, knots, amplitudes * size)

    def _of_time(self, template: Template) -> Located | None:
        """A trend or any period: the effect of a constant in each window, weighted by its time."""
        size = self._size(template)
        ones = np.full(self._count(), size)
        change = self.short.residual(self.vector(template, 0.0, 1.0, ones)) - self.base
        change = np.clip(change, -self.limit, self.limit)
        time = np.zeros(self.short.size)
        for piece in self.short.pieces:
            window = self.short.windows[piece.window]
            time[piece.rows] = window.measured.time[window.first + piece.ticks].mean()
        longest = float(time.max())
        best: Located | None = None
        trend = np.linspace(0.0, longest, 4)
        hats = [change * np.interp(time, trend, np.eye(4)[k]) for k in range(4)]
        share, amplitudes = self._explained(np.column_stack(hats))
        best = Located(template, share, trend, amplitudes * size)
        sums = self._by_window(change)
        step = 0.1 / longest
        frequencies = np.arange(1.5 / longest, 0.5 / WINDOW, step)
        rough = sorted(((_wave_gain(*sums, f, 1), float(f)) for f in frequencies), reverse=True)
        for _, frequency in rough[:2]:
            near = np.linspace(frequency - step, frequency + step, 21)
            found = max((_wave_gain(*sums, f, 2), float(f)) for f in near)
            share, amplitudes = self._explained(_waves(change, time, found[1], 2))
            if share > best.share + 0.02:
                period = 1.0 / found[1]
                knots = np.linspace(0.0, period, self._count(), endpoint=False)
                curve = _series(knots / period, amplitudes) * size
                best = Located(template, share, knots, curve, period)
        return best

    def _by_window(self, change: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return each window's time, product of change and residual, and square of the change."""
        soft, weight = soften(self.before.residual, self.short.soft)
        column = change * weight
        time, product, square = [], [], []
        for piece in self.short.pieces:
            window = self.short.windows[piece.window]
            time.append(float(window.measured.time[window.first + piece.ticks].mean()))
            product.append(float(column[piece.rows] @ soft[piece.rows]))
            square.append(float(column[piece.rows] @ column[piece.rows]))
        return np.array(time), np.array(product), np.array(square)

    def _explained(self, columns: FloatArray) -> tuple[float, FloatArray]:
        free = (
            *self.free,
            *(Free(f"curve[{k}]", -1, -np.inf, np.inf, 1.0) for k in range(columns.shape[1])),
        )
        matrix = np.hstack([self.matrix, columns])
        residual = self.base
        soft, weight = soften(residual, self.short.soft)
        weighted = matrix * weight[:, None]
        normal = weighted.T @ weighted
        ridge = 1e-6 * np.diag(np.diag(normal)) + 1e-9 * np.eye(normal.shape[0])
        answer = -np.linalg.lstsq(normal + ridge, weighted.T @ soft, rcond=1e-12)[0]
        after = self._pseudo(free, residual + matrix @ answer, matrix)
        found = compare(self.before, after, self.groups, self.excess)
        return found.share_out, np.asarray(answer[len(self.free) :], dtype=np.float64)

    def _pseudo(self, free: Sequence[Free], residual: FloatArray, matrix: FloatArray) -> Fit:
        soft, _ = soften(residual, self.short.soft)
        cost = float(soft @ soft)
        return Fit(self.fit.vector, tuple(free), residual, matrix, cost, 0, self.short.soft)

    def _count(self) -> int:
        return self.plant.layout.by_key[f"{LEARNED}.values"].size

    def _applies(self, template: Template) -> bool:
        if template.equation == "measurement":
            return template.place in self.short.noise
        return True

    def _size(self, template: Template) -> float:
        """A small curve: a few percent of what is usual in that balance."""
        if template.form == "gain":
            return 0.02
        plant, vector = self.plant, self.fit.vector
        place = plant.layout.index

        def value(name: str, default: float) -> float:
            return float(vector[place[name]]) if name in place else default

        if template.equation == "measurement":
            return 2.0 * self.short.noise[template.place]
        span = self.variables
        if template.equation == "actuation":
            low, high = span.get("current_command", span.get("voltage", (0.0, 1.0)))
            return 0.01 * max(abs(low), abs(high))
        if template.equation == "torque":
            low, high = span.get("current", span.get("current_command", (0.0, 1.0)))
            return 0.01 * value("torque_constant", 1.0) * max(abs(low), abs(high))
        if template.equation == "flow":
            low, high = span.get("motor_speed", (0.0, 100.0))
            return 0.01 * value("pump_displacement", 1e-7) * max(abs(low), abs(high))
        return 0.1 * max(value("rod_coulomb", 10.0), 1.0)


def curve_on(
    plant: Plant,
    vector: FloatArray,
    template: Template,
    low: float,
    high: float,
    values: FloatArray,
    period: float = 0.0,
) -> FloatArray:
    """Return a vector with the effect `learned` on, as a template says."""
    layout = plant.layout
    effect = layout.effect(LEARNED)
    out = vector.copy()

    def put(name: str, number: float) -> None:
        out[layout.index[f"{LEARNED}.{name}"]] = number

    put("scale", 1.0)
    for name in ("equation", "form", "variable", "place"):
        put(name, effect.parameter(name).encode(getattr(template, name)))
    put("period", period)
    put("low", low)
    put("high", high)
    at = layout.index[f"{LEARNED}.values"]
    out[at : at + values.size] = values
    return out


def locate_all(
    problem: Problem, fit: Fit, step: float, progress: Progress
) -> tuple[Locator, list[Located]]:
    """Return all templates that apply, the one that explains most first."""
    locator = Locator(problem, fit, step)
    found = []
    for number, template in enumerate(TEMPLATES):
        progress("locate", number / len(TEMPLATES))
        item = locator.locate(template)
        if item is not None:
            found.append(item)
    found.sort(key=lambda item: -item.share)
    return locator, _through_the_drive(found)


def _through_the_drive(found: list[Located]) -> list[Located]:
    """Put the actuation first where what depends on time alone may enter there as well.

    Mechanics and oil do not know the time; whoever commands them does.
    """
    if not found or found[0].template.variable != "time":
        return found
    for item in found:
        same = item.template.equation == "actuation" and item.template.variable == "time"
        if same and item.share > _AS_GOOD * found[0].share:
            return [item, *(other for other in found if other is not item)]
    return found


def _waves(change: FloatArray, time: FloatArray, frequency: float, harmonics: int) -> FloatArray:
    columns = [change]
    for k in range(1, harmonics + 1):
        angle = 2.0 * np.pi * k * frequency * time
        columns += [change * np.cos(angle), change * np.sin(angle)]
    return np.column_stack(columns)


def _wave_gain(
    time: FloatArray, product: FloatArray, square: FloatArray, frequency: float, harmonics: int
) -> float:
    """Predicted fall of the squared residual for a wave, from sums over windows."""
    waves = _waves(np.ones(time.size), time, frequency, harmonics)
    normal = (waves * square[:, None]).T @ waves
    right = waves.T @ product
    return float(right @ np.linalg.lstsq(normal, right, rcond=1e-9)[0])


def _series(phase: FloatArray, amplitudes: FloatArray) -> FloatArray:
    total = np.full(phase.size, amplitudes[0])
    for k in range(1, (amplitudes.size + 1) // 2):
        angle = 2.0 * np.pi * k * phase
        total = total + amplitudes[2 * k - 1] * np.cos(angle) + amplitudes[2 * k] * np.sin(angle)
    return total
