"""Conditions that a machine is run in: ranges of its parameters that no recording was made to tell.

Oil between cold and hot, a load between none and full, a supply that sags: each draw of a posterior
gets a value of each, uniform over its range (by ratios where the range says `log`), whatever was
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from eha_bench.plants.values import with_values
from eha_bench.posterior.posterior import Draw
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.factor import Factor, ModelParameter
from eha_bench.sweeps.space import space_of
from eha_bench.sweeps.sweep_file import SweepFile

_STREAM: Final = 1
"""Sets what is drawn here apart from what the posterior draws by the same seed."""


@dataclass(frozen=True)
class Conditions:
    """Ranges of a model's parameters; none where nothing varies."""

    factors: tuple[Factor, ...] = ()

    def met_by(self, draws: Sequence[Draw], seed: int) -> tuple[Draw, ...]:
        """Return machines in different conditions; the same seed gives the same."""
        return (
            tuple(self._with_conditions(draw, seed) for draw in draws)
            if self.factors
            else tuple(draws)
        )

    def _with_conditions(self, draw: Draw, seed: int) -> Draw:
        shares = np.random.default_rng([seed, draw.number, _STREAM]).random(len(self.factors))
        drawn = {
            factor.key: float(factor.span.at(float(share)))
            for factor, share in zip(self.factors, shares, strict=True)
        }
        return replace(draw, model=with_values(draw.model, drawn), values={**draw.values, **drawn})


ANY: Final = Conditions()
"""No ranges: machines as they were fitted."""


def conditions_of(case: Case, file: SweepFile) -> Conditions:
    """Return the conditions that a file in the form of a sweep.yaml gives a case.

    Raises:
        InputError: it varies gains or trials, or what the model does not have.
    """
    for kind, block in file.blocks.items():
        if kind != ModelParameter.kind and block.value:
            raise block.error(
                f"conditions are parameters of the model, and these are {kind}",
                hint="name them under 'over: parameters:', or vary the others with `sweep`",
            )
    return Conditions(space_of(case, file.blocks).factors)
