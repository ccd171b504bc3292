"""A model's posterior: what was fitted, with its covariance, and draws of models from it.

Where the data cannot tell two explanations apart, each is a component, and draws come from all of
them in turn. What differs from run to run (`per_run`) is drawn from the runs that were recorded.
The covariance holds correlated residuals and runs that disagree (`diagnosis.fit.uncertainty`). What
no equation of the model explains beyond that is a slow error of each channel, as large as the
residual beyond the noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.model import Model
from eha_bench.plants.values import with_values
from eha_bench.posterior.covered import Covered

_TRIES = 50
"""How often a draw outside of its bounds is drawn again before it is put at the bound."""


@dataclass(frozen=True)
class Component:
    """One explanation of the data.

    Attributes:
        id: its name. model: as fitted. keys: of what was fitted, `name[k]` for the k-th of a list.
        covariance: (p, p) SI.
    """

    id: str
    model: Model
    keys: tuple[str, ...]
    covariance: FloatArray

    @property
    def fitted_values(self) -> FloatArray:
        """What was fitted, (p,) SI."""
        vector = self.model.vector()
        return np.array([vector[place] for place in self._places], dtype=np.float64)

    @property
    def _places(self) -> list[int]:
        index = self.model.plant.layout.index
        found = []
        for key in self.keys:
            name, _, number = key.partition("[")
            found.append(index[name] + (int(number[:-1]) if number else 0))
        return found

    def draw(self, generator: np.random.Generator) -> FloatArray:
        """Return one draw of what was fitted, (p,) SI, within the bounds of each."""
        low, high = self._bounds()
        root = root_of(self.covariance)
        centre = self.fitted_values
        for _ in range(_TRIES):
            found = centre + root @ generator.standard_normal(len(self.keys))
            if np.all((found >= low) & (found <= high)):
                return np.asarray(found)
        return np.asarray(np.clip(found, low, high))

    def one_deviation_off(self) -> list[Model]:
        """Return models one standard deviation off along independent directions, within bounds."""
        low, high = self._bounds()
        off = self.fitted_values[:, None] + root_of(self.covariance)
        return [self.at(np.clip(values, low, high)) for values in off.T]

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of what was fitted, two (p,) SI."""
        known = self.model.plant.layout.by_key
        own = [known[key.partition("[")[0]] for key in self.keys]
        return np.array([item.low for item in own]), np.array([item.high for item in own])

    def at(self, values: FloatArray) -> Model:
        """Return the model with other values of what was fitted, (p,) SI."""
        model, curves = self.model, dict[str, list[float]]()
        for key, value in zip(self.keys, values, strict=True):
            name, _, number = key.partition("[")
            if not number:
                model = with_values(model, {name: float(value)})
                continue
            effect, _, parameter = name.rpartition(".")
            if name not in curves:
                declared = next(item for item in self.model.effects if item.id == effect)
                given = declared.values[parameter]
                assert isinstance(given, list)
                curves[name] = [*given]
            curves[name][int(number[:-1])] = float(value)
        for name, curve in curves.items():
            effect, _, parameter = name.rpartition(".")
            model = model.with_values(effect, {parameter: curve})
        return model


def root_of(covariance: FloatArray) -> FloatArray:
    """Return a matrix R with R R' the covariance, (p, p).

    It is taken of the correlations: variances in SI are up to 40 decades apart (a leakage next to a
    force), and the rounding of the largest would be more than all of the smallest.
    """
    deviations = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True)
class Draw:
    """One machine that the recordings may have come from.

    Attributes:
        number: from 0. model: all of it. values: what was drawn, SI, by key. component: its id.
    """

    number: int
    model: Model
    values: Mapping[str, float]
    component: str


@dataclass(frozen=True)
class Posterior:
    """What recordings left unknown of a machine.

    Attributes:
        components: explanations that the data cannot distinguish, what was found first.
        per_run: what differs from run to run, by recorded run, SI.
        covered: where those recordings have been; None where the file does not say.
        notes: what draws leave out, one sentence each. source: the file.
    """

    components: tuple[Component, ...]
    per_run: tuple[Mapping[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    source: str = ""
    covered: Covered | None = None

    @property
    def remainder(self) -> dict[str, float]:
        """Channel -> root mean square of what was left unexplained beyond the noise, SI."""
        left = self.covered.unexplained if self.covered is not None else {}
        return {name: value for name, value in left.items() if value}

    def draws(self, count: int, seed: int) -> tuple[Draw, ...]:
        """Return draws; the same seed gives the same, and more of them begin with the fewer."""
        return tuple(self._draw(number, seed) for number in range(count))

    def _draw(self, number: int, seed: int) -> Draw:
        generator = np.random.default_rng([seed, number])
        component = self.components[number % len(self.components)]
        drawn = component.draw(generator)
        values = dict(zip(component.keys, drawn.tolist(), strict=True))
        model = component.at(drawn)
        if self.per_run:
            own = self.per_run[int(generator.integers(len(self.per_run)))]
            model = with_values(model, own)
            values |= own
        return Draw(number, model, values, component.id)
