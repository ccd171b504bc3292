"""From a finished search to what was found: effects with intervals, look-alikes, the ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.fit.baseline import COARSE, Baseline
from eha_bench.diagnosis.fit.candidates import LEARNED, SheetNumber
from eha_bench.diagnosis.fit.convergence import convergence, moved_notes
from eha_bench.diagnosis.fit.finish import ConvergedFit, converged_fit
from eha_bench.diagnosis.fit.friction_at_rest import friction_at_rest_of
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.own_parameters import LATENESS, LateClock, Places, is_latest
from eha_bench.diagnosis.fit.profile import profile_deviation
from eha_bench.diagnosis.fit.refitted_profile import strength_interval
from eha_bench.diagnosis.fit.uncertainty import (
    Estimate,
    estimates,
    open_parameters,
    spreads,
    undetermined_directions,
)
from eha_bench.diagnosis.outcome.confounded import (
    confounding_notes,
    constant_load_notes,
    lag_notes,
    one_way_notes,
    shared_offset_notes,
    zero_offset_notes,
)
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import ADDED, Diagnosis, FoundEffect, RankLine, Verdict
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.diagnosis.outcome.rivals import found_rival
from eha_bench.diagnosis.search.state import (
    ALL_BUT_A_FORM,
    RankedCandidate,
    Search,
    shown_by_no_run,
)
from eha_bench.plants.effect import BoundEffect
from eha_bench.plants.model import Model
from eha_bench.plants.parameter import Parameter

_MUCH = 0.25
"""Share of the excess from which a candidate that may be chance is worth another recording."""
_OPPOSITE = 0.05
"""Relative difference of two values whose signs alone differ."""


def adds(search: Search, decision: Decision) -> bool:
    """Whether anything was added to the calibrated model."""
    return bool(search.accepted) or decision.learned


def assemble(dataset: Dataset, base: Baseline, search: Search, decision: Decision) -> Diagnosis:
    """Return what was found, without errors: no run is replayed here."""
    model = dataset.model
    layout = model.plant.layout
    end = _converged_fit(search, decision)
    fit = end.fit
    added = [item.start.candidate for item in search.effects]
    if decision.unknown is not None and decision.learned:
        added.append(LEARNED)
    together = [item.start.keys for item in search.accepted if item.start.is_parameter]
    assumed = [key for keys in together for key in keys]
    keys = [*base.keys, *assumed]
    ended = convergence(fit, base.starts, base.agreed)
    profiles = _profiles(search, decision, fit) if ended.has_intervals else {}
    values = estimates(fit, search.groups, layout.units_at(fit.vector), profiles, end.shifts)
    late = lateness_estimates(search.problem.places, values)
    if ended.has_intervals:
        values |= _told_from_nothing(search, fit, values)
    else:
        values = {key: item.without_interval for key, item in values.items()}
    own = own_estimates(search.problem.places, values)
    calibrated = {key: values[key] for key in keys if key in values and key in layout.index}
    unknown = open_parameters(fit)
    calibrated = {k: v.without_interval if k in unknown else v for k, v in calibrated.items()}
    effects = []
    for item in search.effects:
        effect = layout.effect(item.start.candidate)
        at = {p.name: layout.index[f"{effect.id}.{p.name}"] for p in effect.parameters}
        numbers = {p.name: float(fit.vector[at[p.name]]) for p in effect.parameters if p.size == 1}
        effects.append(
            FoundEffect(
                effect.id,
                str(effect.equation(numbers).value),
                _numbers(effect, item.start.keys, values, numbers),
                effect.words_at(numbers),
                item.comparison.explained_out,
                item.comparison.p_value,
                effect.place(numbers),
            )
        )
    effects.sort(key=lambda item: -_share(search, item.id))
    groups = tuple(
        (item.start.candidate, *item.equivalent) for item in search.effects if item.equivalent
    )
    separate = {
        name: layout.effect(name).separate for name in {n for group in groups for n in group}
    }
    notes = list(base.notes)
    for key in base.nuisance:
        if fit.vector[layout.index[key]] == 0.0:
            continue
        text = f"friction at rest was estimated: {key} = {fit.vector[layout.index[key]]:.3g}"
        notes.append(f"{text} {layout.by_key[key].unit}")
    notes += _value_notes(model, fit, together)
    notes += _notes_of_other_numbers(search)
    if decision.verdict is not Verdict.UNKNOWN:
        notes += _notes_of_equal_effects(search)
    notes += _notes_of_what_is_small(search)
    notes += lateness_notes(search.problem.places, late)
    notes += decision.notes
    notes += ended.notes(["the learned curve" if name == LEARNED else name for name in added])
    notes += moved_notes(
        model, {key: float(fit.vector[layout.index[key]]) for key in keys if key in layout.index},
        ended.at_bounds, {key: (item.low, item.high) for key, item in calibrated.items()},
    )  # fmt: skip
    notes += one_way_notes(base.measured, search.problem.noise, keys)
    if decision.verdict is not Verdict.NONE:
        if untried := shown_by_no_run(search.problem):
            notes.append(
                f"{' and '.join(untried)} not tried: no fitted run turns back, and a play shows "
                "only there"
            )
        named = [layout.effect(item.start.candidate) for item in search.effects]
        notes += confounding_notes(base.measured, named)
        notes += lag_notes(search.problem.noise, model.plant, named)
        notes += zero_offset_notes(model.plant, fit.vector, effects)
        notes += constant_load_notes(model.plant, effects)
        notes += shared_offset_notes(model.plant, keys, effects)
    final = revised_model(model, fit.vector, keys, added)
    return Diagnosis(
        decision.verdict,
        final,
        # nothing added: it is the recalibrated one, as far down as it goes
        revised_model(model, search.base.vector, base.keys) if adds(search, decision) else final,
        tuple(effects) if decision.verdict is not Verdict.NONE else (),
        decision.unknown,
        groups,
        dict(sorted(separate.items())),
        _ranking(search),
        calibrated=calibrated,
        misread=dataset.misread,
        corrected={
            key: float(model.vector()[layout.index[key]])
            for key in assumed
            if key in calibrated and not _may_differ(layout.by_key[key])
        },
        per_run=own,
        undetermined=undetermined_directions(fit),
        convergence=ended,
        notes=tuple(notes),
        rivals=(found_rival(search, fit, final, added),),
        lateness=late,
    )


def _may_differ(parameter: Parameter) -> bool:
    """Whether a value that data ask for instead of the declared one is no mistake of that."""
    return parameter.assumed or parameter.tolerance > 0.0


def _value_notes(model: Model, fit: Fit, numbers: Sequence[Sequence[str]]) -> list[str]:
    """Say which values the data ask for instead of those that are assumed or declared.

    Args:
        model: as declared. fit: with the values. numbers: keys of each, those of several parts
            together where they were declared as one.
    """
    notes, declared, layout = [], model.vector(), model.plant.layout
    for keys in numbers:
        parameter, places = layout.by_key[keys[0]], [layout.index[key] for key in keys]
        was = float(declared[places[0]])
        now = list(dict.fromkeys(f"{fit.vector[at]:.4g}" for at in places))
        asked = f"the data ask for {' and '.join(now)} {parameter.unit}".rstrip()
        if len(keys) > len(now):
            asked += " of both" if len(keys) == 2 else " of each"
        if all(abs(fit.vector[at] + was) < _OPPOSITE * abs(was) for at in places):
            asked += " (a channel on one side of it has the opposite sign, or it turns backward)"
        names = " and ".join(keys)
        is_, it = ("is", "it") if len(keys) == 1 else ("are", "them")
        said = f"{names} {is_} declared as {was:.4g} {parameter.unit}".rstrip()
        if parameter.assumed:
            note = f"{names} {is_} only assumed in the model; {asked}"
        elif parameter.tolerance:
            note = (
                f"{said}, and not calibrated; {asked}, and parts differ from their sheet by as "
                f"much: list {it} under `calibrate`"
            )
        else:
            note = (
                f"CAUTION: {said}, and not calibrated; {asked}, which explains as much as any "
                f"effect: check {it}, and the scales of the channels on either side of {it}; "
                f"correct {it}, or list {it} under `calibrate`"
            )
        notes.append(note)
    return notes


def _notes_of_other_numbers(search: Search) -> list[str]:
    """Say which other numbers would do about as well, another each, as those that were taken.

    Where everything else is calibrated, a ratio of two areas is told, and not which one is wrong.
    """
    notes, layout = [], search.problem.plant.layout
    added = {item.start.candidate for item in search.accepted}
    for item in search.accepted:
        if not item.start.is_parameter or isinstance(item.start, SheetNumber):
            continue
        others = [
            trial
            for trial in search.look_of(item)
            if trial.start.is_parameter
            and not isinstance(trial.start, SheetNumber)
            and trial.candidate not in added
            and 1.0 - min(trial.comparison.share, trial.comparison.share_out) < ALL_BUT_A_FORM
        ]
        said = [
            " and ".join(
                f"{key} of {trial.fit.vector[layout.index[key]]:.4g} "
                f"{layout.by_key[key].unit}".rstrip()
                for key in trial.start.keys
            )
            for trial in others
        ]
        if said:
            notes.append(
                f"another number explains about as much as {' and '.join(item.start.keys)}: "
                f"{' or '.join(said)}; check them against the drawing"
            )
    return notes


def _notes_of_equal_effects(search: Search) -> list[str]:
    """Say which effects would do as well as a number that is declared wrongly."""
    added = {item.start.candidate for item in search.accepted}
    numbers = [
        item
        for item in search.accepted
        if item.start.is_parameter and not isinstance(item.start, SheetNumber)
    ]
    equal = [[name for name in item.equivalent if name not in added] for item in numbers]
    return [
        f"these data do not distinguish {' and '.join(item.start.keys)} from {' or '.join(names)}: "
        "check the number first; `eha-bench next` looks for an experiment that separates them"
        for item, names in zip(numbers, equal, strict=True)
        if names
    ]


def _notes_of_what_is_small(search: Search) -> list[str]:
    """Say which effects would have been added, were they not smaller than their logs can tell."""
    added = {item.start.candidate for item in search.accepted}
    return [
        f"{name} was not taken for an effect, though it fits best: {why}"
        for name, why in search.too_small.items()
        if name not in added
    ]


def own_estimates(places: Places, values: Mapping[str, Estimate]) -> dict[str, dict[str, Estimate]]:
    """Return run -> parameter of that run alone -> estimate, from estimates by key."""
    found: dict[str, dict[str, Estimate]] = {}
    for item in places.own:
        if item.key in values:
            unit = places.by_key[item.key].unit
            found.setdefault(item.run, {})[item.parameter] = replace(values[item.key], unit=unit)
    return found


def lateness_estimates(places: Places, values: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Return clock -> what its stamps are late by, s, from estimates by key."""
    return {
        item.clock: _later(values[item.key], item.read_earlier)
        for item in places.late
        if item.key in values
    }


def _later(found: Estimate, by: float) -> Estimate:
    """Return by how much stamps are late, s, from what they are beyond what they are read by."""
    return replace(
        found,
        value=found.value + by,
        low=found.low + by,
        high=found.high + by,
        unit=LATENESS.unit,
    )


def lateness_notes(places: Places, lateness: Mapping[str, Estimate]) -> list[str]:
    """Say by how much stamps are late, and where that is the most that they are taken to be."""
    return [
        _lateness_note(item, lateness[item.clock]) for item in places.late if item.clock in lateness
    ]


def _lateness_note(clock: LateClock, found: Estimate) -> str:
    name = " and ".join(f"'{channel}'" for channel in clock.channels or (clock.clock,))
    sign, how = (1.0, "late") if found.value >= 0.0 else (-1.0, "early")
    by = f"{1e3 * abs(found.value):.3g} ms {how}"
    if is_latest(found.value - clock.read_earlier):
        return (
            f"CAUTION: the stamps of {name} are {by}, the most that is looked for: check their "
            "clock against that of the inputs; a lag of what they read may be no more than that"
        )
    half = 0.5e3 * (found.high - found.low)
    if 0.0 < half < np.inf:
        low, high = sorted((1e3 * sign * found.low, 1e3 * sign * found.high))
        digits = int(np.clip(1.0 - np.floor(np.log10(half)), 0, 3))
        value, low_text, high_text = (
            f"{item:.{digits}f}" for item in (1e3 * abs(found.value), low, high)
        )
        by = f"{value} ms {how} ({low_text} to {high_text} ms)"
    text = f"the stamps of {name} are {by} against those of the inputs: "
    text += "a property of the log, not an effect"
    if not clock.read_earlier:
        return text
    when = "earlier" if found.value > 0.0 else "later"
    return f"{text}; they are read that much {when} here: give all topics stamps from one clock"


def _converged_fit(search: Search, decision: Decision) -> ConvergedFit:
    """Return what was decided at the bottom of its cost; a learned curve stays as it is."""
    fit = decision.fit
    if decision.learned:
        return ConvergedFit(fit, {})
    layout = search.problem.plant.layout
    still = {key for key in friction_at_rest_of(layout)
             if fit.vector[layout.index[key]] == 0.0}  # fmt: skip
    free = tuple(item for item in fit.free if item.key not in still)
    return converged_fit(search.problem, replace(fit, free=free))


def _profiles(search: Search, decision: Decision, fit: Fit) -> dict[str, float]:
    """Return the standard deviation of every effect's fitted numbers by profile, SI, by key."""
    if decision.learned:
        return {}
    problem = search.problem.coarser(COARSE, fit.vector, fit.residual)
    begin = spreads(fit, search.groups)
    sought = {key for item in search.effects for key in item.start.keys}
    return {
        item.key: profile_deviation(problem, fit, item.key, begin[item.key].deviation)
        for item in fit.free
        if item.key in sought
    }


def _told_from_nothing(
    search: Search, fit: Fit, values: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return strengths whose interval holds none, by their profile, where that tells them apart."""
    keys = {item.at: item.key for item in fit.free}
    of_each = spreads(fit, search.groups)
    found: dict[str, Estimate] = {}
    for start in (item.start for item in search.effects):
        key = keys.get(start.strength_at, "")
        item = values.get(key)
        if item is None or not item.low <= start.neutral <= item.high:
            continue
        problem = search.problem.coarser(COARSE, fit.vector, fit.residual)
        ends = strength_interval(problem, fit, key, start.neutral, of_each[key].least_fall)
        if ends is not None:
            found[key] = replace(item, low=ends[0], high=ends[1])
    return found


def _numbers(
    effect: BoundEffect,
    keys: tuple[str, ...],
    values: dict[str, Estimate],
    numbers: dict[str, float],
) -> dict[str, Estimate]:
    """What was fitted, with its interval; a count that a scan found is exact."""
    found = {}
    for parameter in effect.parameters:
        key = f"{effect.id}.{parameter.name}"
        if key in keys and key in values:
            found[parameter.name] = values[key]
        elif parameter.name == "count":
            number = numbers[parameter.name]
            found[parameter.name] = Estimate(number, number, number, parameter.unit)
    return found


def _share(search: Search, name: str) -> float:
    """How much an effect explains: the gain when it was added."""
    return next(i.comparison.gain for i in search.effects if i.start.candidate == name)


def _ranking(search: Search) -> tuple[RankLine, ...]:
    """Return what was added, then what was refitted, then the rest, each the best first."""
    lines = []
    size = max(1, search.problem.size)
    order = {name: k for k, name in enumerate(i.start.candidate for i in search.accepted)}
    same = {name for item in search.accepted for name in item.equivalent}
    shares = [min(i.comparison.share, i.comparison.share_out) for i in search.accepted]
    best = max(shares, default=0.0)
    accepted = {item.start.candidate: item.comparison for item in search.accepted}
    others = any(item.refitted for item in search.ranking)
    most = search.thresholds.p_value
    for tried in search.ranking:
        item = tried
        if tried.candidate in accepted:
            # what it was added for, which may be more than it could do as the first one
            found = accepted[tried.candidate]
            share = min(found.share, found.share_out)
            item = replace(tried, score=share, p_value=found.p_value, refitted=True)
        error = float(np.sqrt(max(item.cost, 0.0) / size))
        place = order.get(item.candidate, len(order) + (0 if item.refitted else 1))
        reason = ADDED if item.candidate in order else _why(item, best, most, others=others)
        if item.candidate in same:
            reason = "fits as well as the effect that was added"
        elif item.candidate in search.too_small and item.candidate not in order:
            reason = f"{reason}; {search.too_small[item.candidate]}"
        line = RankLine(item.candidate, item.score, item.p_value, error, reason)
        lines.append((place, -item.score, line))
    return tuple(line for _, _, line in sorted(lines, key=lambda entry: entry[:2]))


def _why(item: RankedCandidate, best: float, most: float, *, others: bool) -> str:
    """Say in words why a candidate was not added.

    Args:
        item: the candidate. best: share that the best one explains. most: probability that a gain
            is an accident, up to which it is believed. others: some were refitted in its place.
    """
    if not item.refitted:
        if item.score < 0.005:
            return "its simulated response does not resemble the residual"
        why = "others promise more, so it was not refitted" if others else "nothing was refitted"
        return (
            f"one simulation predicts that it explains {per_cent(item.score, 1)} of the excess "
            f"error; {why}"
        )
    if item.score <= 0.0:
        return "refitted with all parameters, it is no better on runs left out of the fit"
    behind = f", where the best explains {per_cent(min(best, 1.0), 1)}" if best > item.score else ""
    chance = ""
    if not item.p_value < most:
        chance = f"; by chance with a probability of {item.p_value:.2g}, and {most:g} is asked for"
        if item.score > _MUCH:
            chance += ": it shows in few stretches, and longer or more runs would tell"
    share = per_cent(item.score, 1)
    return f"refitted, it explains {share} of the excess error on runs left out{behind}{chance}"
