"""The smallest difference that matters between two values of a metric.

    margin := number "%" "of baseline" | quantity

`5 % of baseline` is a share of the baseline's value; so is `5 %` alone wherever the metric has a
unit. Of a metric without a unit `5 %` is 0.05, as it is in a limit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from eha_bench.core.errors import UnitError
from eha_bench.core.units import parse, parse_difference

_SHARE = re.compile(r"^\s*([-+\d.eE]+)\s*%\s*(of\s+(?:the\s+)?baseline)?\s*$")


@dataclass(frozen=True)
class EquivalenceMargin:
    """A difference up to which two values count as the same.

    Attributes:
        absolute: in the metric's SI unit.
        share: of the baseline's magnitude; one of the two is 0.
        text: as the suite wrote it.
    """

    absolute: float
    share: float
    text: str

    def about(self, value: float) -> float:
        """Return the difference that matters about a baseline's value, SI."""
        return self.absolute + self.share * abs(value)


def parse_margin(text: str | float, unit: str) -> EquivalenceMargin:
    """Return what `5 % of baseline`, `5 %`, `2 ms` or a bare SI number means for a metric.

    Raises:
        UnitError: not a quantity of that dimension, negative, or not finite.
    """
    found = _SHARE.match(text) if isinstance(text, str) else None
    written = str(text).strip()
    hint = f"write '1 {unit}' or '5 % of baseline'" if unit else "write '0.01' or '5 % of baseline'"
    if found is not None and (found[2] or unit):
        margin = EquivalenceMargin(0.0, parse(f"{found[1]} %", ""), written)
    else:
        margin = EquivalenceMargin(parse_difference(text, unit), 0.0, written)
    if not (math.isfinite(margin.absolute + margin.share) and margin.absolute + margin.share >= 0):
        raise UnitError(f"'{written}' is not a difference", hint=hint)
    return margin
