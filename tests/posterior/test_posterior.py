"""Draws of a posterior: their covariance, also where variances are decades apart."""

import numpy as np

from eha_bench.plants.model import Model, load_model
from eha_bench.posterior.posterior import Component, Posterior


def knee() -> Model:
    return load_model("physical")


def test_draws_keep_a_small_variance_beside_a_large_one() -> None:
    # a leakage in m^3/(s*Pa) and a load in N: variances 36 decades apart
    model = knee()
    keys = ("leakage", "external_force")
    deviations = np.array([0.01 * model.value("leakage"), 30.0])
    correlation = np.array([[1.0, 0.8], [0.8, 1.0]])
    component = Component("made up", model, keys, correlation * np.outer(deviations, deviations))
    drawn = np.array([list(draw.values.values()) for draw in Posterior((component,)).draws(600, 1)])
    assert np.allclose(drawn.std(axis=0), deviations, rtol=0.1)
    assert abs(np.corrcoef(drawn.T)[0, 1] - 0.8) < 0.06
    assert np.all(np.abs(drawn[:, 0] / model.value("leakage") - 1.0) < 0.06)


def test_what_is_known_exactly_is_not_moved() -> None:
    model = knee()
    covariance = np.diag([0.0, 1.0])
    component = Component("made up", model, ("leakage", "external_force"), covariance)
    drawn = [draw.values["leakage"] for draw in Posterior((component,)).draws(5, 1)]
    assert drawn == [model.value("leakage")] * 5
