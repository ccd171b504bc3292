"""What a user declared and nobody fits, and that may be off by a factor: numbers, and scales.

A number of a drawing (a piston's area, a gear's ratio) is read off a sheet, the scale of a channel
off an amplifier. Each is one factor, which everything that is calibrated makes up for as well as it
can (`doubtful_numbers`). Factors so close to 1 that no maker promises as much, and no reading shows
them, are no doubt: many readings together ask for some such factor of every healthy machine, as no
law is right to a thousandth.

Source: ISO 4409:2007, annex on measurement accuracy (permissible systematic errors, class A).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.data.windows import runs_of, window_at
from eha_bench.diagnosis.fit.candidates import pairs_alike
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.layout import Layout


class Doubt(Protocol):
    """Something declared that may be off by a factor."""

    def times(
        self, problem: Problem, vector: FloatArray, factor: float
    ) -> tuple[Problem, FloatArray]:
        """Return a problem, prepared, and parameters, with it so many times what was declared."""
        ...

    def is_material(self, problem: Problem, factor: float, least: float) -> bool:
        """Whether a factor is so far from 1 that what was declared may be doubted for it.

        Args:
            problem: with what is declared. factor: of it. least: part that it is off by at least.
        """
        ...

    def said(self, factor: float) -> str:
        """Say what is declared, and what would be right, as a clause."""
        ...


@dataclass(frozen=True)
class DrawnNumber:
    """A number of a drawing that nobody calibrates.

    Attributes:
        names: of the parameters that are this number. places: in the vector.
        declared: SI. unit: of it.
    """

    names: tuple[str, ...]
    places: tuple[int, ...]
    declared: float
    unit: str

    def times(
        self, problem: Problem, vector: FloatArray, factor: float
    ) -> tuple[Problem, FloatArray]:
        """Return the problem as it is, and parameters with another number."""
        moved = vector.copy()
        moved[list(self.places)] = factor * self.declared
        return problem, moved

    def is_material(self, problem: Problem, factor: float, least: float) -> bool:
        """Whether it is off by more than a drawing may be."""
        del problem
        return abs(math.log(factor)) >= least

    def said(self, factor: float) -> str:
        """Say the number as it is declared, and as it would be right."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"{' and '.join(self.names)} of {factor * self.declared:.4g}{unit}, declared as "
            f"{self.declared:.4g} and not calibrated"
        )


@dataclass(frozen=True)
class ChannelScale:
    """The scale of a channel's readings."""

    channel: str

    def times(
        self, problem: Problem, vector: FloatArray, factor: float
    ) -> tuple[Problem, FloatArray]:
        """Return the problem with other readings, their noise in proportion, and the parameters."""
        noise = {**problem.noise, self.channel: factor * problem.noise[self.channel]}
        runs = {id(window.measured): window.measured for window in problem.windows}
        read = {key: self._scaled(item, factor) for key, item in runs.items()}
        windows = [
            replace(
                window_at(read[id(window.measured)], window.first, window.last, noise),
                carried=window.carried,
            )
            for window in problem.windows
        ]
        other = Problem(
            problem.plant, windows, noise, problem.step, problem.beliefs, problem.stretch
        )
        other.soft = problem.soft
        other.prepare(vector)
        return other, vector

    def is_material(self, problem: Problem, factor: float, least: float) -> bool:
        """Whether it is off by more than a sensor may be, and one reading could show it."""
        if abs(math.log(factor)) < least:
            return False
        columns = (run.column(self.channel) for run in runs_of(problem.windows))
        largest = max(
            (float(np.nanmax(np.abs(column))) for column in columns if column is not None),
            default=0.0,
        )
        return abs(factor - 1.0) * largest >= problem.noise[self.channel]

    def said(self, factor: float) -> str:
        """Say what the channel reads of what there is."""
        return f"'{self.channel}' that reads {1.0 / factor:.4g} times what there is"

    def _scaled(self, measured: Measured, factor: float) -> Measured:
        if self.channel not in measured.outputs:
            return measured
        values = measured.values.copy()
        values[:, measured.outputs.index(self.channel)] *= factor
        return replace(measured, values=values)


def doubts_of(problem: Problem, vector: FloatArray, calibrated: tuple[str, ...]) -> list[Doubt]:
    """Return what is declared of a plant and its log, nobody calibrates, and may be off.

    Args:
        problem: with the channels that are compared. vector: its parameters.
        calibrated: keys of parameters.
    """
    layout = problem.plant.layout
    return [*_numbers(layout, vector, calibrated), *map(ChannelScale, sorted(problem.noise))]


def _numbers(
    layout: Layout, vector: FloatArray, calibrated: tuple[str, ...]
) -> Iterator[DrawnNumber]:
    """Yield numbers of a drawing; areas that are declared the same are one."""
    drawn = [item.name for item in layout.parameters if item.drawn and item.name not in calibrated]
    alike = pairs_alike(layout, vector)
    pairs = [pair for pair in alike if set(pair) <= set(drawn)]
    paired = {name for pair in alike for name in pair}
    for pair in (*pairs, *((name,) for name in drawn if name not in paired)):
        names = tuple(dict.fromkeys(pair))
        places = tuple(layout.index[name] for name in names)
        declared = float(vector[places[0]])
        if declared:
            yield DrawnNumber(names, places, declared, layout.by_key[names[0]].unit)
