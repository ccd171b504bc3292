"""Where a series changed: steps and drifts, found together and each tested.

Forward selection over steps, kinks (where a drift begins or ends) and pairs of them (a passing
change of level, a drift that ends: neither edge explains them alone), every term's place then
searched again with the others held, and terms removed that are not significant. The level of a
test is shared between all places at which one was looked for (Bonferroni), so that a flat history
has a false change with a probability of at most `alpha`.

Looked at first: ruptures (Truong, Oudre and Vayatis 2020, doi:10.1016/j.sigpro.2019.107299). Its
compiled costs find steps only, its cost for joined slopes takes seconds a series in Python, and
its penalties are not error rates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy import stats
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.trends.influence import Influence
from eha_bench.trends.noise import noise_of, without_outliers
from eha_bench.trends.tails import FURTHEST, chance_of_sum
from eha_bench.trends.terms import Kind, Term, design, gains, pair_gains

FEWEST: Final = 8
"""Fewest nights for a verdict on changes."""

_MOST_TERMS: Final = 16
_ROUNDS: Final = 8
_CONFIDENCE: Final = 0.95
_HOPE: Final = 1.4  # how much more a pair may gain at its own length than at a listed one
_LENGTHS: Final = (3, 5, 8, 13, 21, 34, 55, 89, 144)


@dataclass(frozen=True)
class Change:
    """A change of a series.

    Attributes:
        start: index of the first night of the new regime.
        kind: whether level or slope changed.
        size: of the step in the series' unit, or of the slope in its unit a night.
        p_value: corrected for all places looked at.
        earliest, latest: between these indices it started, with 95 % confidence.
    """

    start: int
    kind: Kind
    size: float
    p_value: float
    earliest: int
    latest: int


@dataclass(frozen=True)
class PiecewiseLine:
    """What a series did: its changes, and the piecewise straight line through it.

    Attributes:
        changes: in order.
        line: (n,) the level of every night.
        slope: of the last stretch, per night.
        sigma: standard deviation of a night about the line.
        widening: by how much correlation between nights widens that of a mean.
        strengths: (m,) of the influences, fitted with the changes; the line is without them.
    """

    changes: tuple[Change, ...]
    line: FloatArray
    slope: float
    sigma: float
    widening: float
    strengths: FloatArray = field(default_factory=lambda: np.zeros(0))

    def kink_word(self, change: Change) -> str:
        """Return what happens to the drift at a change of slope."""
        after = float(self.line[change.start + 1] - self.line[change.start])
        before = after - change.size
        if abs(before) <= 1e-6 * abs(change.size):
            return "drift begins"
        return "drift ends" if abs(after) <= 0.1 * abs(before) else "drift changes"


def course_of(
    values: FloatArray, *, alpha: float, influence: Influence | None = None
) -> PiecewiseLine:
    """Return the changes of a series of finite values, shape (n,).

    Args:
        values: one a night, in order.
        alpha: probability of a false change in a series that has none.
        influence: what else acts on the nights; nothing if None.
    """
    known = influence if influence is not None else Influence.none(values.size)
    if values.size < FEWEST:
        middle = float(np.median(values)) if values.size else float("nan")
        sigma = float(values.std(ddof=1)) if values.size > 1 else float("nan")
        line = np.full(values.size, middle)
        return PiecewiseLine((), line, 0.0, sigma, 1.0, np.zeros(known.count))
    found = noise_of(values)
    # in units of its noise, about 0: no rounding, and no underflow
    middle = float(np.median(values))
    scaled = (values - middle) / found.sigma
    clipped = without_outliers(scaled, 1.0)
    search = _ChangeSearch(clipped, scaled, alpha, found.widening, known.scaled(found.sigma))
    terms = search.run()
    sizes = search.sizes(terms)
    line = design(terms, values.size) @ sizes[: 1 + len(terms)]
    p_values = search.p_values(terms)
    changes = tuple(
        Change(term.start, term.kind, float(size) * found.sigma, p, *search.places(term, terms))
        for term, size, p in sorted(
            zip(terms, sizes[1 : 1 + len(terms)], p_values, strict=True),
            key=lambda entry: entry[0],
        )
    )
    slope = float(line[-1] - line[-2]) if terms and _slopes(terms) else 0.0
    return PiecewiseLine(
        changes,
        middle + found.sigma * line,
        slope * found.sigma,
        search.sigma(terms) * found.sigma,
        found.widening,
        sizes[1 + len(terms) :],
    )


def _bounded(residuals: FloatArray) -> FloatArray:
    return np.clip(residuals, -FURTHEST, FURTHEST)


def _slopes(terms: list[Term]) -> bool:
    return any(term.kind is Kind.KINK for term in terms)


class _ChangeSearch:
    """The search for the terms of one series (in units of its noise)."""

    def __init__(
        self,
        values: FloatArray,
        raw: FloatArray,
        alpha: float,
        widening: float,
        influence: Influence,
    ) -> None:
        self._count = values.size
        # what is slow is known no better than correlated nights tell: beliefs count as much more
        self._values = influence.with_beliefs(values, widening)
        self._raw = influence.with_beliefs(raw, widening)
        self._influence = influence
        self._alpha = alpha
        self._widening = widening
        self._looks = 2 * values.size

    def design(self, terms: list[Term]) -> FloatArray:
        """Return the columns of the model: a constant, the terms, the influences."""
        return self._influence.beside(design(terms, self._count), self._widening)

    def sizes(self, terms: list[Term]) -> FloatArray:
        """Return the level, the sizes of the terms and the strengths of the influences."""
        found = np.linalg.lstsq(self.design(terms), self._values, rcond=None)[0]
        return np.asarray(found, dtype=np.float64)

    def run(self) -> list[Term]:
        """Return the significant terms."""
        terms: list[Term] = []
        while len(terms) < _MOST_TERMS:
            grown = self._with_further_terms(terms)
            if grown is None:
                break
            terms = grown
        return self._pruned(terms)

    def _squares(self, terms: list[Term]) -> float:
        return float(np.sum((self._values - self.design(terms) @ self.sizes(terms)) ** 2))

    def sigma(self, terms: list[Term]) -> float:
        """Return the standard deviation about the model."""
        degrees = max(1, self._count - 1 - len(terms))
        return float(np.sqrt(self._squares(terms) / degrees))

    def _p_value(self, squares: float, gain: float, degrees: int, inflation: float) -> float:
        """Return the corrected p-value of a term that lowers `squares` by `gain`."""
        if degrees < 1:
            return 1.0
        # a night scatters by at least what its neighbours say, in units of which all this is
        floor = 0.5 * degrees
        error = inflation * max(squares - gain, floor) / degrees
        p = 2.0 * float(stats.t.sf(np.sqrt(gain / error), degrees))
        return min(1.0, self._looks * p)

    def _with_further_terms(self, terms: list[Term]) -> list[Term] | None:
        """Return the terms with the best further one or two, if they may be significant."""
        squares = self._squares(terms)
        options = sorted(self._options(terms), key=lambda option: -option[0])
        for beyond, further in options:
            gain = _HOPE * (beyond + len(further) * self._price)
            if self._p_of_growth(squares, gain, len(terms), further) > self._alpha:
                continue  # not even if its best place were much better
            grown = self._refine_terms([*terms, *further])
            p = self._p_of_growth(squares, squares - self._squares(grown), len(terms), further)
            if p <= self._alpha:
                return grown
        return None

    def _options(self, terms: list[Term]) -> Iterator[tuple[float, list[Term]]]:
        """Yield what may be added, with what it gains beyond the price of its parameters."""
        count, price, model = self._count, self._price, self.design(terms)
        for kind in Kind:
            found = gains(self._values, model, kind, count)
            start = int(np.argmax(found))
            if found[start] > 0.0:
                yield float(found[start]) - price, [Term(start, kind)]
            best, pair = 0.0, None
            for length in (length for length in _LENGTHS if length <= count - 6):
                found = pair_gains(self._values, model, kind, count, length)
                start = int(np.argmax(found))
                if found[start] > best:
                    best, pair = float(found[start]), (start, length)
            if pair is not None:
                yield best - 2.0 * price, [Term(pair[0], kind), Term(sum(pair), kind)]

    @property
    def _price(self) -> float:
        """What a parameter has to gain, so that one and two of them compare."""
        return 2.0 * self._widening**2 * float(np.log(self._count))

    def _p_of_growth(self, squares: float, gain: float, before: int, further: list[Term]) -> float:
        """Return the corrected p-value of all that was added at once."""
        degrees = self._count - 1 - before - len(further)
        if len(further) == 1:
            return self._p_value(squares, gain, degrees, self._widening**2)
        if degrees < 1:
            return 1.0
        error = self._widening**2 * max(squares - gain, 0.5 * degrees) / degrees
        looks = self._looks * len(_LENGTHS)
        return min(1.0, looks * float(stats.f.sf(gain / 2.0 / error, 2, degrees)))

    def _refine_terms(self, terms: list[Term]) -> list[Term]:
        """Return the terms, each at its best place and of its best kind given the others."""
        for _ in range(_ROUNDS):
            before = list(terms)
            for place in range(len(terms)):
                others = [term for i, term in enumerate(terms) if i != place]
                model = self.design(others)
                options = [(gains(self._values, model, kind, self._count), kind) for kind in Kind]
                found, kind = max(options, key=lambda option: float(option[0].max()))
                if found.max() > 0.0:
                    terms[place] = Term(int(np.argmax(found)), kind)
            if terms == before:
                break
        return terms

    def p_values(self, terms: list[Term]) -> list[float]:
        """Return the corrected p-value of each term given the others."""
        line = self.design(terms) @ self.sizes(terms)
        whole = float(np.sum((self._values - line) ** 2))
        count, degrees = self._count, self._count - 1 - len(terms)
        found = []
        # two terms may have come as one pair, which was looked for at all these lengths
        lengths = len(_LENGTHS) if len(terms) > 1 else 1
        noise = _bounded((self._raw - line)[:count]) * np.sqrt(count / max(1, degrees))
        for term in terms:
            others = [other for other in terms if other is not term]
            without = self._squares(others)
            column = self._own_column(term, others)
            inflation = self._inflation(column[:count])
            p = self._p_value(without, without - whole, degrees, inflation)
            p = max(p, self._by_tails(column, others, noise, inflation))
            found.append(min(1.0, lengths * p))
        return found

    def _own_column(self, term: Term, others: list[Term]) -> FloatArray:
        """Return what a term adds that no combination of the others does, shape (n + m,)."""
        basis, _ = np.linalg.qr(self.design(others))
        column = np.zeros(self._values.size)
        column[: self._count] = term.column(self._count)
        own: FloatArray = column - basis @ (basis.T @ column)
        return own

    def _inflation(self, column: FloatArray) -> float:
        """Return by how much correlation raises the variance of a sum with these weights."""
        square = self._widening**2
        alike = (square - 1.0) / (square + 1.0)
        damped = lfilter([1.0], [1.0, -alike], column)
        return max(1.0, float(2.0 * column @ damped / (column @ column)) - 1.0)

    def places(self, term: Term, terms: list[Term]) -> tuple[int, int]:
        """Return between which nights a term starts, the others held (profile likelihood)."""
        others = [other for other in terms if other is not term]
        found = gains(self._values, self.design(others), term.kind, self._count)
        first = max((other.start + 1 for other in others if other.start < term.start), default=0)
        after = min((other.start for other in others if other.start > term.start), default=None)
        likely = found[first:after] / (2.0 * (self._widening * self.sigma(terms)) ** 2)
        share = np.exp(likely - likely.max())
        order = np.argsort(share)[::-1]
        held = np.cumsum(share[order]) / share.sum()
        inside = first + order[: 1 + int(np.searchsorted(held, _CONFIDENCE))]
        return int(inside.min()), int(inside.max())

    def _by_tails(
        self, column: FloatArray, others: list[Term], noise: FloatArray, inflation: float
    ) -> float:
        """Return the corrected p-value of a term by the series' own scatter."""
        line = self.design(others) @ self.sizes(others)
        total = float(column @ _bounded(self._raw - line))
        chance = chance_of_sum(column, total, _bounded(noise), inflation=inflation)
        return min(1.0, self._looks * chance)

    def _pruned(self, terms: list[Term]) -> list[Term]:
        """Return the terms without those that the others made superfluous."""
        terms = list(dict.fromkeys(terms))
        while terms:
            p_values = self.p_values(terms)
            worst = int(np.argmax(p_values))
            if p_values[worst] <= self._alpha:
                break
            terms = self._refine_terms([term for i, term in enumerate(terms) if i != worst])
        return sorted(terms)
