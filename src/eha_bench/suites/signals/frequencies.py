"""Frequencies of a signal: a list, or a grid between two."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Discriminator, Field, Tag

from eha_bench.core.signal import Spacing
from eha_bench.core.yaml_file import StrictModel
from eha_bench.suites.signals.signal_model import Hertz


class FrequencyGrid(StrictModel):
    """`count` frequencies from `first` to `last`, both included."""

    first: Hertz
    last: Hertz
    count: Annotated[int, Field(ge=2, le=1000)]
    spacing: Spacing = Spacing.LOGARITHMIC

    def values(self) -> tuple[float, ...]:
        """Return the frequencies in Hz."""
        make = np.geomspace if self.spacing is Spacing.LOGARITHMIC else np.linspace
        return tuple(float(value) for value in make(self.first, self.last, self.count))


def _form(value: object) -> str:
    return "list" if isinstance(value, (list, tuple)) else "grid"


Frequencies = Annotated[
    Annotated[FrequencyGrid, Tag("grid")]
    | Annotated[tuple[Hertz, ...], Field(min_length=1), Tag("list")],
    Discriminator(_form),
]
"""A grid, or a list of frequencies in Hz."""
