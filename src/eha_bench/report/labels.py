"""Find places for the labels of a plot, so that none lies over another."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

CHARACTER_WIDTH: Final = 0.56
"""Mean width of a character as a share of the font size."""
LINE_HEIGHT: Final = 1.25


@dataclass(frozen=True)
class Box:
    """A rectangle in points; y grows upwards."""

    left: float
    bottom: float
    right: float
    top: float

    def meets(self, other: Box) -> bool:
        """Whether the two overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.bottom < other.top
            and other.bottom < self.top
        )


@dataclass
class LabelPlacer:
    """Gives each label the free place nearest to the one it asks for, above or below it.

    Attributes:
        area: where labels may lie, in points.
        font_size: in points.
    """

    area: Box
    font_size: float
    _taken: list[Box] = field(default_factory=list)

    def place(self, text: str, x: float, y: float, *, align: str = "left") -> tuple[float, float]:
        """Return the (left, bottom) of a text in points whose wished anchor is (x, y).

        `align` says whether x is the text's left or right end.
        """
        width = CHARACTER_WIDTH * self.font_size * len(text)
        height = LINE_HEIGHT * self.font_size
        left = x if align == "left" else x - width
        left = min(max(left, self.area.left), max(self.area.left, self.area.right - width))
        wished = min(max(y, self.area.bottom), max(self.area.bottom, self.area.top - height))
        for step in self._steps(height):
            bottom = wished + step
            box = Box(left, bottom, left + width, bottom + height)
            inside = self.area.bottom <= bottom and box.top <= self.area.top + 0.5
            if inside and not any(box.meets(other) for other in self._taken):
                self._taken.append(box)
                return left, bottom
        return left, wished

    def _steps(self, height: float) -> list[float]:
        rows = int((self.area.top - self.area.bottom) / height) + 1
        steps = [0.0]
        for row in range(1, 2 * rows + 1):
            steps += [row * height / 2.0, -row * height / 2.0]
        return steps
