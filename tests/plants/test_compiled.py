"""Functions that Numba compiles when they are first called."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from eha_bench.plants.compiled import njit


@njit()
def _product(a, b):
    return np.dot(a, b)


@njit()
def _covariance(a):
    return np.cov(a)


def test_linear_algebra_is_there_for_who_compiles_it() -> None:
    a = np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_allclose(_product(a, a), a @ a)
    np.testing.assert_allclose(_covariance(a), np.cov(a))


def test_a_simulation_does_without_scipys_linear_algebra() -> None:
    lines = (
        "import sys, numpy as np",
        "from eha_bench.plants.model import Model",
        "from eha_bench.plants.plant import Drive",
        "bare, t = Model('eha_knee'), np.arange(11) / 1000",
        "drive = Drive(t, {'current_command': np.zeros(11)})",
        "bare.plant.simulate(bare.vector(), drive, 1e-4)",
        "print('numba' in sys.modules, 'scipy.linalg' in sys.modules)",
    )
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "False"]
