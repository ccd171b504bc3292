"""Finds the count and phase of an effect that is periodic in the shaft's angle.

A model that is a little off loses the angle in a long replay, and with it the phase: every count
looks the same. The measured speed does not: its noise, integrated over seconds, is a hundredth of a
radian. So an effect is looked for over short windows, each of which begins at the angle that the
measured speed has come to. For a fixed count the effect is then nearly linear in its sine and
cosine amplitudes: two simulations say what it would gain. Only the best counts are refitted, over
short windows, then over longer ones, and last over whole runs, whose phase the model has to keep.

Sine and cosine are kept by run and half of a run: where runs begin at different angles
(`start_angles`), each has its own phase.

A periodic effect is one with parameters `count` and `phase`; its strength is the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.windows import split
from eha_bench.diagnosis.fit.candidates import Start, one_of_each_form
from eha_bench.diagnosis.fit.least_squares import Fit, calibrated_directions
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.fit.start_angles import rows_of_runs
from eha_bench.plants.layout import Layout

_COUNTS = (*range(1, 49), 54, 56, 60, 66, 72, 80, 84, 90, 96)
_KEEP = 2
_SEEN = 2.0
"""Periods that a run has to go through: what comes once only is no period."""
_TOLD = 1e-10
"""What a run says of its phase at least, relative to the one that says most."""


@dataclass(frozen=True)
class Form:
    """A periodic effect in one of its forms.

    Attributes:
        template: where its search begins. at_count, at_phase: places in the vector.
    """

    template: Start
    at_count: int
    at_phase: int

    @property
    def small(self) -> Start:
        """At a size that stays where the change is proportional to it."""
        return replace(self.template, strength=0.2 * self.template.strength)

    def at(self, count: float, phase: float) -> Start:
        """Return the small one with so many periods a revolution, at a phase in rad."""
        return self.small.at({self.at_count: count, self.at_phase: phase})

    def best(
        self, count: float, normal: FloatArray, right: FloatArray
    ) -> tuple[float, Start] | None:
        """Return the predicted gain of the best amplitude and phase, and where these are.

        Args:
            count: periods a revolution. normal: (2, 2) products of what phases of 0 and a quarter
                turn do. right: (2,) their products with the residual.
        """
        if normal[0, 0] < 1e-6 or np.linalg.cond(normal) > 1e8:
            return None
        amplitude = -np.linalg.solve(normal, right)
        gain = float(-right @ amplitude)
        phase = math.atan2(float(amplitude[1]), float(amplitude[0]))
        size = self.small.strength * float(np.hypot(*amplitude))
        size = min(max(size, 1e-3 * self.template.strength), self.template.high)
        # a shaft has a whole number of poles, slots or pistons: fixed, no phase runs away
        keys = tuple(key for key in self.template.keys if not key.endswith(".count"))
        return gain, replace(self.at(count, phase), strength=size, keys=keys)


@dataclass(frozen=True, eq=False)
class Wave:
    """One count of one form, with what it would do in each half of each run.

    Attributes:
        form: of the effect. count: periods a revolution.
        gain: predicted at the best amplitude and phase. start: there.
        runs: of each half. normal: (2H, 2H) products of what phases of 0 and a quarter turn do in
            each half, off the calibrated directions. right: (2H,) theirs with the residual.
    """

    form: Form
    count: float
    gain: float
    start: Start
    runs: tuple[str, ...]
    normal: FloatArray
    right: FloatArray

    def lead_angles(self) -> dict[str, float]:
        """Return by how much runs begin further on, rad, if each has its own phase.

        The first one begins where it did.
        """
        turns = dict(zip(dict.fromkeys(self.runs), self._lead_angles(self.runs), strict=True))
        turns.pop(self.runs[0])
        return turns

    def with_lead_angles(self, turns: Mapping[str, float]) -> Wave:
        """Return the wave where runs begin further on than in the scan, by name, rad."""
        gain, start = self._best([turns.get(name, 0.0) for name in self.runs])
        return replace(self, gain=gain, start=start)

    def gain_in_halves(self) -> float:
        """Return the predicted gain if each half of each run had its own phase."""
        return self._best(self._lead_angles([str(half) for half in range(len(self.runs))]))[0]

    def _lead_angles(self, owners: Sequence[str]) -> list[float]:
        """Return how much further on each owner of halves begins than the first one, rad."""
        names = list(dict.fromkeys(owners))
        shared = np.array([[float(owner == name) for name in names] for owner in owners])
        shared = np.kron(shared, np.eye(2))
        normal, right = shared.T @ self.normal @ shared, shared.T @ self.right
        pairs = -np.linalg.lstsq(normal, right, rcond=_TOLD)[0].reshape(-1, 2)
        phases = np.arctan2(pairs[:, 1], pairs[:, 0])
        return [math.remainder(float(x), 2.0 * math.pi) / self.count for x in phases - phases[0]]

    def _best(self, turns: Sequence[float]) -> tuple[float, Start]:
        """Return the gain of the best amplitude and phase where halves begin further on."""
        angles = [self.count * turn for turn in turns]
        turned = np.vstack([[[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]] for x in angles])
        normal, right = turned.T @ self.normal @ turned, turned.T @ self.right
        return self.form.best(self.count, normal, right) or (0.0, self.start)


def in_parts(problem: Problem, length: float) -> Problem:
    """Return a problem with its windows cut into parts of about a length in s, not yet prepared."""
    parts = [part for window in problem.windows for part in split(window, length)]
    return problem.over(parts)


def scan(problem: Problem, fit: Fit, layout: Layout, starts: Sequence[Start]) -> list[Wave]:
    """Return what every count of one periodic effect would gain in each of its forms.

    Args:
        problem: over short windows. fit: without the effect, on these windows.
        layout: of the plant. starts: the effect's own starting points.
    """
    soft, weight, basis = calibrated_directions(fit, problem.soft)
    target = soft - basis @ (basis.T @ soft)
    base = problem.residual(fit.vector)
    halves = [(run, half) for run, rows in rows_of_runs(problem).items()
              for half in np.array_split(rows, 2)]  # fmt: skip
    runs, places = tuple(run for run, _ in halves), [rows for _, rows in halves]
    own_basis = [basis[rows] for rows in places]

    def moved(trial: Start) -> FloatArray:
        """Return what a trial does."""
        change = (problem.residual(trial.apply(fit.vector)) - base) * weight
        return np.asarray(change, dtype=np.float64)

    found: list[Wave] = []
    for form in _forms(layout, starts):
        least = least_count(problem, layout, form.template)
        counts = sorted({*_COUNTS, *(int(dict(s.settings)[form.at_count]) for s in starts)})
        counts = [count for count in counts if count >= least]
        waves = [(float(count), phase) for count in counts for phase in (0.0, 0.5 * math.pi)]
        columns = side_by_side(moved, [form.at(count, phase) for count, phase in waves])
        for count, sine, cosine in zip(counts, columns[::2], columns[1::2], strict=True):
            # off the calibrated directions
            pair = np.column_stack([c - basis @ (basis.T @ c) for c in (sine, cosine)])
            best = form.best(float(count), pair.T @ pair, pair.T @ target)
            if best is not None:
                both = np.column_stack([sine, cosine])
                own = [both[rows] for rows in places]
                shared = np.vstack([x.T @ b for x, b in zip(own, own_basis, strict=True)])
                normal = block_diag(*(x.T @ x for x in own)) - shared @ shared.T
                right = np.hstack([target[rows] @ x for x, rows in zip(own, places, strict=True)])
                found.append(Wave(form, float(count), *best, runs, normal, right))
    return found


def least_count(problem: Problem, layout: Layout, start: Start) -> float:
    """Return the least count of which a run shows enough periods, where its angle is measured."""
    effect = layout.effect(start.candidate)
    values = {p.name: dict(start.settings)[layout.index[f"{effect.id}.{p.name}"]]
              for p in effect.parameters}  # fmt: skip
    names = {spot.angle for spot in effect.spots_at(values)}
    runs = {window.measured.run.name: window.measured for window in problem.windows}
    angles = [item.column(name) for item in runs.values() for name in names if name]
    spans = [float(np.nanmax(a) - np.nanmin(a)) for a in angles if a is not None and a.size]
    return _SEEN * 2.0 * math.pi / max(spans) if spans and max(spans) > 0.0 else 0.0


def best_counts(waves: Sequence[Wave]) -> list[Start]:
    """Return the best counts of each effect in each of its forms, the best first."""
    forms: dict[int, list[Wave]] = {}
    for wave in waves:
        forms.setdefault(id(wave.form), []).append(wave)
    kept = [w for own in forms.values() for w in sorted(own, key=lambda w: -w.gain)[:_KEEP]]
    return [wave.start for wave in sorted(kept, key=lambda wave: -wave.gain)]


def _forms(layout: Layout, starts: Sequence[Start]) -> list[Form]:
    """Return one form for each combination of an effect's choices."""
    return [
        Form(start, *(layout.index[f"{start.candidate}.{name}"] for name in ("count", "phase")))
        for start in one_of_each_form(layout, starts)
    ]
