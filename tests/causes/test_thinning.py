"""The oil as the machine shows it: viscous friction and leakage move by one factor of the night."""

import math

import numpy as np
import pytest

from eha_bench.causes.cause import Cause
from eha_bench.causes.estimates import Estimates, estimates
from eha_bench.causes.evidence import NightEvidence, RunEvidence
from eha_bench.causes.thinning import exponents_of, thinning_of

NAMES = ("coulomb", "viscous", "rod_viscous", "leakage", "offset")
UNITS = ("N*m", "N*m*s/rad", "N*s/m", "m^3/(s*Pa)", "Pa")
CALIBRATED = 4
SIZES = np.array([10.0, 10.0, 10.0, 10.0, 0.0])
KNOWN = np.array([100.0, 200.0, 20.0, 300.0, 100.0])
"""Inverse standard deviation of each by a night, in steps."""


def causes() -> tuple[Cause, ...]:
    return tuple(
        Cause(name, "", name, k, (), -math.inf, math.inf, 1.0, unit, is_calibrated=k < CALIBRATED)
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
    )


def season(nights: int, rng: np.random.Generator, growth: float = 0.0) -> list[NightEvidence]:
    """A viscosity that swings by 10 % in 40 nights; leakage grows from the 21st on."""
    normal = np.diag(KNOWN**2)
    found = []
    for night in range(nights):
        factor = 0.1 * math.sin(2.0 * math.pi * night / 40.0) + 0.02 * rng.normal()
        true = factor * np.array([0.0, 10.0, 6.0, -11.0, 0.0]) + 0.03 * rng.normal(size=5)
        true[3] += growth * max(0, night - 20)
        slope = normal @ true + KNOWN * rng.normal(size=5)
        found.append(NightEvidence(NAMES, (RunEvidence("a-0", slope, normal),), {}, 1.0, 1))
    return found


def seen(nights: list[NightEvidence]) -> Estimates:
    return estimates(nights, causes(), SIZES, 12)


def test_units_say_what_goes_with_the_viscosity() -> None:
    assert exponents_of(causes()).tolist() == [0.0, 1.0, 1.0, -1.0, 0.0]


def test_a_season_of_the_oil_is_no_leak() -> None:
    found = seen(season(40, np.random.default_rng(1)))
    apart = found.changes[12:, 3] / found.deviations[12:, 3]
    assert np.sqrt(np.mean(apart**2)) < 2.0
    assert np.ptp(found.changes[12:, 3]) < 0.5  # the season alone moves leakage by 2 steps


def test_a_leak_in_a_season_is_seen() -> None:
    found = seen(season(40, np.random.default_rng(2), growth=0.15))
    gains = found.gains[30:].sum(axis=0)
    assert found.changes[-1, 3] == pytest.approx(0.15 * 19, rel=0.2)
    assert NAMES[int(np.argmax(gains))] == "leakage"


def test_loadings_are_learned() -> None:
    rng = np.random.default_rng(3)
    factor = 0.05 * rng.normal(size=20)
    true = np.array([0.0, 10.0, 4.0, -13.0])
    nights = np.outer(factor, true) + rng.normal(size=(20, 4)) / KNOWN[:4]
    noise = np.tile(KNOWN[:4] ** -2.0, (20, 1))
    found = thinning_of(nights, noise, np.array([0.0, 1.0, 1.0, -1.0]), SIZES[:4])
    # the factor's own scale is nobody's: viscous friction by definition goes with it
    assert found.loadings / found.loadings[1] == pytest.approx(true / 10.0, abs=0.15)
    assert found.doubt[3] < 1.0


def test_nothing_viscous_no_factor() -> None:
    nights = np.random.default_rng(4).normal(size=(10, 2))
    found = thinning_of(nights, np.ones((10, 2)), np.zeros(2), np.ones(2))
    assert not found.covariance.any()
    assert not found.on(nights).any()
