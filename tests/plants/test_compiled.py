"""Functions that Numba compiles when they are first called."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import TypingError

from eha_bench.plants import inner_function
from eha_bench.plants.compiled import njit
from eha_bench.plants.network import compiler
from eha_bench.plants.pointer import behind, pointer


@njit()
def _product(a, b):
    return np.dot(a, b)


@njit()
def _covariance(a):
    return np.cov(a)


@pytest.mark.slow  # compiles
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


@njit()
def _root(x):
    if x < 0.0:
        raise ValueError("no root")
    return math.sqrt(x)


@njit()
def _hypotenuse(a, b):
    return _root(a * a + b * b)


@njit()
def _side(c, a):
    return _root(c * c - a * a)


def test_compiled_code_calls_what_has_no_way_in_from_python() -> None:
    inner = _root._inner
    assert _hypotenuse(3.0, 4.0) == 5.0
    assert _side(5.0, 3.0) == 4.0
    (found,) = inner.overloads.values()  # compiled once, for both that call it
    assert isinstance(found.library, inner_function._InnerLibrary)
    machine_code = found.library.codegen._engine._defined_symbols
    assert found.fndesc.llvm_cpython_wrapper_name not in machine_code


def test_an_error_inside_reaches_python() -> None:
    with pytest.raises(ValueError, match="no root"):
        _side(3.0, 5.0)


def test_a_function_can_be_called_from_both_sides() -> None:
    assert _root(2.0) == math.sqrt(2.0)
    assert _hypotenuse(1.0, 1.0) == math.sqrt(2.0)


def test_a_numba_that_links_in_another_way_compiles_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inner_function, "_FITS", False)

    @njit()
    def half(x):
        return 0.5 * x

    @njit()
    def quarter(x):
        return half(half(x))

    assert quarter(3.0) == 0.75
    (found,) = half._inner.overloads.values()
    assert not isinstance(found.library, inner_function._InnerLibrary)


def test_a_pointer_reads_and_writes_the_vector_itself() -> None:
    @njit()
    def move(vector, place):
        start = pointer(vector)
        start[0] = behind(start, place)[0]
        return start[place]

    vector = np.array([1.0, 2.0, 3.0])
    assert move(vector, 2) == 3.0
    assert list(vector) == [3.0, 2.0, 3.0]


def test_a_pointer_stands_for_contiguous_vectors_only() -> None:
    @njit()
    def first(vector):
        return pointer(vector)[0]

    for wrong in (np.zeros(6)[::2], np.zeros((2, 2)), 1.0):
        with pytest.raises(TypingError, match="contiguous vector"):
            first(wrong)


def test_a_kernel_that_fails_to_load_fails_the_same_way_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EHA_BENCH_CACHE", str(tmp_path))
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            compiler.compiled_kernel("broken", "simulate = 1 / 0\n", [], "simulate")
    assert not [name for name in sys.modules if name.startswith("eha_bench_kernel_broken")]


def test_a_kernel_that_was_torn_on_the_disk_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EHA_BENCH_CACHE", str(tmp_path))
    text = "raise LookupError('whole')\n"
    with pytest.raises(LookupError):
        compiler.compiled_kernel("torn", text, [], "simulate")
    (kept,) = tmp_path.glob("*.py")
    kept.write_text(text[:7])
    with pytest.raises(LookupError, match="whole"):
        compiler.compiled_kernel("torn", text, [], "simulate")
