"""Entrant `sindy`: sparse regression (pysindy) of what the declared model leaves.

The declared model is advanced from each measured state over a few ticks; what it misses there, by
time, is the discrepancy of each balance. A library of terms, each standing for a cause or for a
calibrated parameter, is regressed on it by sequentially thresholded least squares, with the
threshold of the lowest BIC (Kaheman et al. 2019, arXiv:1909.08574: SINDy for discrepancies; Mangan
et al. 2017, doi:10.1098/rspa.2017.0009: chosen by an information criterion). A cause is claimed
where its terms explain what no others do. Predictions advance the declared model tick by tick, and
add the terms.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from benchmarks.league.answer import Answer, Cause
from benchmarks.league.question import FloatArray, Question, Run
from benchmarks.league.simulation import first_readings
from numpy.typing import NDArray

from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Drive
from eha_bench.plants.session import Session

TICKS = 2
"""Ticks over which a discrepancy is taken: shorter is noise, longer is not local."""
STEP = 2e-4
THRESHOLDS = tuple(np.geomspace(1e-3, 3.0, 16))
"""Tried, in standard deviations of the discrepancy: terms are scaled to 1."""
SMOOTH = 1e-2
"""How sharply a sign turns, as a share of a variable's size."""
COUNTS = (4, 6, 7, 8, 9, 10, 12, 14, 18, 24)
"""Periods a turn that are looked for."""
KEPT = 0.01
"""Share of a balance's discrepancy that a cause must explain to be claimed."""

STATES = ("current", "motor_speed", "pressure_a", "pressure_b", "piston_velocity")
"""Balances that are regressed, each by its own state."""


@dataclass(frozen=True)
class Term:
    """One term of a library; `cause` is "" where it stands for a calibrated parameter.

    `values` takes time, shaft angle, command, current, speed, p_a, p_b, position and velocity in
    this order, each (n,), and gives (n,).
    """

    cause: str
    equation: str
    values: Callable[..., FloatArray]


def _sign(values: FloatArray, size: float) -> FloatArray:
    return np.tanh(values / (SMOOTH * size))


def _turning(cause: str, equation: str, *, of_speed: bool) -> list[Term]:
    """Return sine and cosine terms of the shaft's angle for every count."""
    found = []
    for count in COUNTS:
        for wave in (np.sin, np.cos):

            def values(*a: FloatArray, count: int = count, wave: np.ufunc = wave) -> FloatArray:
                return np.asarray(wave(count * a[1]) * (a[4] if of_speed else 1.0))

            found.append(Term(cause, equation, values))
    return found


def library() -> Mapping[str, tuple[Term, ...]]:
    """Return the terms of each balance, by its state."""
    torque = [
        Term("", "torque", lambda *a: a[3]),
        Term("", "torque", lambda *a: a[4]),
        Term("", "torque", lambda *a: a[5] - a[6]),
        Term("", "torque", lambda *a: _sign(a[4], 200.0) * np.exp(-((a[4] / 18.0) ** 2))),
        Term("coulomb_friction", "torque", lambda *a: _sign(a[4], 200.0)),
        Term("asymmetric_friction", "torque", lambda *a: np.abs(_sign(a[4], 200.0))),
        Term("viscosity_drift", "torque", lambda *a: a[0] * a[4]),
        Term(
            "pressure_dependent_friction", "torque",
            lambda *a: np.abs(a[5] - a[6]) * _sign(a[4], 200.0),
        ),
        Term("torque_saturation", "actuation", lambda *a: a[3] ** 3),
        *_turning("cogging_torque", "torque", of_speed=False),
    ]  # fmt: skip
    force = [
        Term("", "force", lambda *a: a[5] - a[6]),
        Term("", "force", lambda *a: a[8]),
        Term("", "force", lambda *a: _sign(a[8], 0.3)),
        Term("", "force", lambda *a: np.ones_like(a[0])),
        Term("seal_friction", "force", lambda *a: (a[5] + a[6]) * _sign(a[8], 0.3)),
        Term("gravity_load", "force", lambda *a: a[7]),
        Term("gravity_load", "force", lambda *a: a[7] ** 2),
        Term("unequal_areas", "force", lambda *a: a[6]),
        Term("presliding_friction", "force", lambda *a: np.abs(_sign(a[8], 0.3))),
    ]
    current = [
        Term("current_lag", "actuation", lambda *a: a[2] - a[3]),
        Term("command_delay", "actuation", lambda *a: np.gradient(a[2])),
        Term("current_deadband", "actuation", lambda *a: _sign(a[2], 36.0)),
    ]
    return {
        "current": tuple(current),
        "motor_speed": tuple(torque),
        "pressure_a": _chamber(5, 6, 1.0),
        "pressure_b": _chamber(6, 5, -1.0),
        "piston_velocity": tuple(force),
    }


def _chamber(own: int, other: int, direction: float) -> tuple[Term, ...]:
    """Return the terms of a chamber's flow balance; pressures are the arguments of these places."""

    def room(*a: FloatArray) -> FloatArray:
        # the same flow lifts the pressure of a smaller volume more
        return np.asarray(1.0 / (1.2535e-5 + direction * 3.1337e-4 * a[7]) * 1.2535e-5)

    return (
        Term("", "flow", lambda *a: room(*a) * a[4]),
        Term("", "flow", lambda *a: room(*a) * a[8]),
        Term("", "flow", lambda *a: room(*a) * (a[own] - a[other])),
        Term(
            "turbulent_leakage", "flow",
            lambda *a: room(*a) * np.sign(a[own] - a[other]) * np.sqrt(np.abs(a[own] - a[other])),
        ),
        Term("external_leakage", "flow", lambda *a: room(*a) * a[own]),
        Term("relief_valve", "flow", lambda *a: room(*a) * np.maximum(a[own] - 17e6, 0.0)),
        Term("anti_cavitation", "flow", lambda *a: room(*a) * np.maximum(0.6e6 - a[own], 0.0)),
        Term(
            "entrained_air", "flow",
            lambda *a: room(*a) * (a[4] - 2800.0 * a[8]) / np.maximum(a[own], 1e5) ** 2,
        ),
        *_turning("pump_ripple", "flow", of_speed=True),
    )  # fmt: skip


@dataclass(frozen=True)
class Fit:
    """A sparse fit of one balance.

    Attributes:
        terms: of the library. coefficients: (terms,).
        shares: cause -> part of the discrepancy's variance that only its terms explain.
    """

    terms: tuple[Term, ...]
    coefficients: FloatArray
    shares: Mapping[str, float]

    def rate(self, arguments: tuple[FloatArray, ...]) -> FloatArray:
        """Return what the terms add to the rate of the state, (n,)."""
        total = np.zeros_like(arguments[0])
        for term, size in zip(self.terms, self.coefficients, strict=True):
            if size != 0.0:
                total += size * term.values(*arguments)
        return total


def enter(question: Question) -> Answer:
    """Regress, claim the causes whose terms are kept, and predict with all terms that are."""
    model = load_model(question.dataset.with_name("model.yaml"))
    parts = [discrepancies(run, model) for run in question.training]
    fits = {}
    for state, terms in library().items():
        kept = [(arguments, rates[state]) for arguments, rates in parts if state in rates]
        fits[state] = _sparse(terms, kept)
    return Answer(*_causes(question, fits), _predicted(question, model, fits))


def discrepancies(
    run: Run, model: Model
) -> tuple[tuple[FloatArray, ...], Mapping[str, FloatArray]]:
    """Return the arguments of the terms along a run, and what each balance misses there.

    Arguments are (n,), state -> (n,) SI a second; a locked piston has no force balance.
    """
    at = model.plant.at(model.vector())
    outputs = model.plant.outputs
    starts = np.arange(TICKS, run.time.size - TICKS, TICKS)
    missed = {state: np.zeros(starts.size) for state in STATES}
    for number, first in enumerate(starts):
        window = slice(first - TICKS, first + TICKS + 1)
        drive = Drive(
            run.time[window],
            {"current_command": run.command[window]},
            locked=run.locked,
            bypass_open=run.bypass_open,
            first=TICKS,
        )
        state = {name: float(values[first]) for name, values in run.measured.items()}
        ended = at.simulate(drive, state, STEP)[-1]
        for name in STATES:
            span = run.time[first + TICKS] - run.time[first]
            real = run.measured[name][first + TICKS]
            missed[name][number] = (real - ended[outputs.index(name)]) / span
    if run.locked:
        del missed["piston_velocity"]
    return tuple(values[starts] for values in _arguments(run)), missed


def _arguments(run: Run) -> tuple[FloatArray, ...]:
    speed = run.measured["motor_speed"]
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(run.time))])
    return (
        run.time, angle, run.command, run.measured["current"], speed, run.measured["pressure_a"],
        run.measured["pressure_b"], run.measured["piston_position"],
        run.measured["piston_velocity"],
    )  # fmt: skip


def _sparse(terms: tuple[Term, ...], parts: list[tuple[tuple[FloatArray, ...], FloatArray]]) -> Fit:
    """Return the sparse fit of the lowest BIC over the thresholds."""
    import pysindy

    columns = [np.column_stack([t.values(*arguments) for t in terms]) for arguments, _ in parts]
    scales = np.maximum(np.sqrt(np.mean(np.vstack(columns) ** 2, axis=0)), 1e-300)
    missed = np.concatenate([rates for _, rates in parts])
    size = max(float(np.std(missed)), 1e-300)
    scaled = [matrix / scales for matrix in columns]
    wanted = [rates[:, None] / size for _, rates in parts]
    best: tuple[float, FloatArray] = (np.inf, np.zeros(len(terms)))
    for threshold in THRESHOLDS:
        fitted = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-6),
            feature_library=pysindy.IdentityLibrary(),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a threshold leaves nothing is an answer
            fitted.fit(scaled, t=1.0, x_dot=wanted)
        found = np.asarray(fitted.coefficients())[0]
        left = np.concatenate(wanted)[:, 0] - np.vstack(scaled) @ found
        count = left.size
        bic = count * np.log(np.mean(left**2)) + np.count_nonzero(found) * np.log(count)
        if bic < best[0]:
            best = (float(bic), found)
    shares = _shares(terms, best[1], np.vstack(scaled), np.concatenate(wanted)[:, 0])
    return Fit(terms, best[1] * size / scales, shares)


def _shares(
    terms: tuple[Term, ...], coefficients: FloatArray, matrix: FloatArray, wanted: FloatArray
) -> dict[str, float]:
    """Return what is lost without the terms of each cause, all others fitted again."""

    def left(keep: NDArray[np.bool_]) -> float:
        columns = matrix[:, keep]
        solved = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        return float(np.mean((wanted - columns @ solved) ** 2))

    chosen = coefficients != 0.0
    total, base = float(np.mean(wanted**2)), left(chosen)
    causes = {term.cause for term, on in zip(terms, chosen, strict=True) if on and term.cause}
    return {
        cause: (left(chosen & np.array([term.cause != cause for term in terms])) - base) / total
        for cause in sorted(causes)
    }


def _causes(
    question: Question, fits: Mapping[str, Fit]
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """Return the causes to claim and those that explain too little, the strongest first."""
    shares: dict[str, float] = {}
    equations: dict[str, str] = {}
    for fit in fits.values():
        for cause, share in fit.shares.items():
            if cause in question.effects and share > shares.get(cause, 0.0):
                shares[cause] = share
                equations[cause] = next(t.equation for t in fit.terms if t.cause == cause)
    order = sorted(shares, key=lambda name: -shares[name])
    claimed = [name for name in order if shares[name] >= KEPT]
    return (
        tuple(Cause(name, equations[name]) for name in claimed),
        tuple(Cause(name, equations[name]) for name in order if name not in claimed),
    )


def _predicted(
    question: Question, model: Model, fits: Mapping[str, Fit]
) -> dict[str, dict[str, FloatArray]]:
    return {run.name: _simulated(run, model, fits) for run in question.held_out}


def _simulated(run: Run, model: Model, fits: Mapping[str, Fit]) -> dict[str, FloatArray]:
    """Advance the declared model tick by tick, and add what the terms say."""
    session = Session(
        model.plant, model.vector(), first_readings(run), locked=run.locked,
        bypass_open=run.bypass_open, step=STEP,
    )  # fmt: skip
    outputs = model.plant.outputs
    places = [outputs.index(name) for name in (*STATES[:4], "piston_position", STATES[4])]
    values = np.full((run.time.size, len(outputs)), np.nan)
    values[0] = session.reading
    slopes = np.gradient(run.command)
    angle = 0.0
    acting = {
        state: fit
        for state, fit in fits.items()
        if np.any(fit.coefficients) and not (run.locked and state == "piston_velocity")
    }
    for tick in range(1, run.time.size):
        session.advance(float(run.time[tick]), float(run.command[tick - 1]))
        reading = session.reading
        if not np.isfinite(reading).all() or np.abs(reading).max() > 1e12:
            break
        span = float(run.time[tick] - run.time[tick - 1])
        current, speed, p_a, p_b, position, velocity = (float(reading[k]) for k in places)
        angle += speed * span
        point = (
            float(run.time[tick]), angle, float(run.command[tick - 1]), current, speed, p_a, p_b,
            position, velocity,
        )  # fmt: skip
        arguments = tuple(np.array([value]) for value in point)
        for state, fit in acting.items():
            session.shift(state, span * _rate(fit, arguments, float(slopes[tick - 1])))
        values[tick] = reading
    return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(outputs)}


def _rate(fit: Fit, arguments: tuple[FloatArray, ...], slope: float) -> float:
    """Return the rate at one moment; the command's slope is that of the whole run."""
    total = 0.0
    for term, size in zip(fit.terms, fit.coefficients, strict=True):
        if size != 0.0:
            value = slope if term.cause == "command_delay" else float(term.values(*arguments)[0])
            total += float(size) * value
    return total
