"""A parameter of a plant or an effect: name, unit, value, bounds, and where its value is from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

MOST: Final = 1e40
"""SI; a number of a machine beyond it is a slip of the pen, and makes infinite what it meets."""
UNLIMITED: Final = 1e9
"""SI; a limit of a command of a part that is declared without one: none that matters."""


@dataclass(frozen=True)
class Parameter:
    """One number of a model, SI.

    Attributes:
        name: public name, as in model.yaml.
        unit: SI unit.
        default: value where the model file says nothing; for a choice the place of the word.
        low, high: physical bounds, used by calibration.
        symbol: symbol in the source.
        source: where the default comes from.
        assumed: True where the source does not give the value; `source` then says why this one.
        size: how many numbers it holds (1: a scalar; more: a list, as the knots of a curve).
        choices: where the value is one of these words (stored as its place in the list).
        searched: False where a search leaves it alone, because data hardly ever determine it (a
            reference pressure, a regularisation width).
        when: the choice and the words of it with which the parameter matters; nothing: always.
        role: of an effect's parameter, the only role in which it is there; "": in all.
        usual: a size that it usually has, where the default may be nothing; 0: not known.
        nonzero: whether 0 is not a value of it though it lies within the bounds (a gear's ratio).
        refines: of a choice, whether its words but the first only refine what is there: a search
            tries them once the effect is found.
        drawn: whether a drawing or a nameplate gives it: no effect of a machine changes it, but it
            may be declared wrongly.
        tolerance: share by which the part that was built may differ from its maker's sheet; 0: it
            is no such number.
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
    searched: bool = True
    when: tuple[str, tuple[str, ...]] = ("", ())
    role: str = ""
    usual: float = 0.0
    nonzero: bool = False
    refines: bool = False
    drawn: bool = False
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a default outside its bounds: a typing error in a plug-in."""
        if not (self.low <= self.default <= self.high) or math.isnan(self.default):
            raise ValueError(f"parameter {self.name}: {self.default} outside its bounds")
        if self.choices and not 0 <= self.default < len(self.choices):
            raise ValueError(f"parameter {self.name}: {self.default} is the place of no choice")

    def refusal(self, value: float, unit: str) -> str:
        """Return why a value (in `unit`) cannot be, or "" where it can."""
        if self.nonzero and value == 0.0:
            return f"{self.name} cannot be 0"
        if MOST < abs(value) < math.inf:
            return f"{f'{value:g} {unit}'.rstrip()} is beyond any machine: check its unit"
        if self.low <= value <= self.high:
            return ""
        return f"{f'{value:g} {unit}'.rstrip()} is outside {self.low:g} ... {self.high:g}"

    def encode(self, value: float | str) -> float:
        """Return the number that stands for a value in the parameter vector.

        Raises:
            ValueError: a word that is not among the choices.
        """
        if not isinstance(value, str):
            return float(value)
        if value not in self.choices:
            raise ValueError(f"{self.name} cannot be '{value}': {', '.join(self.choices)}")
        return float(self.choices.index(value))

    def decode(self, number: float) -> float | str:
        """Return the value as model.yaml says it: the word of a choice, or the number."""
        return self.choices[round(number)] if self.choices else float(number)


def choice(
    name: str,
    words: tuple[str, ...],
    source: str = "",
    *,
    default: str | None = None,
    of_role: str = "",
    refines: bool = False,
    when: tuple[str, tuple[str, ...]] = ("", ()),
) -> Parameter:
    """Return a parameter that is one of several words; the first is the default."""
    place = 0 if default is None else words.index(default)
    return Parameter(
        name,
        "",
        float(place),
        0.0,
        float(len(words) - 1),
        source=source,
        choices=words,
        when=when,
        role=of_role,
        refines=refines,
    )
