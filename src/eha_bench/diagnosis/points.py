"""A diagnosis from operating points: a handful of steady states with their uncertainty.

Where time plays no part there is nothing to replay, and too little data to resample. So every
candidate (an effect at its starting points, or a parameter of the plant that may be off) is fitted
to the points, together with the parameters under `calibrate`, and

* it is a cause only if what it leaves is no more than the points' own uncertainty makes (tested
  by chi-square);
* among those, the one that has to be stretched least wins: a default is a typical size, and three
  times that is taken as one standard deviation of what is plausible (a Gaussian prior);
* the others are named as what these points cannot tell from it.

The uncertainty of a channel is a channel of the log, `current_uncertainty` for `current` (one
standard deviation). Source of the test: Bevington, Robinson, Data Reduction and Error Analysis for
the Physical Sciences, 3rd ed. 2003, section 4.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError, MissingChannelError, Place
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.data.dataset import Dataset, Run, Use
from eha_bench.diagnosis.fit.candidates import Start, all_starts, value_start
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import (
    ADDED,
    Diagnosis,
    FoundEffect,
    RankLine,
    Unknown,
    Verdict,
)
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.replay.errors_by_channel import replay_errors
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.plants.model import Model
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.static_plant import StaticPlant

SUFFIX = "_uncertainty"
_PLAUSIBLE = 3.0
_OFF_BY = 5.0
"""Factor by which a published value may be wrong."""
_OFF = 0.05
_BELIEVED = 0.01
_FAINT = 1e-3
"""Pull of a calibrated parameter to where it began, for its own size: it holds what no point tells,
and shows in nothing that any point does."""
_LOOSE = 30.0
"""Standard deviation, in sizes of the parameter, from which nothing but the pull holds it."""


@dataclass(frozen=True)
class Points:
    """Operating points of one run: inputs, what was measured, and its uncertainty, SI."""

    run: Run
    inputs: dict[str, FloatArray]
    measured: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class TriedCandidate:
    """A candidate after its fit.

    Attributes:
        start: where it began; None for the plant's own parameters alone.
        vector: parameters. left: chi-square of what remains. stretch: chi-square of its size.
        chance: probability that the points' uncertainty alone leaves as much.
        spread: key -> standard deviation of what was fitted, SI (inf: the points do not tell).
    """

    start: Start | None
    vector: FloatArray
    left: float
    stretch: float
    chance: float
    spread: dict[str, float]


def diagnose_points(dataset: Dataset, progress: ProgressHook) -> Diagnosis:
    """Return the diagnosis of a static plant.

    Raises:
        InputError: a run without points, without an input, or without its uncertainty; other inputs
            than the plant's.
    """
    plant = dataset.model.plant
    if not isinstance(plant, StaticPlant):
        raise InputError(f"{plant.id} has states: it needs recordings over time")
    plant.check_inputs(dataset.inputs)
    progress("read", 0.0)
    training = [_points(run, plant) for run in dataset.training]
    layout = plant.layout
    declared = dataset.model.vector()
    own = [layout.index[key] for key in dict.fromkeys(dataset.model.calibrate)]
    with np.errstate(over="ignore"):
        beyond = not np.isfinite(np.sum(_weighted_residual(plant, training, declared) ** 2))
    if beyond:
        raise InputError(
            "the points are beyond what can be computed",
            where=Place(file=dataset.source),
            hint="check unit, scale and offset in channels.yaml",
        )
    base = _fit_candidate(plant, training, declared, None, own)
    named = [item.id for item in dataset.model.effects]
    starts = [*all_starts(layout, base.vector, named, dataset.model.calibrate),
              *_parameters(plant, base.vector, own)]  # fmt: skip
    tried: dict[str, TriedCandidate] = {}
    for number, start in enumerate(starts):
        progress("search", number / len(starts))
        found = _fit_candidate(plant, training, base.vector, start, own)
        best = tried.get(start.candidate)
        if best is None or _cost(found) < _cost(best):
            tried[start.candidate] = found
    ranked = sorted(tried.values(), key=_cost)
    return _diagnosis(dataset, plant, training, base, ranked)


def _points(run: Run, plant: StaticPlant) -> Points:
    recording = run.read()
    where = Place(file=str(run.log))
    for name in (*plant.inputs, *plant.outputs):
        if name not in recording:
            raise MissingChannelError(name, where=where, have=tuple(recording.values))
    sigmas = []
    for name in plant.outputs:
        if name + SUFFIX not in recording:
            raise InputError(
                f"operating points need the uncertainty of '{name}'",
                where=where,
                hint=f"give a channel '{name}{SUFFIX}': one standard deviation, in its unit",
            )
        sigmas.append(recording[name + SUFFIX])
    inputs = {name: np.array(recording[name]) for name in plant.inputs}
    measured = np.column_stack([recording[name] for name in plant.outputs])
    sigma = np.column_stack(sigmas)
    finite = all(np.isfinite(values).all() for values in (measured, sigma, *inputs.values()))
    if not (finite and (sigma > 0.0).all()):
        raise InputError(
            "a point is not finite, or its uncertainty is not positive",
            where=where,
            hint="leave such a point out",
        )
    return Points(run, inputs, measured, sigma)


def _parameters(plant: StaticPlant, vector: FloatArray, own: Sequence[int]) -> list[Start]:
    """Return the plant's own parameters as candidates: a published value may be wrong."""
    found = []
    for parameter in plant.layout.parameters:
        at = plant.layout.index[parameter.name]
        value = float(vector[at])
        if at in own or value == 0.0:
            continue
        found.append(value_start(parameter.name, parameter, at, value, _OFF_BY, 1.0 + _OFF))
    return found


def _weighted_residual(
    plant: StaticPlant, runs: Sequence[Points], vector: FloatArray
) -> FloatArray:
    parts = [
        ((item.measured - plant.respond(vector, item.inputs)) / item.sigma).ravel() for item in runs
    ]
    return np.concatenate(parts)


def _fit_candidate(
    plant: StaticPlant,
    runs: Sequence[Points],
    vector: FloatArray,
    start: Start | None,
    own: Sequence[int],
) -> TriedCandidate:
    """Fit a candidate, with a prior on its size, and the calibrated parameters, without one."""
    layout = plant.layout
    begin = vector if start is None else start.apply(vector)
    keys = {at: name for name, at in layout.index.items()}
    free = [*own, *(layout.index[key] for key in (start.keys if start else ()))]
    typical = abs(start.strength - start.neutral) * _PLAUSIBLE if start else 1.0

    def filled(values: FloatArray) -> FloatArray:
        full = begin.copy()
        full[free] = values
        return full

    def stretched(full: FloatArray) -> float:
        return (full[start.strength_at] - start.neutral) / typical if start else 0.0

    done, spread = begin, {}
    if free:
        bounds = [_bounds(layout.by_key[keys[at]], start, at) for at in free]
        low, high = np.array(bounds).T
        first = np.clip(begin[free], low + 1e-9 * (high - low), high - 1e-9 * (high - low)) \
            if np.isfinite(high - low).all() else np.clip(begin[free], low, high)  # fmt: skip
        scale = np.maximum(np.abs(first), 1e-3 * np.where(np.isfinite(high), np.abs(high), 1.0))
        held = slice(len(own))
        # as in a fit over time: what a fit brought to nearly nothing is not held there
        usual = np.array([0.1 * abs(layout.by_key[keys[at]].default) for at in free])
        size = np.maximum(np.abs(begin[free]), usual)
        size = np.where(size > 0.0, size, scale)
        scale[held] = size[held]

        def residual(values: FloatArray) -> FloatArray:
            full = filled(values)
            pulled = _FAINT * (values[held] - first[held]) / size[held]
            return np.concatenate(
                (_weighted_residual(plant, runs, full), pulled, [stretched(full)])
            )

        fit = least_squares(residual, first, bounds=(low, high), x_scale=np.maximum(scale, 1e-30))
        # the solver stays inside its bounds by the last digits
        ends = np.where(np.abs(fit.x - low) < 1e-6 * scale, low, fit.x)
        done = filled(np.where(np.abs(high - ends) < 1e-6 * scale, high, ends))
        # by their sizes: next to N*m/A a column of m^3/rad is all there is
        jacobian = np.asarray(fit.jac, dtype=np.float64) * size
        strengths, directions = np.linalg.svd(jacobian, full_matrices=False)[1:]
        deviation = np.linalg.norm(directions / np.maximum(strengths, 1e-150)[:, None], axis=0)
        dead = np.linalg.norm(jacobian, axis=0) == 0.0
        dead[held] |= deviation[held] > _LOOSE
        deviation = np.where(dead, np.inf, deviation * size)
        spread = {keys[at]: float(deviation[k]) for k, at in enumerate(free)}
    rest = _weighted_residual(plant, runs, done)
    left = float(rest @ rest)
    # what no point tells takes none of their freedom
    freedom = rest.size - sum(np.isfinite(size) for size in spread.values())
    chance = float(chdtrc(max(freedom, 1), left))
    return TriedCandidate(start, done, left, stretched(done) ** 2, chance, spread)


def _bounds(parameter: Parameter, start: Start | None, at: int) -> tuple[float, float]:
    if start is not None and at == start.strength_at:
        return start.low, start.high
    return float(parameter.low), float(parameter.high)


def _cost(item: TriedCandidate) -> float:
    return item.left + item.stretch


def _diagnosis(
    dataset: Dataset,
    plant: StaticPlant,
    training: list[Points],
    base: TriedCandidate,
    ranked: list[TriedCandidate],
) -> Diagnosis:
    model = dataset.model
    own = tuple(dict.fromkeys(model.calibrate))
    notes = [
        f"{sum(item.measured.size for item in training)} operating points were fitted; "
        f"chi-square {base.left:.3g} before"
    ]
    recalibrated = revised_model(model, base.vector, own)
    believed = [item for item in ranked if item.chance > _BELIEVED]
    effects: tuple[FoundEffect, ...] = ()
    equivalent: tuple[tuple[str, ...], ...] = ()
    unknown: Unknown | None = None
    best: TriedCandidate | None = believed[0] if believed else None
    verdict = Verdict.EFFECT
    if base.chance > _BELIEVED:
        verdict, best = Verdict.NONE, None
    elif best is None:
        verdict = Verdict.UNKNOWN
        unknown = Unknown(str(plant.balance), plant.inputs, "no candidate brings these points "
                          "within their uncertainty")  # fmt: skip
    final = base if best is None else best
    added: list[str] = []
    keys = [*own]
    if best is not None and best.start is not None:
        if best.start.is_parameter:
            verdict = Verdict.NONE
            keys += best.start.keys
            notes.append(f"{best.start.keys[0]} is off: the points ask for another value")
        else:
            added.append(best.start.candidate)
            effects = (_effect(plant, best, base),)
        others = [item for item in believed[1:] if item.start and not item.start.is_parameter]
        if others and effects:
            equivalent = (
                (effects[0].id, *(item.start.candidate for item in others if item.start)),
            )
            notes += [_stretch(plant, item) for item in others]
    separate = {name: plant.layout.effect(name).separate for group in equivalent for name in group}
    after = revised_model(model, final.vector, keys, added)
    held_out = [_points(run, plant) for run in dataset.held_out]
    models = (model, recalibrated, after)
    replays = tuple(_replay(plant, item, models) for item in (*training, *held_out))
    sigma = np.concatenate([item.sigma for item in (*training, *held_out)])
    floors = {name: float(np.sqrt(np.mean(sigma[:, k] ** 2)))
              for k, name in enumerate(plant.outputs)}  # fmt: skip
    errors = {
        use: replay_errors([item for item in replays if item.use is use], floors) for use in Use
    }
    notes.append(f"chi-square {final.left:.3g} after")
    return Diagnosis(
        verdict,
        after,
        recalibrated,
        effects,
        unknown,
        equivalent,
        separate,
        tuple(_line(plant, item, base, best) for item in ranked),
        train=errors[Use.TRAIN],
        holdout=errors[Use.HOLDOUT],
        unseen=errors[Use.UNSEEN],
        calibrated={key: _estimate(plant, key, final) for key in keys if key in final.spread},
        undetermined=_undetermined_parameters(own, final),
        notes=tuple(notes),
        replays=replays,
    )


def _replay(plant: StaticPlant, item: Points, models: Sequence[Model]) -> Replay:
    measured = {name: item.measured[:, k] for k, name in enumerate(plant.outputs)}
    simulated = []
    for model in models:
        values = plant.respond(model.vector(), item.inputs)
        simulated.append({name: values[:, k] for k, name in enumerate(plant.outputs)})
    ticks = np.arange(item.measured.shape[0], dtype=np.float64)
    run = item.run
    return Replay(
        run.name, run.use, run.locked, run.bypass_open, ticks, item.inputs, measured,
        tuple(simulated), tuple(simulated), dict.fromkeys(measured, 0.0),
    )  # fmt: skip


def _effect(plant: StaticPlant, best: TriedCandidate, base: TriedCandidate) -> FoundEffect:
    assert best.start is not None
    effect = plant.layout.effect(best.start.candidate)
    index = plant.layout.index
    words = effect.words_at(
        {
            p.name: float(best.vector[index[f"{effect.id}.{p.name}"]])
            for p in effect.parameters
            if p.size == 1
        }
    )
    numbers = {key.split(".", 1)[1]: _estimate(plant, key, best) for key in best.start.keys}
    share = 1.0 - best.left / base.left
    equation = effect.equation(words)
    return FoundEffect(
        effect.id, str(equation.value), numbers, words, share, _by_chance(best, base)
    )


def _estimate(plant: StaticPlant, key: str, item: TriedCandidate) -> Estimate:
    parameter = plant.layout.by_key[key]
    value = float(item.vector[plant.layout.index[key]])
    spread = 1.96 * item.spread.get(key, np.inf)
    low, high = max(parameter.low, value - spread), min(parameter.high, value + spread)
    return Estimate(value, low, high, parameter.unit)


def _undetermined_parameters(own: Sequence[str], item: TriedCandidate) -> tuple[str, ...]:
    """Return, in words, which calibrated parameters the points do not determine."""
    loose = [key for key in own if np.isinf(item.spread.get(key, 0.0))]
    if not loose:
        return ()
    if len(loose) == 1:
        return (f"{loose[0]} is not determined by these points",)
    return (f"{', '.join(loose[:-1])} and {loose[-1]} only in combination",)


def _stretch(plant: StaticPlant, item: TriedCandidate) -> str:
    assert item.start is not None
    value = item.vector[item.start.strength_at]
    unit = plant.layout.units_at(item.vector)[item.start.keys[0]]
    ratio = abs(value - item.start.neutral) / abs(item.start.strength - item.start.neutral)
    return (
        f"{item.start.candidate} would explain these points too, but with "
        f"{item.start.keys[0].split('.')[-1]} = {value:.3g} {unit}".rstrip()
        + f", {ratio:.1f} times its typical size"
    )


def _line(
    plant: StaticPlant, item: TriedCandidate, base: TriedCandidate, best: TriedCandidate | None
) -> RankLine:
    assert item.start is not None
    score = 1.0 - item.left / max(base.left, 1e-300)
    error = float(np.sqrt(item.left))
    if item is best and not item.start.is_parameter:
        reason = ADDED
    elif item is best:
        reason = "a parameter's value explains the points; no effect is needed"
    elif item.chance > _BELIEVED:
        reason = _stretch(plant, item)
    else:
        reason = (
            f"what it leaves (chi-square {item.left:.3g}) is more than the points' uncertainty "
            f"makes (p {item.chance:.1g})"
        )
    return RankLine(item.start.candidate, score, _by_chance(item, base), error, reason)


def _by_chance(item: TriedCandidate, base: TriedCandidate) -> float:
    """Probability that a candidate gains that much where it does nothing (likelihood ratio)."""
    assert item.start is not None
    return float(chdtrc(len(item.start.keys), max(base.left - item.left, 0.0)))
