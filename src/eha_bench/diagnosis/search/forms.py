"""The other forms of what was added: what it leaves is more likely its form than another cause.

An effect is a family (a dead zone with sharp or round corners, its edges equal or not), and a
search adds the form that promised most before it was there. What another form explains is no
evidence of a second cause, so forms come first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import Start, effect_starts
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.search.equivalent import is_far_above_noise
from eha_bench.diagnosis.search.exchange import compared, fit_with_item_off
from eha_bench.diagnosis.search.refit import free_of, polish_at_rest
from eha_bench.diagnosis.search.state import Accepted, Search
from eha_bench.diagnosis.search.swing import is_swing, with_periods
from eha_bench.plants.effect import AT
from eha_bench.plants.layout import Layout

_FINISHED = 2
_AT = 1e-3
"""Share of a number within which it stands at a bound."""


def forms_of(layout: Layout, item: Accepted, fit: Fit) -> list[Start]:
    """Return the starts of an effect's forms, at the place where it acts.

    Which of the joints of a chain gives way is a matter of form: all of them make it soft.

    Its present form is among them where it has more numbers than its size: these may have run off
    to where they say nothing (a friction that falls at speeds that no run has reached).

    Args:
        layout: of the plant. item: what was added. fit: with it.
    """
    effect = layout.effect(item.start.candidate)
    choices = [
        layout.index[f"{effect.id}.{parameter.name}"]
        for parameter in effect.parameters
        if parameter.choices and (parameter.name != AT or effect.action.couples)
    ]
    place = layout.index.get(f"{effect.id}.{AT}")
    held = held_keys(layout, item, fit)
    found = []
    for start in effect_starts(layout, effect, refined=True):
        settings = dict(start.settings)
        elsewhere = (
            place is not None and place not in choices and settings[place] != fit.vector[place]
        )
        keys = tuple(key for key in start.keys if key not in held)
        other = any(settings[at] != fit.vector[at] for at in choices)
        if not elsewhere and choices and (other or len(keys) > 1):
            found.append(replace(start, keys=keys))
    return found


def held_keys(layout: Layout, item: Accepted, fit: Fit) -> set[str]:
    """Return what the search that found an effect holds (a count of teeth): no form moves it."""
    effect = layout.effect(item.start.candidate)
    searched = effect.search_parameters(layout.choice_values(effect, fit.vector))
    return {f"{effect.id}.{parameter.name}" for parameter in searched} - {*item.start.keys}


def take_best_form(search: Search, item: Accepted) -> bool:
    """Give something that was added its form that fits best; return whether that is another one."""
    done = polished(search, item, roughly(search, item)[:_FINISHED])
    inside = [trial for trial in done if not meets_a_bound(search, *trial)]
    if not inside:
        return False
    start, fit = min(inside, key=lambda trial: trial[1].cost)
    if fit.cost > search.fit.cost - search.thresholds.least_gain(search.excess_left):
        return False
    found = compared(search, item, fit)
    # what had fitted as well as the other form does not fit as well as this one, unless something
    # else is missing beside which the form hardly counts
    hardly = search.fit.cost - fit.cost < search.thresholds.behind_share * found.gain
    equals = item.equivalent if hardly and is_far_above_noise(fit) else ()
    search.fit = fit
    place = search.accepted.index(item)
    search.accepted[place] = replace(item, start=start, comparison=found, equivalent=equals)
    search.excess_left = excess(search.problem, fit)
    return True


def roughly(search: Search, item: Accepted) -> list[tuple[Start, Fit]]:
    """Return rough fits of an effect's forms, the best first.

    Args:
        search: with the effect. item: that was added; a parameter has no forms.
    """
    if item.start.is_parameter:
        return []
    starts = forms_of(search.problem.plant.layout, item, search.fit)
    if any(map(is_swing, starts)):
        starts = with_periods(search, starts, fit_with_item_off(search, item).vector)
    others, begin = _without(search, item), places(search, item, starts)
    tried = side_by_side(lambda place: (place[0], _rough(others, item, *place)), begin)
    return sorted(tried, key=lambda trial: trial[1].cost)


def polished(
    search: Search, item: Accepted, tried: Sequence[tuple[Start, Fit]]
) -> list[tuple[Start, Fit]]:
    """Return rough fits of an effect's forms fitted to the end."""
    others = _without(search, item)
    return [(start, polish_at_rest(others, fit, [start])) for start, fit in tried]


def _without(search: Search, item: Accepted) -> Search:
    """Return the search of all that was added but this."""
    others = search.snapshot()
    others.accepted = [other for other in search.accepted if other is not item]
    return others


def meets_a_bound(search: Search, start: Start, fit: Fit) -> bool:
    """Whether a number of a form's shape stands at a bound, where nothing measured holds it."""
    index, known = search.problem.places.index, search.problem.places.by_key
    for key in start.keys:
        if index[key] == start.strength_at:
            continue
        value, parameter = float(fit.vector[index[key]]), known[key]
        near = _AT * max(abs(value), 1e-12)
        if min(abs(value - parameter.low), abs(value - parameter.high)) <= near:
            return True
    return False


def places(
    search: Search, item: Accepted, starts: Sequence[Start]
) -> list[tuple[Start, FloatArray]]:
    """Return from where forms are fitted, each place once.

    A form's own size and shape or the present ones, whichever is nearer; and its own shape at the
    present size.
    """
    index, now = search.problem.plant.layout.index, search.fit.vector
    coarse = search.problem.at_step(COARSE)
    held = held_keys(search.problem.plant.layout, item, search.fit)
    found: dict[bytes, tuple[Start, FloatArray]] = {}
    for start in starts:
        own = start.apply(now)
        for key in held:
            own[index[key]] = now[index[key]]
        as_found, sized = own.copy(), own.copy()
        for key in {*item.start.keys} & {*start.keys}:
            as_found[index[key]] = now[index[key]]
        sized[start.strength_at] = now[start.strength_at]
        nearest = min((own, as_found), key=lambda one: cost_of(coarse, one))
        for place in (nearest, sized) if len(start.keys) > 1 else (nearest,):
            found.setdefault(place.tobytes(), (start, place))
    return [*found.values()]


def _rough(search: Search, item: Accepted, start: Start, vector: FloatArray) -> Fit:
    """Return a rough fit of a form from a place, beside all that was added but the effect."""
    coarse = search.problem.at_step(COARSE)
    dropped = {*item.start.keys} - {*start.keys}
    free = tuple(one for one in free_of(search, vector, [start]) if one.key not in dropped)
    known = {key: column for key, column in search.fit.columns.items() if key not in start.keys}
    return levenberg_marquardt(coarse, vector, free, iterations=4, known=known, refresh=0)
