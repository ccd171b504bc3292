"""Expressions are plain arithmetic: they give NumPy's numbers, and nothing else gets through."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.expression import Expression

CHANNELS = {"a": np.array([1.0, -2.0, 0.0]), "b": np.array([4.0, 0.5, 0.0])}


def test_arithmetic_as_written():
    found = Expression.parse("-(a + 2*b)**2 / 4 - sign(a)*sqrt(abs(a))").value(CHANNELS)
    a, b = CHANNELS["a"], CHANNELS["b"]
    assert found == pytest.approx(-((a + 2 * b) ** 2) / 4 - np.sign(a) * np.sqrt(np.abs(a)))


def test_what_is_not_finite_is_missing():
    assert np.isnan(Expression.parse("a / b").value(CHANNELS)).tolist() == [False, False, True]
    assert np.isnan(Expression.parse("9**9**9**9 * a").value(CHANNELS)).all()


def test_names_in_their_order():
    assert Expression.parse("duty * supply + duty").names == ("duty", "supply")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("__import__('os').system('true')", "not plain arithmetic"),
        ("a.real", "not plain arithmetic"),
        ("a[0]", "not plain arithmetic"),
        ("[x for x in a]", "not plain arithmetic"),
        ("lambda: a", "not plain arithmetic"),
        ("a if b else a", "not plain arithmetic"),
        ("a and b", "not plain arithmetic"),
        ("a // b", "not plain arithmetic"),
        ("(a := b)", "not plain arithmetic"),
        ("abs(a, b)", "not plain arithmetic"),
        ("eval(a)", "unknown function 'eval'"),
        ("sgn(a)", "did you mean 'sign'"),
        ("True * a", "not a number"),
        ("2j * a", "not a number"),
        ("'x' * a", "not plain arithmetic"),
        ("a +", "not an arithmetic expression"),
        ("", "not an arithmetic expression"),
        ("1 + 2", "names no channel"),
        ("a" + " + a" * 300, "at most"),
        ("-" * 60 + "a", "too deep"),
        ("(" * 300 + "a" + ")" * 300, "at most"),
    ],
)
def test_anything_else_is_refused(text, says):
    with pytest.raises(ValueError, match=says):
        Expression.parse(text)


@given(st.text(max_size=40))
def test_no_text_does_anything_but_be_refused_or_give_numbers(text):
    try:
        found = Expression.parse(text)
    except ValueError:
        return
    value = found.value(dict.fromkeys(found.names, np.ones(2)))
    assert np.broadcast_to(value, (2,)).shape == (2,)
