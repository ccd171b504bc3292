"""Find places for the labels of a plot, so that none lies over another or over a curve."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray

CHARACTER_WIDTH: Final = 0.56
"""Mean width of a character as a share of the font size."""
LINE_HEIGHT: Final = 1.25
_GAP: Final = 6.0
_NEAR: Final = 6  # of the places that are tried, in their order


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

    def inside(self, other: Box) -> bool:
        """Whether this lies within the other, to within half a point."""
        return (
            self.left >= other.left - 0.5
            and self.right <= other.right + 0.5
            and self.bottom >= other.bottom - 0.5
            and self.top <= other.top + 0.5
        )


@dataclass
class LabelPlacer:
    """Gives each label a free place near to what it names.

    Attributes:
        area: where labels may lie, in points.
        font_size: in points.
        curves: (n, 2) points of curves that a label had better not cover.
    """

    area: Box
    font_size: float
    curves: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    _taken: list[Box] = field(default_factory=list)

    def beside(self, text: str, x: float, y: float) -> Box:
        """Return a place for the label of a point: right or left of it, below or above."""
        width, height = self._size(text)
        near = [
            (x + _GAP, y - height - 2.0),
            (x + _GAP, y + 2.0),
            (x - _GAP - width, y + 2.0),
            (x - _GAP - width, y - height - 2.0),
        ]
        return self._take([*near, *self._rows(x + _GAP, y, height)], width, height)

    def along(self, text: str, x: float, y: float, *, align: str) -> Box:
        """Return a place for the label of a line: its end at x, just above or below y."""
        width, height = self._size(text)
        left = x if align == "left" else x - width
        left = min(max(left, self.area.left), max(self.area.left, self.area.right - width))
        return self._take(
            [(left, y), (left, y - height - 2.0), *self._rows(left, y, height)], width, height
        )

    def _size(self, text: str) -> tuple[float, float]:
        return CHARACTER_WIDTH * self.font_size * len(text), LINE_HEIGHT * self.font_size

    def _rows(self, left: float, y: float, height: float) -> Iterator[tuple[float, float]]:
        rows = int((self.area.top - self.area.bottom) / height) + 1
        for row in range(1, 2 * rows + 1):
            yield left, y + row * height / 2.0
            yield left, y - row * height / 2.0

    def _take(self, places: list[tuple[float, float]], width: float, height: float) -> Box:
        boxes = [Box(left, low, left + width, low + height) for left, low in places]
        free = [
            box
            for box in boxes
            if box.inside(self.area) and not any(box.meets(other) for other in self._taken)
        ]
        # Further off a label would seem to name something else: rather over a curve than far away.
        near = [box for box in free if any(box is other for other in boxes[:_NEAR])]
        chosen = next((box for box in near if not self._covers(box)), (free or boxes)[0])
        self._taken.append(chosen)
        return chosen

    def _covers(self, box: Box) -> bool:
        x, y = self.curves[:, 0], self.curves[:, 1]
        within = (x >= box.left) & (x <= box.right) & (y >= box.bottom) & (y <= box.top)
        return bool(np.any(within))
