"""A parameter of a plant or an effect: name, unit, value, bounds, and where its value is from."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One number of a model, SI.

    Attributes:
        name: public name, as in model.yaml.
        unit: SI unit.
        default: value where the model file says nothing.
        low, high: physical bounds, used by calibration.
        symbol: symbol in the source.
        source: where the default comes from.
        assumed: True where the source does not give the value; `source` then says why this one.
        size: how many numbers it holds (1: a scalar; more: a list, as the knots of a curve).
        choices: where the value is one of these words (stored as its place in the list).
    """

    name: str
    unit: str
    default: float
    low: float
    high: float
    symbol: str = ""
    source: str = ""
    assumed: bool = False
    size: int = 1
    choices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a default outside its bounds: a typing error in a plug-in."""
        if not (self.low <= self.default <= self.high) or math.isnan(self.default):
            raise ValueError(f"parameter {self.name}: {self.default} outside its bounds")
