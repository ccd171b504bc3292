"""Fits what the data cannot tell from what was found, so that an experiment can be planned for it.

An equivalent candidate takes the place of the effect that it equals, or of the number, the others
are fitted with it again. What came next in the same look stays as it was fitted there. Where a
curve was learned, so are those of other variables that explain nearly as much. Where causes cannot
be distinguished, so are the other forms of each: what one form predicts of an experiment, another
may not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.candidates import LEARNED, SheetNumber
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.fit.uncertainty import posterior
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Verdict
from eha_bench.diagnosis.outcome.other_forms import OtherForm, other_forms
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.outcome.rival import NO_EFFECT, Rival, Standing
from eha_bench.diagnosis.search.equivalent import is_as_good
from eha_bench.diagnosis.search.exchange import fit_in_place
from eha_bench.diagnosis.search.state import Accepted, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.learn import learn
from eha_bench.plants.model import Model

_RUNNERS_UP = 2
_WORTH = 0.5
"""Share of the best one's gain from which a runner-up is kept."""
_NEARLY = 0.7
"""Share of what the best curve explains from which another variable's is a rival."""
_CURVES = 2


def name_of(model: Model, added: Sequence[str]) -> str:
    """Return a rival's id: its effects, and what a learned curve of them follows."""
    words = []
    for name in added:
        values = next((item.values for item in model.effects if item.id == name), {})
        words.append(f"{name} of {values['variable']}" if name == LEARNED else name)
    return "+".join(words) or NO_EFFECT


def found_rival(search: Search, fit: Fit, model: Model, added: Sequence[str]) -> Rival:
    """Return what was found as a rival of the others."""
    covariance = posterior(fit, search.groups)
    name = name_of(model, added)
    return Rival(name, tuple(added), Standing.FOUND, 0.0, model, covariance)


def other_rivals(
    search: Search,
    decision: Decision,
    found: Diagnosis,
    forms: Mapping[str, Sequence[OtherForm]],
) -> tuple[Rival, ...]:
    """Fit the rivals of what was found, the nearest first.

    Args:
        search: finished. decision: on it. found: what came of it.
        forms: effect that was found -> its other forms that fit as well.
    """
    rivals = [
        rival
        for item in search.accepted
        if item.start.is_parameter
        # parts differ from their sheet, and that is no rival of anything
        and not isinstance(item.start, SheetNumber)
        and found.verdict is not Verdict.UNKNOWN
        for rival in _equal_to(search, item, found.recalibrated)
    ]
    if found.verdict is Verdict.EFFECT:
        rivals += [rival for item in search.effects for rival in _in_place_of(search, item, found)]
        if any(item.standing is Standing.EQUIVALENT for item in rivals):
            names = [item.start.candidate for item in search.effects]
            rivals += [
                _in_form(search, form, found.revised, names)
                for name in names
                for form in forms.get(name, ())
            ]
    elif found.verdict is Verdict.UNKNOWN and decision.learned:
        rivals = list(_other_curves(search, decision, found))
    taken = {item.id for item in found.rivals}
    unique = {item.id: item for item in reversed(rivals) if item.id not in taken}
    return tuple(sorted(unique.values(), key=lambda item: (item.standing.value, item.behind)))


def _in_place_of(search: Search, item: Accepted, found: Diagnosis) -> Iterator[Rival]:
    """Yield what could stand in the place of an effect that was added."""
    name = item.start.candidate
    look = search.look_of(item)
    own = next((trial for trial in look if trial.candidate == name), None)
    yield from _equal_to(search, item, found.revised)
    if own is None:
        return
    before = search.effects[: search.effects.index(item)]
    next_best = [
        trial
        for trial in look
        if trial.candidate != name
        and trial.candidate not in item.equivalent
        and not trial.start.is_parameter
        and trial.comparison.gain > _WORTH * own.comparison.gain
        and trial.fit.residual.size == search.fit.residual.size
    ]
    for trial in next_best[:_RUNNERS_UP]:
        added = [*(other.start.candidate for other in before), trial.candidate]
        # by the noise as it is told in the end; a look's costs are of the noise of before
        behind = cost_of(search.problem, trial.fit.vector) - search.fit.cost
        yield _rival(search, trial.fit, found.revised, added, Standing.RUNNER_UP, behind)


def _equal_to(search: Search, item: Accepted, declared: Model) -> Iterator[Rival]:
    """Yield what the data cannot tell from an effect, or from a number that is declared wrongly.

    Args:
        search: finished. item: that was added. declared: the model of what a rival does not fit.
    """
    others = [other.start.candidate for other in search.effects if other is not item]
    for trial in search.look_of(item):
        if trial.candidate in item.equivalent and trial.candidate not in others:
            fit = fit_in_place(search, item, trial)
            # equivalents of an effect were asked again when all was found
            if item.start.is_parameter and not is_as_good(
                search, fit, search.fit, item.comparison.gain
            ):
                continue
            added = [*others, trial.candidate]
            behind = fit.cost - search.fit.cost
            yield _rival(search, fit, declared, added, Standing.EQUIVALENT, behind)
            for form in other_forms(search, item, trial.start, fit):
                yield _in_form(search, form, declared, added)


def _rival(
    search: Search, fit: Fit, declared: Model, added: Sequence[str], standing: Standing,
    behind: float,
) -> Rival:  # fmt: skip
    kept = tuple(item for item in declared.effects if item.id in search.declared)
    plain = Model(declared.plant_id, declared.parameters, declared.calibrate, kept,
                  declared.within, declared.per_run, declared.network)  # fmt: skip
    layout = plain.plant.layout
    plants_own = {item.name for item in layout.parameters}
    keys = [item.key for item in fit.free if item.key in plants_own]
    keys += [item.key for item in fit.free if item.key.rpartition(".")[0] in search.declared]
    model = revised_model(plain, fit.vector, keys, added)
    covariance = posterior(fit, search.groups)
    return Rival(name_of(model, added), tuple(added), standing, behind, model, covariance)


def _in_form(search: Search, form: OtherForm, declared: Model, added: Sequence[str]) -> Rival:
    """Return the rival of an effect in another form.

    Args:
        search: finished. form: of the effect. declared: the revised model.
        added: effects of the rival.
    """
    behind = form.fit.cost - search.fit.cost
    rival = _rival(search, form.fit, declared, added, Standing.EQUIVALENT, behind)
    return replace(rival, form=form.words)


def _other_curves(search: Search, decision: Decision, found: Diagnosis) -> Iterator[Rival]:
    """Yield curves of other variables that explain nearly as much."""
    if decision.locator is None or not decision.located:
        return
    best, *rest = decision.located
    tried = {_variable_of(best)}
    for item in rest:
        if item.share < _NEARLY * best.share or len(tried) > _CURVES:
            break
        if _variable_of(item) in tried:
            continue
        tried.add(_variable_of(item))
        _, fit = learn(search.problem, decision.locator.short, search.fit, item, COARSE)
        behind = fit.cost - decision.fit.cost
        yield _rival(search, fit, found.revised, [LEARNED], Standing.EQUIVALENT, behind)


def _variable_of(item: LocatedCurve) -> str:
    return item.template.variable
