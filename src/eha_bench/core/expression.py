"""Plain arithmetic between channels, as text in a file: parsed and checked, never executed.

Python's own parser makes a tree of the text; only the nodes listed here are accepted, and they are
worked out one by one with NumPy.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.near_miss import suggest

_LONGEST = 500
DEEPEST = 50
"""Levels that an expression may nest."""

_TWO: dict[type[ast.operator], Callable[[FloatArray, FloatArray], FloatArray]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_ONE: dict[type[ast.unaryop], Callable[[FloatArray], FloatArray]] = {
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}
FUNCTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
}
"""Functions of one number that an expression may use."""


@dataclass(frozen=True)
class Expression:
    """Arithmetic between channels; `parse` makes and checks one.

    Attributes:
        text: as it is written.
    """

    text: str

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Return an expression of names, numbers, + - * / **, brackets and some functions.

        Raises:
            ValueError: it is none, holds anything else, or names no channel.
        """
        found = cls(text)
        if not found.names:
            raise ValueError(f"'{text}' names no channel")
        return found

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Channels that it needs, in the order in which they are named first."""
        names: dict[str, None] = {}
        _check(self.tree, names, 0)
        return tuple(names)

    @cached_property
    def tree(self) -> ast.expr:
        """Python's own tree of the text, not yet checked.

        Raises:
            ValueError: it is too long, or no expression.
        """
        if len(self.text) > _LONGEST:
            raise ValueError(f"an expression has at most {_LONGEST} characters")
        try:
            return ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise ValueError(f"'{self.text}' is not an arithmetic expression") from error

    def value(self, channels: Mapping[str, FloatArray]) -> FloatArray:
        """Return its value, (n,), NaN where it is not finite.

        Args:
            channels: name -> (n,), at least those in `names`.
        """
        with np.errstate(all="ignore"):
            value = _value(self.tree, channels)
        return np.where(np.isfinite(value), value, np.nan)


def _check(node: ast.AST, names: dict[str, None], depth: int) -> None:
    """Collect the names of a tree; refuse what is not arithmetic."""
    if depth > DEEPEST:
        raise ValueError("an expression is nested too deeply")
    children: list[ast.expr] = []
    match node:
        case ast.BinOp(left=left, op=two, right=right) if type(two) in _TWO:
            children = [left, right]
        case ast.UnaryOp(op=one, operand=operand) if type(one) in _ONE:
            children = [operand]
        case ast.Name(id=name):
            names[name] = None
        case ast.Constant(value=bool() | complex()):
            raise ValueError(f"'{ast.unparse(node)}' is not a number")
        case ast.Constant(value=int() | float()):
            pass
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]):
            if function not in FUNCTIONS:
                raise ValueError(f"unknown function '{function}'; {suggest(function, FUNCTIONS)}")
            children = [argument]
        case _:
            text = ast.unparse(node) if isinstance(node, ast.expr) else type(node).__name__
            raise ValueError(
                f"'{text}' is not plain arithmetic: channels, numbers, + - * / **, brackets and "
                f"{', '.join(FUNCTIONS)} of one number"
            )
    for child in children:
        _check(child, names, depth + 1)


def _value(node: ast.expr, channels: Mapping[str, FloatArray]) -> FloatArray:
    """Return the value of a tree that has been checked."""
    match node:
        case ast.BinOp(left=left, op=two, right=right):
            return _TWO[type(two)](_value(left, channels), _value(right, channels))
        case ast.UnaryOp(op=one, operand=operand):
            return _ONE[type(one)](_value(operand, channels))
        case ast.Name(id=name):
            return channels[name]
        case ast.Constant(value=int() | float() as number):
            return np.asarray(number, dtype=np.float64)
        case ast.Call(func=ast.Name(id=function), args=[argument]):
            return FUNCTIONS[function](_value(argument, channels))
        case _:  # refused before
            raise TypeError(type(node).__name__)
