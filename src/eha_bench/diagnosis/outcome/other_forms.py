"""The other forms of an effect that fit as well: what one form predicts, another may not.

An effect is a family: friction may be asymmetric where it is dry or where it is viscous, a leak may
drain to the tank or to the reservoir. A search names the effect by the form that fits best.
"""

from __future__ import annotations

from collections.abc import Iterator

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start, effect_starts
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.search.equivalent import is_as_good
from eha_bench.diagnosis.search.refit import at_the_bottom, free_of
from eha_bench.diagnosis.search.state import Accepted, Search

_TRIED = 8
"""Most forms of an effect; of more (a place among many), none is tried."""
_KEPT = 2


def other_forms(search: Search, item: Accepted, start: Start, fit: Fit) -> list[tuple[str, Fit]]:
    """Return the other forms of an effect that fit as well as what was found, the best first.

    Args:
        search: finished. item: what was found. start: of that, or of what stands in its place.
        fit: with it.

    Returns:
        What differs, in words, and the fit.
    """
    if start.is_parameter:
        return []
    layout = search.problem.plant.layout
    effect = layout.effect(start.candidate)
    choices = {
        layout.index[f"{effect.id}.{parameter.name}"]: parameter
        for parameter in effect.parameters
        if parameter.choices
    }
    own = {at: float(fit.vector[at]) for at in choices}
    forms: list[tuple[dict[int, float], Start]] = []
    for other in effect_starts(layout, effect):
        chosen = {at: value for at, value in other.settings if at in choices}
        if chosen != own and all(chosen != known for known, _ in forms):
            forms.append((chosen, other))
    if len(forms) > _TRIED:
        return []
    found = []
    for chosen, other in forms:
        best = _best_fit(search, item, other, start, fit)
        if is_as_good(search, best, search.fit, item.comparison.gain):
            words = ", ".join(
                f"{choices[at].name} {choices[at].choices[int(value)]}"
                for at, value in chosen.items()
                if value != own[at]
            )
            found.append((words, best))
    return sorted(found, key=lambda form: form[1].cost)[:_KEPT]


def _best_fit(search: Search, item: Accepted, other: Start, start: Start, fit: Fit) -> Fit:
    """Return the best fit of a form, from its own size and from that of the form that was found."""
    fixed = {*item.start.keys, *start.keys} - set(other.keys)
    free = tuple(
        one for one in free_of(search, other.apply(fit.vector), [other]) if one.key not in fixed
    )
    fits = [
        levenberg_marquardt(search.problem, vector, free, iterations=6, refresh=1)
        for vector in _sizes(other, start, fit)
    ]
    return at_the_bottom(search, min(fits, key=lambda one: one.cost))


def _sizes(other: Start, start: Start, fit: Fit) -> Iterator[FloatArray]:
    first = other.apply(fit.vector)
    yield first
    if other.strength_at == start.strength_at:
        second = first.copy()
        second[other.strength_at] = fit.vector[start.strength_at]
        yield second
