"""A suite with the simulator it is run on: what factors change."""

from __future__ import annotations

from dataclasses import dataclass

from eha_bench.core.errors import InputError
from eha_bench.metrics.scoring import load_metrics
from eha_bench.suites import Suite
from eha_bench.targets.simulator import Simulator
from eha_bench.targets.target import Target


@dataclass(frozen=True)
class Case:
    """A suite, and the model and controllers it is run on."""

    suite: Suite
    simulator: Simulator


def case_of(suite: Suite, target: Target) -> Case:
    """Return the case of a suite on a target.

    Raises:
        InputError: the target is not a simulator of ours, whose model and gains are ours to change,
            or a metric of the suite cannot be loaded.
    """
    if not isinstance(target, Simulator):
        raise InputError(
            f"{target.identity.name} is not a simulator whose model and gains can be varied",
            hint="give a model.yaml, or a target.yaml with 'target: simulator'",
        )
    load_metrics(suite.trials)
    return Case(suite, target)
