"""Slopes of a residual by differences that the bounds leave room for."""

from pathlib import Path

import numpy as np
import pytest

from eha_bench.diagnosis.fit.least_squares import Free, free_parameters, jacobian
from eha_bench.plants.model import load_model

EXAMPLES = Path(__file__).parents[2] / "examples" / "foreign_plants"


class Line:
    """A residual that is a multiple of its one parameter; nothing else of a problem is asked."""

    soft = 1.0
    step = 1.0

    def residual(self, vector):
        return 1e-3 * vector[0] * np.ones(4)


@pytest.mark.parametrize(
    ("value", "low", "high", "scale"),
    [
        (1.0, 1.0, 20.0, 20.0),  # less room than the largest difference, and none below
        (20.0, 1.0, 20.0, 20.0),
        (19.0, 1.0, 20.0, 1.0),
        (0.0, -np.inf, np.inf, 1.0),
    ],
)
def test_a_slope_is_right_wherever_the_value_stands(value, low, high, scale) -> None:
    free = Free("p", 0, low, high, scale, of_effect=True)
    problem = Line()
    vector = np.array([value])
    found = jacobian(problem, vector, [free], problem.residual(vector))
    assert np.allclose(found[:, 0], 1e-3 * scale)


def test_a_value_without_any_room_has_no_slope() -> None:
    problem, vector = Line(), np.array([2.0])
    found = jacobian(problem, vector, [Free("p", 0, 2.0, 2.0, 1.0)], problem.residual(vector))
    assert np.array_equal(found, np.zeros((4, 1)))


class Leak(Line):
    """A residual that a conductance of 1e-12 fills, and that no larger one moves any further."""

    def residual(self, vector):
        return 1e4 * np.tanh(1e12 * vector[0]) * np.ones(400)


def test_a_slope_of_what_is_declared_as_nothing_does_not_hang_on_a_guessed_scale() -> None:
    problem, vector = Leak(), np.array([0.0])
    found = jacobian(problem, vector, [Free("leak", 0, 0.0, np.inf, 1.0)], problem.residual(vector))
    assert np.allclose(found[:, 0], 1e16, rtol=0.2)


class Cliff(Line):
    """A residual that hardly moves, and from some value on runs away."""

    def residual(self, vector):
        return np.full(4, 1e9 if vector[0] > 1e-6 else 1e-3 * vector[0])


def test_a_slope_ends_where_no_difference_is_between_nothing_and_absurd() -> None:
    problem, vector = Cliff(), np.array([0.0])
    found = jacobian(problem, vector, [Free("phase", 0, 0.0, 1.0, 1.0)], problem.residual(vector))
    assert np.allclose(found[:, 0], 1e-3)


def test_the_scale_of_what_is_declared_as_nothing_is_what_its_kind_usually_has(tmp_path) -> None:
    text = (EXAMPLES / "G" / "plant.yaml").read_text(encoding="utf-8")
    leak, belief = "conductance: 1e-12 m^3/(s*Pa)", "piston_leakage.conductance, within: 10 %"
    assert leak in text
    assert belief in text
    text = text.replace(leak, "conductance: 0").replace(belief, "piston_leakage.conductance")
    (tmp_path / "plant.yaml").write_text(text, encoding="utf-8")
    model = load_model(tmp_path / "plant.yaml")
    key = "piston_leakage.conductance"
    [free] = free_parameters(model.plant.layout, [key], model.vector())
    assert model.value(key) == 0.0
    assert 1e-15 < free.scale < 1e-11
