"""Entrant `evolution`: CMA-ES (`cma`) over all effects at once, thinned by BIC.

Calibrated parameters and the sizes of all registered effects are one vector. CMA-ES (Hansen and
Ostermeier 2001, doi:10.1162/106365601750190398) minimises the simulation error over windows of the
training runs; then effects are switched off one after the other for as long as BIC (Schwarz 1978,
doi:10.1214/aos/1176344136) falls, and what is left is fitted once more. Simulator, windows and
noise are those of `eha-bench diagnose`, so that what differs is the search.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
from benchmarks.league.answer import Answer, Cause
from benchmarks.league.question import FloatArray, Question
from benchmarks.league.simulation import predicted

from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import pooled_noise
from eha_bench.diagnosis.data.ticks import on_ticks
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.candidates import Start, all_starts
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.plants.model import DeclaredEffect, Model

STEP = 3.4e-4
"""Integration step of the search, s."""
EVALUATIONS = 3000
"""Simulations of the training windows at budget 1: two thirds to find, the rest to thin."""
SPREAD = 0.1
"""By how much a calibrated parameter may be off, as a share: the first step in it."""
SEED = 1


class Search:
    """A vector of numbers about 0 with steps of about 1, and what it means.

    Attributes:
        keys: calibrated parameters, in front. starts: effects, one number each, behind.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.model = dataset.model
        plant = self.model.plant
        layout = plant.layout
        determined = dataset.determined(plant)
        runs = []
        for run in dataset.training:
            sampled = on_ticks(run.topics(), dataset.inputs, determined)
            runs.append(admit(run, sampled, dataset.inputs, determined, roles=plant.roles))
        noise = pooled_noise(runs, determined)
        windows = [window for run in runs for window in cut_windows(run, noise)]
        self.problem = Problem(plant, windows, noise, STEP)
        self.base = self.model.vector()
        self.keys = self.model.calibrate
        declared = [effect.id for effect in self.model.effects]
        found: dict[str, Start] = {}
        for start in all_starts(layout, self.base, declared, self.keys):
            if not start.is_parameter:
                found.setdefault(start.candidate, start)
        self.starts = tuple(found.values())
        self.on = np.ones(len(self.starts), dtype=bool)
        self.problem.prepare(self.base)

    def vector(self, numbers: FloatArray) -> FloatArray:
        """Return the plant's parameters."""
        layout = self.model.plant.layout
        out = self.base.copy()
        count = len(self.keys)
        for key, number in zip(self.keys, numbers[:count], strict=True):
            at, parameter = layout.index[key], layout.by_key[key]
            value = self.base[at] * math.exp(SPREAD * float(np.clip(number, -15.0, 15.0)))
            out[at] = min(max(value, parameter.low), parameter.high)
        for start, number, on in zip(self.starts, numbers[count:], self.on, strict=True):
            size = float(number) if start.low < start.neutral else abs(float(number))
            if on and size != 0.0:
                out = start.apply(out, size)
                out[start.strength_at] = np.clip(out[start.strength_at], start.low, start.high)
        return out

    def cost(self, numbers: FloatArray) -> float:
        """Return the softened sum of squares of the whitened residual."""
        soft, _ = soften(self.problem.residual(self.vector(numbers)))
        return float(soft @ soft)

    def bic(self, cost: float) -> float:
        """Return BIC of a cost with what is on now, for noise of unknown size."""
        count = self.problem.size
        return count * math.log(max(cost, 1.0) / count) + int(self.on.sum()) * math.log(count)

    def fit(self, numbers: FloatArray, evaluations: int, step: float) -> tuple[FloatArray, float]:
        """Minimise from a point; what is off stays where it is."""
        import cma

        free = np.concatenate([np.ones(len(self.keys), dtype=bool), self.on])

        def full(part: FloatArray) -> FloatArray:
            out = numbers.copy()
            out[free] = part
            return out

        options = {"maxfevals": max(evaluations, 10), "seed": SEED, "verbose": -9}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            strategy = cma.CMAEvolutionStrategy(numbers[free], step, options)
            while not strategy.stop():
                asked = strategy.ask()
                strategy.tell(asked, [self.cost(full(np.asarray(part))) for part in asked])
        found = full(np.asarray(strategy.result.xbest))
        return found, float(strategy.result.fbest)


def enter(question: Question) -> Answer:
    """Search, thin, and claim the effects that BIC keeps, the costliest to miss first."""
    search = Search(load_dataset(question.dataset))
    budget = max(int(EVALUATIONS * question.budget), 60)
    start = np.zeros(len(search.keys) + len(search.starts))
    numbers, cost = search.fit(start, budget * 2 // 3, 0.3)
    lost: dict[str, float] = {}
    for _ in range(2):
        numbers, cost, lost = _thinned(search, numbers, cost)
        numbers, cost = search.fit(numbers, budget // 6, 0.1)
    _, _, lost = _thinned(search, numbers, cost)
    kept = [s for s, on in zip(search.starts, search.on, strict=True) if on]
    kept.sort(key=lambda item: -lost[item.candidate])
    claimed = tuple(Cause(s.candidate, s.equation) for s in kept)
    rest = sorted((s for s in search.starts if s not in kept), key=lambda s: -lost[s.candidate])
    others = tuple(Cause(s.candidate, s.equation) for s in rest if s.candidate in question.effects)
    model = _model(search, numbers)
    return Answer(
        tuple(cause for cause in claimed if cause.id in question.effects),
        others,
        predicted(question, model),
    )


def _thinned(
    search: Search, numbers: FloatArray, cost: float
) -> tuple[FloatArray, float, dict[str, float]]:
    """Switch off what BIC does not want, the least missed first; return what each would cost."""
    lost = {start.candidate: -math.inf for start in search.starts}
    order: list[tuple[float, int]] = []
    before = search.bic(cost)
    for place, start in enumerate(search.starts):
        if search.on[place]:
            search.on[place] = False
            lost[start.candidate] = search.bic(search.cost(numbers)) - before
            search.on[place] = True
            order.append((lost[start.candidate], place))
    for _, place in sorted(order):
        search.on[place] = False
        without = search.cost(numbers)
        if search.bic(without) <= before:
            before, cost = search.bic(without), without
            numbers = numbers.copy()
            numbers[len(search.keys) + place] = 0.0
        else:
            search.on[place] = True
    return numbers, cost, lost


def _model(search: Search, numbers: FloatArray) -> Model:
    """Return the declared model with what was found."""
    layout = search.model.plant.layout
    vector = search.vector(numbers)
    model = search.model.with_parameters(
        {key: float(vector[layout.index[key]]) for key in search.keys}
    )
    for start, on in zip(search.starts, search.on, strict=True):
        if not on:
            continue
        effect = layout.effect(start.candidate)
        values: dict[str, float | str | list[float]] = {}
        for parameter in effect.parameters:
            if parameter.size > 1:
                continue
            value = float(vector[layout.index[f"{effect.id}.{parameter.name}"]])
            values[parameter.name] = parameter.choices[int(value)] if parameter.choices else value
        model = replace(model, effects=(*model.effects, DeclaredEffect(effect.id, values)))
    return model
