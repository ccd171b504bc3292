"""Chooses what is added: believed, inside its bounds, and the simplest of those as good."""

from __future__ import annotations

from collections.abc import Sequence

from eha_bench.diagnosis.fit.beliefs import FAR, contradicted
from eha_bench.diagnosis.fit.candidates import SameNumber, SheetNumber, is_drawn
from eha_bench.diagnosis.fit.evidence import against_beliefs
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.search.bounds import are_inside
from eha_bench.diagnosis.search.equivalent import CHANCE, is_as_good, is_far_above_noise, tie
from eha_bench.diagnosis.search.resolution import below_reading
from eha_bench.diagnosis.search.state import Refit, Search
from eha_bench.diagnosis.search.yielding import yields_to
from eha_bench.plants.effect import POSITION_LOOP


def choose(search: Search, trials: Sequence[Refit]) -> Refit | None:
    """Return what is added next of a look's candidates, the best first; None where none will do.

    What would have been, were it not smaller than its log can tell, is kept in the search, for a
    note.
    """
    good = [item for item in trials if _is_acceptable(search, item)]
    told = [item for item in good if not below_reading(search, item.start, item.fit.vector)]
    otherwise = _best_of(search, good, good) if len(told) < len(good) else None
    if otherwise is not None and all(otherwise is not item for item in told):
        why = below_reading(search, otherwise.start, otherwise.fit.vector)
        search.too_small[otherwise.candidate] = why
    return _best_of(search, told, trials)


def _best_of(search: Search, good: list[Refit], trials: Sequence[Refit]) -> Refit | None:
    """Return the one of a look's acceptable candidates that is added, None where there is none."""
    if not good:
        return None
    good = _inside_bounds(search, good)
    chosen = good[0]
    if (number := _number_of_a_sheet(search, chosen, trials)) is not None:
        return number
    tied = max(CHANCE, tie(chosen.comparison.gain, chosen.fit.residual.size))
    alike = [item for item in good if item.fit.cost - chosen.fit.cost < tied]
    numbers = (item for item in alike if item.start.is_parameter)
    if number := next((item for item in numbers if _is_as_good(search, item, chosen)), None):
        # a number that may be declared wrongly is likelier than an effect that does no better
        return number
    # of those that leave equally little, the one with the fewest numbers to choose is the
    # likeliest, then the one that carries over best to runs left out
    simplest = min(alike, key=lambda item: (len(item.start.keys), -item.comparison.gain_out))
    return _yielding(search, _of_the_machine(search, simplest, good), good)


def _of_the_machine(search: Search, chosen: Refit, good: Sequence[Refit]) -> Refit:
    """Return what is in every machine instead of a controller's firmware, where it is as good.

    Far above the noise, something else is missing in both, and which is nearer says little: the dry
    friction of a servo's arm leaves its errors as a dead zone of its loop does.
    """
    if not (is_far_above_noise(chosen.fit) and _is_of_firmware(search, chosen)):
        return chosen
    return next(
        (
            item
            for item in good
            if not _is_of_firmware(search, item) and _is_as_good(search, item, chosen)
        ),
        chosen,
    )


def _is_of_firmware(search: Search, item: Refit) -> bool:
    """Whether a candidate acts in a position loop inside the plant."""
    if item.start.is_parameter:
        return False
    return search.problem.plant.layout.effect(item.candidate).role == POSITION_LOOP


def _is_as_good(search: Search, item: Refit, chosen: Refit) -> bool:
    """Whether a candidate explains as much as the chosen one."""
    return item is chosen or is_as_good(search, item.fit, chosen.fit, chosen.comparison.gain)


def _number_of_a_sheet(search: Search, chosen: Refit, trials: Sequence[Refit]) -> Refit | None:
    """Return a number of a maker's sheet that explains much of what the chosen one does, or None.

    Each part differs from its sheet, and its law from the textbook's by about as much: an effect
    that does little more may stand for that (an offset for where a check valve begins to open). One
    that is there is found beside the number, which is taken out again where it is needless.
    """
    limits = search.thresholds
    return next(
        (
            item
            for item in trials
            if isinstance(item.start, SheetNumber)
            and item.start.is_within(item.fit.vector)
            and item.comparison.gain > max(limits.gain, limits.explained * chosen.comparison.gain)
            and item.comparison.gain_out > limits.gain / 2
        ),
        None,
    )


def _yielding(search: Search, chosen: Refit, good: Sequence[Refit]) -> Refit:
    """Return what describes the same as the chosen one with less, where it explains it as well."""
    if chosen.start.is_parameter:
        return chosen
    other = yields_to(search, chosen.candidate, chosen.fit.vector)
    least = search.thresholds.nearly_all
    return next(
        (
            item
            for item in good
            if item.candidate == other
            and min(item.comparison.share, item.comparison.share_out) > least
        ),
        chosen,
    )


def _inside_bounds(search: Search, good: list[Refit]) -> list[Refit]:
    """Return those that stand at no bound, where the best of these is as good as any.

    What stands at a bound is refused in the end, and would take the place of what does as well.
    """
    inside = [item for item in good if are_inside(search, [item.start], item.fit.vector)]
    best = good[0]
    if inside and is_as_good(search, inside[0].fit, best.fit, best.comparison.gain):
        return inside
    return good


def _is_acceptable(search: Search, item: Refit) -> bool:
    limits, found = search.thresholds, item.comparison
    if not limits.allow(found):
        return False
    if not _relieves(search, item):
        return False
    if isinstance(item.start, SheetNumber):
        if not item.start.is_within(item.fit.vector):
            return False
    elif isinstance(item.start, SameNumber) and not _is_one_number(search, item.start, item.fit):
        return False
    if is_drawn(search.problem.plant.layout, item.start):
        # one that is only bent by what is missing explains a part of it, and carries over badly
        return min(found.share, found.share_out) > limits.nearly_all
    if search.effects and limits.is_part_of_a_form(found, search.share_left):
        return False
    return limits.is_enough(found, search.excess_left, len(search.effects))


def _is_one_number(search: Search, start: SameNumber, fit: Fit) -> bool:
    """Whether several parts have one other number, with which all that is believed goes along.

    Two areas make up for a sensor's gain as well, and then a pump's displacement for them.
    """
    against = contradicted(search.problem.beliefs, fit.vector, FAR)
    return start.is_one(fit.vector) and not against


def _relieves(search: Search, item: Refit) -> bool:
    """Whether a candidate brings back what is believed, where that says something is missing.

    Where readings hold next to nothing, parameters beyond what is believed of them are what a cause
    has to explain. One that leaves them there gains by the form of what is there, and imitates what
    moved them (the scale of a sensor).
    """
    limits, missing = search.thresholds, search.excess_left
    if limits.is_seen(missing) or missing.against_beliefs <= limits.gain:
        return True
    return against_beliefs(item.fit) <= (1.0 - limits.explained) * missing.against_beliefs


def equivalents(search: Search, chosen: Refit, trials: Sequence[Refit]) -> tuple[str, ...]:
    """Return candidates whose fit is not worse than the chosen one's beyond resampling noise."""
    found = []
    for item in trials:
        if item.candidate == chosen.candidate or item.start.is_parameter:
            continue
        if item.comparison.gain < 0.5 * chosen.comparison.gain:
            continue
        if is_as_good(search, item.fit, chosen.fit, chosen.comparison.gain):
            found.append(item.candidate)
    return tuple(found)
