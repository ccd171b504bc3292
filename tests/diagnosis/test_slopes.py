"""Slopes of a residual by differences that the bounds leave room for."""

import numpy as np
import pytest

from eha_bench.diagnosis.fit.least_squares import Free, jacobian


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
