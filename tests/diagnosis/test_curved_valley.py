"""A fit along a valley in which all parameters can nearly be scaled together."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.diagnosis.fit.convergence import convergence, determined_directions
from eha_bench.diagnosis.fit.finish import to_the_bottom
from eha_bench.diagnosis.fit.least_squares import Fit, Free, jacobian, levenberg_marquardt

DRIVE = np.sin(np.linspace(0.0, 9.0, 400))
BELIEVED = {"torque_constant": (0.10, 0.004), "mass": (2.4, 0.07), "length": (0.28, 0.008)}
TRUE = {"torque_constant": 0.097, "mass": 2.45, "length": 0.28}
NOISE = 1e-4


class _Joint:
    """Reads K_T u / (m l + c) with much less noise than the parameters are believed to."""

    step, soft, beliefs, size = 1e-3, 100.0, (), 400

    def at_step(self, step: float) -> _Joint:
        del step
        return self

    def residual(self, vector: np.ndarray) -> np.ndarray:
        read = self._read(*vector) - self._read(*TRUE.values())
        noise = np.random.default_rng(4).standard_normal(DRIVE.size)
        middle, width = np.array(list(BELIEVED.values())).T
        return np.append(read / NOISE + noise, (vector - middle) / width)

    @staticmethod
    def _read(torque_constant: float, mass: float, length: float) -> np.ndarray:
        return torque_constant / (mass * length + 0.011) * DRIVE


def _fit(problem: _Joint, vector: np.ndarray) -> Fit:
    free = tuple(Free(key, k, 1e-3, 10.0, float(vector[k])) for k, key in enumerate(BELIEVED))
    return levenberg_marquardt(problem, vector, free, iterations=8, tolerance=1e-9, share=0.0)


def test_what_is_believed_tells_the_scale_that_the_data_do_not() -> None:
    problem = _Joint()
    # all are 8 % too large: the data hardly mind
    far = 1.08 * np.array(list(TRUE.values()))
    far[1] /= 1.08
    fit = _fit(problem, far)
    done = to_the_bottom(problem, fit)
    base = problem.residual(done.vector)
    there = Fit(done.vector, fit.free, base, jacobian(problem, done.vector, fit.free, base),
                float(base @ base), 0, problem.soft, 3)  # fmt: skip
    assert convergence(there).distance < 0.5
    assert done.cost <= fit.cost
    for value, (middle, width) in zip(done.vector, BELIEVED.values(), strict=True):
        assert value == pytest.approx(middle, abs=2.0 * width)


def test_a_fit_at_its_bottom_stays_there() -> None:
    problem = _Joint()
    once = to_the_bottom(problem, _fit(problem, np.array([0.1, 2.4, 0.28])))
    again = to_the_bottom(problem, once)
    np.testing.assert_allclose(again.vector, once.vector, rtol=1e-3)


def test_what_is_hardly_believed_still_has_a_minimum() -> None:
    # a torque constant over a mass, each known to half of itself: only beliefs tell their scale
    drive = 30.0 * DRIVE
    data = np.column_stack([drive, -drive])
    believed = np.diag([2.0, 2.0])
    away = np.append(np.zeros(DRIVE.size), [1.2, 1.2])
    free = tuple(Free(key, k, 1e-3, 10.0, 1.0) for k, key in enumerate(("constant", "mass")))
    fit = Fit(np.ones(2), free, away, np.vstack([data, believed]), 2.88, 0, 100.0, 2)
    found = determined_directions(fit)
    assert found.information[0] == pytest.approx(4.0, rel=1e-4)
    # each is 1.2 standard deviations of what is believed away
    assert convergence(fit).distance == pytest.approx(np.hypot(1.2, 1.2), rel=1e-3)
    # what nobody believes anything of has no minimum there
    alone = Fit(np.ones(2), free, away[:-2], data, 0.0, 0, 100.0, 0)
    assert determined_directions(alone).information.size == 1
