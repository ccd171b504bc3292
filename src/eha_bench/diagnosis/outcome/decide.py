"""The verdict: an effect, nothing, or something that no known effect explains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from eha_bench.core.per_cent import per_cent
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.candidates import LEARNED, SheetNumber
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, Excess
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.outcome.confounded import follows_pressure, is_pressure
from eha_bench.diagnosis.outcome.diagnosis import MAY_AS_WELL, Unknown, Verdict
from eha_bench.diagnosis.outcome.refusal import Refusal, placed_by_refusals
from eha_bench.diagnosis.outcome.whereabouts import acts_in
from eha_bench.diagnosis.search.state import Accepted, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.learn import learn, times_of
from eha_bench.diagnosis.unknown.locator import Locator, locate
from eha_bench.diagnosis.unknown.places import places_of
from eha_bench.diagnosis.unknown.straight import straight_line, straight_line_notes

_LOUD, _QUIET = 2.0, 1.1
"""Mean square of a channel, in the noise's, from which it errs, and up to which it does not."""
_TIMES = 1.0
"""Share above the noise from which a note counts in times the noise, not in per cent."""


@dataclass(frozen=True)
class Decision:
    """A verdict with what it rests on.

    Attributes:
        verdict: effect, none or unknown. fit: of the revised model.
        notes: sentences for the report. unknown: where something unexplained acts.
        learned: whether the revised model carries a learned curve.
        locator: what weighed the places, and `located`: the curves it found, the best first.
    """

    verdict: Verdict
    fit: Fit
    notes: tuple[str, ...]
    unknown: Unknown | None
    learned: bool = False
    locator: Locator | None = None
    located: tuple[LocatedCurve, ...] = ()


def decide(
    search: Search, step: float, progress: ProgressHook, refused: Sequence[Refusal] = ()
) -> Decision:
    """Return the verdict on a finished search.

    Args:
        search: finished. step: integration step of the localisation, s. progress: called often.
        refused: effects that were found before and do not stand.
    """
    rest, limits = search.excess_left, search.thresholds
    unexplained = search.is_unexplained
    share = 1.0 - search.share_left
    remains = _remaining(rest.relative, search.excess_base.relative)
    notes = [*(item.note for item in refused), remains]
    if search.effects and (not unexplained or share >= limits.explained):
        if unexplained and search.is_all_but_a_form:
            notes.append(
                "the causes found leave more than noise, as little as another form of their laws "
                "would"
            )
        elif unexplained:
            notes.append("the causes found do not explain everything: something else is missing")
            notes += _in_one_channel(rest)
        return Decision(Verdict.EFFECT, search.fit, tuple(notes), None)
    if not unexplained:
        if rest.relative > limits.rest:
            worst = max(rest.by_channel, key=lambda name: rest.by_channel[name])
            notes.append(
                "that has no structure in time: single outliers, or more noise than estimated, "
                f"mostly of '{worst}'"
            )
        if search.excess_base.relative > limits.rest:
            notes += _seen_too_seldom(search, refused)
        return Decision(Verdict.NONE, search.fit, tuple(notes), None)
    if search.effects:
        return _beside_a_remainder(search, share, step, progress, notes)
    found = _unknown(search, step, progress, tuple(notes))
    unknown = found.unknown
    assert unknown is not None
    if not (found.learned and unknown.share > limits.nearly_all):
        # a curve that explains all leaves nothing to an effect that explains half
        found = replace(found, notes=(*found.notes, *_seen_too_seldom(search, refused)))
    placed = placed_by_refusals(unknown, refused, limits)
    if placed is unknown:
        return _without_the_curve(found, remains) if found.learned else found
    # a curve in another balance is no part of the revised model
    return replace(found, unknown=placed, learned=False, fit=search.fit)


def _seen_too_seldom(search: Search, refused: Sequence[Refusal]) -> list[str]:
    """Say which effect would explain most of it, but in too few stretches to be sure.

    One that was refused has another reason, which is told.
    """
    limits = search.thresholds
    told = {item.item.start.candidate for item in refused}
    likely = [
        item
        for item in search.ranking
        if item.refitted
        and not item.candidate.startswith("parameter:")
        and item.candidate not in told
        and item.score > limits.explained
        and search.base.cost - item.cost > limits.gain
        and limits.p_value <= item.p_value < limits.likely
    ]
    if not likely:
        return []
    best = max(likely, key=lambda item: item.score)
    return [
        f"{best.candidate} would explain {per_cent(best.score)} of what is missing, but shows in "
        f"too few stretches of these runs to be sure (probability of chance {best.p_value:.2g}, "
        f"and {limits.p_value:g} is asked for): record more of them, or longer ones"
    ]


def _without_the_curve(found: Decision, remains: str) -> Decision:
    """Return a decision that says of what remains that the learned curve is not in it."""
    said = f"without the learned curve {remains}"
    return replace(found, notes=tuple(said if note == remains else note for note in found.notes))


def _remaining(after: float, before: float) -> str:
    """Say by how much the error is above the noise, with the causes found and without them."""
    left, was = _above(after), _above(before)
    if left == was:
        return f"the mean square error is {left}"
    was = was.removesuffix(" above the noise's")
    return f"the mean square error that remains is {left} ({was} before)"


def _in_one_channel(rest: Excess) -> list[str]:
    """Say where only one of several channels errs: what acts on a machine shows in more than it."""
    order = sorted(rest.by_channel, key=lambda name: -rest.by_channel[name])
    if len(order) < 2 or rest.by_channel[order[0]] < _LOUD or rest.by_channel[order[1]] > _QUIET:
        return []
    times = math.sqrt(rest.by_channel[order[0]])
    return [
        f"what remains shows in '{order[0]}' alone, by {times:.2g} times its noise: its sensor may "
        "be at fault, and then the causes found may only imitate that"
    ]


def _above(share: float) -> str:
    if share >= _TIMES:
        return f"{1.0 + share:.3g} times the noise's"
    return f"{per_cent(max(share, 0.0), 1)} above the noise's"


def _beside_a_remainder(
    search: Search, share: float, step: float, progress: ProgressHook, notes: Sequence[str]
) -> Decision:
    """Return the verdict where known effects explain less than half: a part, or an imitation.

    A measured machine keeps a remainder that no law of a few numbers explains, and effects may well
    be a part of what is missing. An imitation is told by where it acts: in another balance than
    what is missing, or a curve with as many numbers as it has knots explains as much there. A curve
    of the pressure that an effect follows is no rival of it: it is the same cause in another form.
    """
    known = search.snapshot()
    names = ", ".join(item.start.candidate for item in known.effects)
    search.accepted = [
        item
        for item in search.accepted
        # one of a sheet is as declared in the fit that follows
        if item.start.is_parameter and not isinstance(item.start, SheetNumber)
    ]
    search.fit = search.base
    text = f"the best known effects explain less than half of it: {names}"
    found = _unknown(search, step, progress, (*notes, text))
    assert found.unknown is not None
    place = found.unknown.equation
    there = all(item.start.equation == place for item in known.effects)
    much = search.thresholds.is_much(search.excess_base)
    beaten = found.unknown.share >= search.thresholds.beaten * share
    if not (much and there and (not beaten or _is_their_law(search, known.effects, found.unknown))):
        return found
    search.restore(known)
    text = (
        f"{names}: {per_cent(share)} of it is explained; more is missing in the {place} balance, "
    )
    text += (
        f"and a curve of one variable would explain {per_cent(max(found.unknown.share, 0.0))} of it"
    )
    return Decision(Verdict.EFFECT, search.fit, (*notes, text), None)


def _is_their_law(search: Search, items: Sequence[Accepted], unknown: Unknown) -> bool:
    """Whether a curve follows a pressure, and so does an effect that was found."""
    if not unknown.variables:
        return False
    plant = search.problem.plant
    named = {item.start.candidate for item in items}
    if not any(effect.id in named and follows_pressure(effect) for effect in plant.layout.effects):
        return False
    return all(is_pressure(plant, name) for name in unknown.variables)


def _unknown(
    search: Search, step: float, progress: ProgressHook, notes: tuple[str, ...]
) -> Decision:
    """Return the verdict unknown, with where something acts and what it follows."""
    locator, equation, located = locate(search.problem, search.fit, step, progress)
    if not located:
        where = f"something {acts_in(equation, '')}" if equation else "nothing was located"
        text = f"{where}; no curve of what is measured could be tried there"
        if not places_of(search.problem.plant):
            text = (
                "something is missing, but its place is unknown: this plant has no `advance` "
                "(simulation step by step), so only its parameters were tried"
            )
        unknown = Unknown(equation or None, (), text)
        return Decision(Verdict.UNKNOWN, search.fit, notes, unknown)
    progress("learn", 0.0)
    found = _decision_with_curve(search, locator, located[0], step, notes)
    others = [name for name in locator.near if name != located[0].template.equation]
    if others:
        also = f"{MAY_AS_WELL} in the {' or '.join(others)} balance"
        found = replace(found, notes=(*found.notes, also))
    return replace(found, locator=locator, located=tuple(located))


def in_held_out(decision: Decision, equation: str) -> Decision:
    """Return the verdict unknown where held-out runs show what training runs do not.

    Args:
        decision: that nothing is missing. equation: where held-out runs place it, "" for nowhere.
    """
    text = (
        f"something {acts_in(equation, '') if equation else 'acts'} in held-out runs, where "
        "training did not go: use such a run for training to learn what"
    )
    unknown = Unknown(equation or None, (), text)
    return replace(decision, verdict=Verdict.UNKNOWN, unknown=unknown)


def without_curve(decision: Decision, search: Search, why: str) -> Decision:
    """Return a decision whose learned curve is left out of the revised model.

    A curve that explains little of the windows and harms whole runs names no variable.

    Args:
        decision: with the curve. search: finished. why: replays speak against it.
    """
    note = f"the learned curve is left out of the revised model: {why}"
    unknown = decision.unknown
    if unknown is not None and not unknown.share > search.thresholds.explained:
        text = (
            f"something {acts_in(unknown.equation or '', unknown.at)}; the best curve, of "
            f"{', '.join(unknown.in_words)}, explains {per_cent(unknown.share)} of the excess in "
            "windows and makes whole runs worse, so what it depends on remains open"
        )
        unknown = Unknown(unknown.equation, (), text, unknown.share, at=unknown.at)
    return replace(
        decision,
        fit=search.fit,
        learned=False,
        unknown=unknown,
        notes=(*decision.notes, note),
    )


def _decision_with_curve(
    search: Search, locator: Locator, best: LocatedCurve, step: float, notes: tuple[str, ...]
) -> Decision:
    _, fit = learn(search.problem, locator.short, search.fit, best, step)
    floor = SOFT_MEAN * search.problem.size
    soft, _ = soften(search.fit.residual, fit.soft)
    before = float(soft @ soft)
    share = (before - fit.cost) / max(before - floor, 1.0)
    if not share > search.thresholds.nothing:
        text = f"something {acts_in(best.template.equation, '')}; no curve that was tried "
        text += "explains any of it, so what it depends on remains open"
        unknown = Unknown(best.template.equation, (), text, 0.0)
        return Decision(Verdict.UNKNOWN, search.fit, notes, unknown)
    template = best.template
    name = best.follows
    period = float(fit.vector[search.problem.plant.layout.index[f"{LEARNED}.period"]])
    text = f"something {acts_in(template.equation, template.place)}"
    follows = share > search.thresholds.follows
    if follows:
        comma = "," if "," in text else ""
        text += f"{comma} and depends on {name}"
        if period:
            text += f", periodic with {period:.4g} (SI)"
        text += f"; a learned curve explains {per_cent(min(share, 1.0))} of the excess"
    else:
        text += f"; a curve of {name} explains {per_cent(max(share, 0.0))} of the excess, "
        text += "so it depends on several variables, or on the past"
    when = (
        times_of(search.problem, fit, search.declared_vector) if template.variable == "time" else ()
    )
    # what follows nothing is no curve to go on with
    learned = follows and fit.cost < before
    shape = straight_line(best, search.problem.plant, fit.vector) if learned else ""
    return Decision(
        Verdict.UNKNOWN,
        fit if learned else search.fit,
        (*notes, *straight_line_notes(shape)),
        Unknown(
            template.equation,
            (template.variable,) if follows else (),
            text,
            max(share, 0.0),
            period if follows else 0.0,
            when if follows else (),
            template.place,
            derived={template.variable: best.position} if follows and best.position else {},
            shape=shape,
        ),
        learned,
    )
