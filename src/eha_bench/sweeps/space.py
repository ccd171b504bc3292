"""The space of a sweep: its factors, and the case at any point of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eha_bench.core.errors import Mistakes
from eha_bench.core.located import Located
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.factor import KINDS, Factor, factor_of
from eha_bench.sweeps.span import Value

Point = tuple[Value, ...]
"""A value for each factor, SI, in the order of the space."""


@dataclass(frozen=True)
class Space:
    """Factors of one case.

    Attributes:
        case: what is varied. factors: what varies, in the order of the file.
    """

    case: Case
    factors: tuple[Factor, ...]

    def at(self, point: Sequence[Value]) -> Case:
        """Return the case with the values of a point."""
        case = self.case
        for kind in KINDS.values():
            values = {
                factor.key: factor.as_applied(value)
                for factor, value in zip(self.factors, point, strict=True)
                if type(factor) is kind
            }
            if values:
                case = kind.apply(case, values)
        return case

    def values_by_key(self, point: Sequence[Value]) -> dict[str, Value]:
        """Return a point's values by their factors' keys."""
        return {factor.key: value for factor, value in zip(self.factors, point, strict=True)}


def space_of(case: Case, blocks: Mapping[str, Located]) -> Space:
    """Return the space that the blocks of a file declare.

    Args:
        case: what is varied. blocks: entries by factor, for each kind (gains, parameters, trials).

    Raises:
        InputError: the case has no such factor, or it cannot be what is asked; further mistakes in
            `also`.
    """
    mistakes = Mistakes()
    found: list[Factor] = []
    for kind, block in blocks.items():
        for key, entry in block.items():
            with mistakes:
                found.append(factor_of(KINDS[kind], case, key, entry))
    mistakes.tell()
    return Space(case, tuple(found))
