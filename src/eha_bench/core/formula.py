"""Arithmetic over metrics and statistics of channels, as text in a suite; never executed.

`mean(abs(pressure_a - pressure_b)) / response_time` names a statistic of channels, sample by
sample, and a metric; `peak(pressure_a)` is a metric on another channel than its own.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from eha_bench.core.expression import DEEPEST, FUNCTIONS, Expression
from eha_bench.core.metric import STATISTICS


@dataclass(frozen=True)
class Statistic:
    """A statistic of an expression of channels, e.g. `mean(abs(current))`."""

    name: str
    of: Expression

    def __str__(self) -> str:
        """Return it as a formula writes it."""
        return f"{self.name}({self.of.text})"


@dataclass(frozen=True)
class MetricInput:
    """A metric; `channel` is "" for the one that it is scored on by default."""

    metric: str
    channel: str = ""

    def __str__(self) -> str:
        """Return it as a formula writes it."""
        return f"{self.metric}({self.channel})" if self.channel else self.metric


Input: TypeAlias = Statistic | MetricInput


@dataclass(frozen=True)
class Formula:
    """A formula; `parse` makes and checks one.

    Attributes:
        text: as it is written.
        inputs: what it needs, by the name that stands for it in `arithmetic`.
    """

    text: str
    inputs: Mapping[str, Input] = field(compare=False)
    arithmetic: Expression = field(compare=False)

    @classmethod
    def parse(cls, text: str) -> Formula:
        """Return a formula of metrics, statistics of channels, numbers, + - * / ** and brackets.

        Raises:
            ValueError: it is none, holds anything else, or names nothing that was measured.
        """
        reader = _NameReader()
        rest = Expression(ast.unparse(reader.read(Expression(text).tree, 0)))
        if not rest.names:
            raise ValueError(f"'{text}' names neither a metric nor a channel")
        return cls(text, {name: reader.found[name] for name in rest.names}, rest)

    @property
    def metrics(self) -> frozenset[str]:
        """Ids of the metrics that it needs."""
        parts = self.inputs.values()
        return frozenset(part.metric for part in parts if isinstance(part, MetricInput))

    def value(self, inputs: Mapping[str, float]) -> float:
        """Return its value by the values of `inputs`; NaN where it is not finite."""
        arrays = {name: np.asarray(value, np.float64) for name, value in inputs.items()}
        return float(self.arithmetic.value(arrays))


class _NameReader:
    """Puts names in place of the metrics and statistics of a tree, and keeps what they mean."""

    def __init__(self) -> None:
        self.found: dict[str, Input] = {}

    def read(self, node: ast.expr, depth: int) -> ast.expr:
        """Return the tree with names in place of what is measured.

        Raises:
            ValueError: a statistic of something else than channels, a metric on anything but one.
        """
        if depth > DEEPEST:
            raise ValueError("an expression is nested too deeply")
        match node:
            case ast.BinOp(left=left, op=two, right=right):
                return ast.BinOp(self.read(left, depth + 1), two, self.read(right, depth + 1))
            case ast.UnaryOp(op=one, operand=operand):
                return ast.UnaryOp(one, self.read(operand, depth + 1))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                return self._call(name, argument, node, depth)
            case ast.Name(id=name):
                return self._name_of(MetricInput(name))
        _text(node, depth)
        return node  # a number, or what the check of the arithmetic refuses

    def _call(self, name: str, argument: ast.expr, node: ast.expr, depth: int) -> ast.expr:
        if name in FUNCTIONS:
            inner = self.read(argument, depth + 1)
            return ast.Call(ast.Name(name, ast.Load()), [inner], [])
        if name in STATISTICS:
            return self._name_of(Statistic(name, Expression.parse(_text(argument, depth))))
        if isinstance(argument, ast.Name):
            return self._name_of(MetricInput(name, argument.id))
        raise ValueError(
            f"'{_text(node, depth)}' is neither a statistic ({', '.join(STATISTICS)}) of channels "
            "nor a metric of one channel"
        )

    def _name_of(self, found: Input) -> ast.expr:
        for name, known in self.found.items():
            if known == found:
                return ast.Name(name, ast.Load())
        name = f"input_{len(self.found)}"
        self.found[name] = found
        return ast.Name(name, ast.Load())


def _text(node: ast.expr, depth: int) -> str:
    """Return a tree as text; the depth is looked at first, as deep ones cannot be written.

    Raises:
        ValueError: it nests too deep.
    """
    level: list[ast.AST] = [node]
    while level:
        if depth > 2 * DEEPEST:
            raise ValueError("an expression is nested too deeply")
        level = [child for one in level for child in ast.iter_child_nodes(one)]
        depth += 1
    return ast.unparse(node)
