"""Which channel that is not logged would separate rivals that nothing permitted does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.errors import UnitError
from eha_bench.experiment.candidates import Experiment, ExperimentSettings
from eha_bench.experiment.decision import DrawRows, inner_products, odds
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.permitted import Limit, SetUp
from eha_bench.experiment.proposal import SensorAdvice
from eha_bench.experiment.response import Bench, respond
from eha_bench.targets.sensors import RIG_SENSORS

_SHARE = 1e-3
"""Noise of a sensor without a description, as a share of what it would read."""
_HELPS = 0.01
"""What a sensor has to add to the probability of naming the right rival to be worth a word."""


def advice(
    rivals: Sequence[Hypothesis],
    layout: DrawRows,
    candidate: Experiment,
    plan: ExperimentSettings,
    bench: Bench,
    limits: Mapping[SetUp, Mapping[str, Limit]],
) -> SensorAdvice | None:
    """Return the channel with which an experiment would most surely decide; None if none helps.

    Args:
        rivals, layout: what is simulated. candidate: the best experiment. plan: of the suite.
        bench: what is measured already. limits: by setup.
    """
    plant = rivals[0].model.plant
    trial = plan.trials([candidate], ["t"])[0]
    responses = respond(
        rivals, layout.points, trial, bench, limits[candidate.setup], plan.commanded
    )
    ticks = [responses.outputs[0].shape[1]]
    alone = inner_products(layout, responses.outputs, plant.outputs, responses.bench, ticks, [7])
    (without,) = odds(layout, alone)
    logged = {*bench.channels, *bench.inputs, plan.commanded.channel}
    best: SensorAdvice | None = None
    for name in plant.outputs:
        if name in logged:
            continue
        column = plant.outputs.index(name)
        reads = np.concatenate([item[:, :, column].ravel() for item in responses.outputs])
        noise = _noise(name, float(np.ptp(reads)))
        if not noise > 0.0:
            continue
        here = responses.bench
        more = replace(here, channels=(*here.channels, name), noise=np.append(here.noise, noise))
        grams = inner_products(layout, responses.outputs, plant.outputs, more, ticks, [7])
        (found,) = odds(layout, grams)
        if found.right > (without.right + _HELPS if best is None else best.right):
            best = SensorAdvice(name, noise, plant.units.get(name, ""), found.right)
    return best


def _noise(name: str, span: float) -> float:
    """Return the noise of a usual sensor of a channel, SI."""
    if name in RIG_SENSORS:
        try:
            return RIG_SENSORS[name].in_si(name)[0]
        except UnitError:
            pass
    return _SHARE * span
