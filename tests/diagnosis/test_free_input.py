"""A free input is told from another by what it leaves, and pays for all that it could imitate."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from eha_bench.diagnosis.fit.problem import Piece
from eha_bench.diagnosis.unknown.free_input import KNOTS, FreeInput

WINDOWS, TICKS, CHANNELS = 30, 100, 2
ROWS = WINDOWS * TICKS * CHANNELS
INSTANTS = np.linspace(0.0, 1.0, KNOTS)
TIME = np.linspace(0.0, 1.0, TICKS)
HATS = np.stack([np.interp(TIME, INSTANTS, unit) for unit in np.eye(KNOTS)], axis=-1)


def problem() -> SimpleNamespace:
    each = TICKS * CHANNELS
    ticks, channels = np.divmod(np.arange(each), CHANNELS)
    pieces = [Piece(k, slice(k * each, (k + 1) * each), ticks, channels) for k in range(WINDOWS)]
    return SimpleNamespace(pieces=pieces, soft=1.0)


def everywhere(one: np.ndarray) -> np.ndarray:
    """Stack a window's (TICKS, CHANNELS, m) response for all windows, (N, m)."""
    return np.tile(one.reshape(TICKS * CHANNELS, -1), (WINDOWS, 1))


# a sensor's error shows in its channel at once; a disturbance is integrated and reaches both
SENSOR = everywhere(np.stack([HATS, np.zeros_like(HATS)], axis=1))
ONCE = np.cumsum(HATS, axis=0)
BALANCE = everywhere(np.stack([ONCE / 20.0, np.cumsum(ONCE, axis=0) / 900.0], axis=1))
MATRIX = everywhere(np.stack([np.ones(TICKS), TIME], axis=1)[:, :, None])


def acting(influence: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The residual that an input of (WINDOWS, KNOTS) values leaves, noise included."""
    noise = np.random.default_rng(1).standard_normal(ROWS)
    shaped = influence.reshape(WINDOWS, -1, KNOTS)
    # measured less simulated: what acts and is not simulated has the other sign
    return noise - np.einsum("wrk,wk->wr", shaped, values).ravel()


def weighed(residual: np.ndarray) -> tuple[FreeInput, float]:
    found = FreeInput(problem(), residual, MATRIX)
    return found, found.nothing


@pytest.mark.parametrize("size", [0.7, 5.0])
def test_the_place_where_it_acts_has_most_support(size: float) -> None:
    values = size * np.random.default_rng(2).standard_normal((WINDOWS, KNOTS))
    for true, other in ((SENSOR, BALANCE), (BALANCE, SENSOR)):
        found, nothing = weighed(acting(true, values))
        own = found.support(true).log
        assert own > found.support(other).log + 20.0
        assert own > nothing + 20.0


def test_where_nothing_acts_nothing_is_supported() -> None:
    found, nothing = weighed(acting(SENSOR, np.zeros((WINDOWS, KNOTS))))
    for influence in (SENSOR, BALANCE):
        assert found.support(influence).log < nothing + 3.0


def test_what_a_parameter_can_do_supports_no_input() -> None:
    residual = acting(SENSOR, np.zeros((WINDOWS, KNOTS))) + 4.0 * MATRIX[:, 0]
    found, nothing = weighed(residual)
    assert found.support(BALANCE).log < nothing + 3.0


def test_freedom_that_is_not_needed_is_paid_for() -> None:
    values = np.random.default_rng(3).standard_normal((WINDOWS, KNOTS))
    found, _ = weighed(acting(BALANCE, values))
    both = found.support(np.hstack([BALANCE, SENSOR])).log
    assert found.support(BALANCE).log > both + 20.0


def test_an_input_that_follows_a_variable_is_supported_more_by_its_curve() -> None:
    values = np.random.default_rng(4).uniform(-1.0, 1.0, (WINDOWS, KNOTS))
    found, _ = weighed(acting(BALANCE, values**2))
    free = found.support(BALANCE)
    shaped = BALANCE.reshape(WINDOWS, -1, KNOTS)

    def curve(variable: np.ndarray) -> np.ndarray:
        knots = np.linspace(-1.0, 1.0, 6)
        hats = np.stack([np.interp(variable, knots, unit) for unit in np.eye(6)], axis=-1)
        return np.einsum("wrk,wkh->wrh", shaped, hats).reshape(ROWS, 6)

    other = np.random.default_rng(5).uniform(-1.0, 1.0, (WINDOWS, KNOTS))
    own = found.support_of_curve(BALANCE, curve(values), free)
    assert own.log > free.log + 20.0
    assert own.log > found.support_of_curve(BALANCE, curve(other), free).log + 20.0
    knots = np.linspace(-1.0, 1.0, 6)
    np.testing.assert_allclose(own.step[-6:], knots**2, atol=0.3)
    assert float(own.rest @ own.rest) < 1.05 * ROWS
