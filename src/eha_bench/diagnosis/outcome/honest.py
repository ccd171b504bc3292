"""What a verdict's own figures say against it (contract, section 7).

No effect stands whose strength is at a bound, which runs left out of the fit do not bear out, whose
'before' is not a minimum, or with which held-out or unseen runs are replayed worse than without it.
Refusals are noted, and the others are decided again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import copysign, exp, isfinite, isnan, log, sqrt

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.baseline import COARSE
from eha_bench.diagnosis.fit.beliefs import FAR, contradicted
from eha_bench.diagnosis.fit.candidates import SheetNumber
from eha_bench.diagnosis.fit.evidence import compare, excess
from eha_bench.diagnosis.fit.least_squares import Fit, levenberg_marquardt
from eha_bench.diagnosis.fit.start_angles import is_periodic
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.diagnosis.search.backward import (
    deviations_off,
    drop,
    is_loose,
    is_within_disagreement,
    without,
)
from eha_bench.diagnosis.search.resolution import below_reading
from eha_bench.diagnosis.search.state import Accepted, Search

_MOST = 0.5
"""Share of what is missing that an effect has to explain which bends a law that is declared."""
_NEAR = 1.5
"""Multiple of it up to which a value agrees with it, but for noise."""
_NOT_DISTINCT = (
    "its size is not distinct from zero, and the error without it has no structure in time"
)


def prune(search: Search) -> list[Refusal]:
    """Take out of a search what its own figures speak against; return what, and why.

    What one leaves may take the others to a bound, so these are looked at again. A number of a
    sheet that has moved further than parts differ from theirs by goes without a word.
    """
    for item in list(search.accepted):
        start = item.start
        if isinstance(start, SheetNumber) and not start.is_within(search.fit.vector):
            drop(search, item, without(search, item))
    if not search.effects:
        return []
    _deepen_base(search)
    refused: list[Refusal] = []
    while found := _dropped(search):
        refused += found
    return refused


def _dropped(search: Search) -> list[Refusal]:
    """Take out what the figures speak against as they are; return what, and why."""
    refused = []
    for item in reversed(search.effects):
        refit: Fit | None = None
        reason = _against(search, item) or _part_of_a_form(search, item)
        if not reason and len(search.effects) > 1 and is_loose(search, item):
            refit = without(search, item)
            reason = _beside_others(search, item, refit)
        if not reason and (other := _of_its_kind(search, item)):
            refit = refit or without(search, item)
            reason = _form_of(search, item, other, refit)
        if not reason and contradicted(search.problem.beliefs, search.fit.vector, FAR):
            refit = refit or (without(search, item) if len(search.effects) > 1 else search.base)
            reason = _takes_from_belief(search, refit)
        if reason:
            refused.append(Refusal(item, reason))
            drop(search, item, refit or without(search, item))
    return refused


def against_the_end(search: Search, found: Diagnosis) -> Refusal | None:
    """Return an effect that a finished diagnosis speaks against; None where all stand.

    Args:
        search: with the effects. found: its end, fitted to the bottom of the cost and replayed.
    """
    vector = found.revised.vector()
    for item in search.effects:
        if reason := _beyond(search, item, vector):
            return Refusal(item, reason)
    for item in sorted(search.effects, key=lambda item: item.comparison.gain):
        if len(search.effects) > 1 and _may_be_nothing(search, item, found):
            reason = "its interval holds zero beside the others, and its gain is not clear"
            return Refusal(item, reason)
    least = min(search.effects, key=lambda item: item.comparison.gain, default=None)
    if least is None:
        return None
    if reason := worse(found, search.thresholds):
        return Refusal(least, reason + _of_lost_phase(search, least, vector))
    if reason := _at_no_minimum(search, found):
        return Refusal(least, reason)
    return None


def _at_no_minimum(search: Search, found: Diagnosis) -> str:
    """Say that a fit is on its way, far above the noise, and borne out by no other run; or nothing.

    Of a measured machine much remains, and its cost is rough: there runs that were never fitted
    bear out what was found.
    """
    ended = found.convergence
    if ended is None or ended.converged or found.holdout or found.unseen:
        return ""
    left = search.excess_left
    if not search.thresholds.is_much(left) or search.share_left < search.thresholds.little:
        return ""
    return (
        f"the fit with it is {ended.distance:.2g} standard deviations from a minimum, leaves "
        f"{1.0 + left.relative:.3g} times the noise's mean square, and no run is held out that "
        "would bear it out"
    )


def against_second(search: Search, second: str, found: Diagnosis) -> Refusal | None:
    """Return the second of two causes where runs never fitted do not bear it out.

    They refused the first, which fits as well over windows. What may be chance there
    (`Thresholds.worse`) decides between no two: with the second no error may grow at all.

    Args:
        search: with the effects. second: its id, "" for none. found: the end with it, replayed.
    """
    item = next((one for one in search.effects if one.start.candidate == second), None)
    if item is None or not (reason := worse(found, replace(search.thresholds, worse=1.0))):
        return None
    return Refusal(item, reason)


def _of_lost_phase(search: Search, item: Accepted, vector: FloatArray) -> str:
    """Say what windows hold for what follows an angle that nothing reads, or nothing."""
    layout = search.problem.plant.layout
    effect = layout.effect(item.start.candidate)
    if not is_periodic(effect):
        return ""
    if any(spot.angle for spot in effect.spots_at(layout.choice_values(effect, vector))):
        return ""
    if all(window.measured.turning for window in search.problem.windows):
        # whole runs follow what the measured speed adds up to
        return ""
    share = min(item.comparison.share, item.comparison.share_out, 1.0)
    return (
        f"; over windows it explains {per_cent(max(share, 0.0))}, but over a whole run a small "
        "error of the speed loses its phase: log that speed, or the angle that it follows"
    )


def _may_be_nothing(search: Search, item: Accepted, found: Diagnosis) -> bool:
    """Whether neither an effect's interval nor its gain tells it from nothing.

    Where runs disagree, an interval may be wide though every one of them gains: the gain decides.
    """
    start = item.start
    effect = search.problem.plant.layout.effect(start.candidate)
    estimates = (one.parameters for one in found.effects if one.id == start.candidate)
    size = next(estimates, {}).get(effect.strength.name)
    if size is None or not (isfinite(size.low) and isfinite(size.high)):
        return False
    unclear = not item.comparison.p_value < search.thresholds.p_clear
    return unclear and size.low <= start.neutral <= size.high


def _beyond(search: Search, item: Accepted, vector: FloatArray) -> str:
    """Say that an effect is at a bound, or what it changes beyond what is believed, or nothing."""
    return (
        _at_bound(search, item, vector)
        or below_reading(search, item.start, vector)
        or _beyond_belief(search, item, vector)
        or _part_of_a_law(search, item, vector)
        or _in_no_such_machine(search, vector)
    )


def _part_of_a_law(search: Search, item: Accepted, vector: FloatArray) -> str:
    """Say that what bends a declared law leaves most of what is missing, or nothing.

    A friction that falls at low speed is also what a drag, or one friction in each direction, looks
    like in part; where it is what is missing it leaves little.
    """
    layout = search.problem.plant.layout
    effect = layout.effect(item.start.candidate)
    share = min(item.comparison.share, item.comparison.share_out)
    if effect.needed(layout.choice_values(effect, vector)) is None or share >= _MOST:
        return ""
    return (
        f"it explains only {per_cent(max(share, 0.0))} of what is missing: "
        "another law than the one it bends would do as well"
    )


def _beyond_belief(search: Search, item: Accepted, vector: FloatArray) -> str:
    """Say that what an effect is added to is no longer what was declared, or nothing.

    An excess over a level that the fit has taken away is another law by this one's name: a drag
    that grows with the square of the speed, where that level is lower and the viscous part higher.
    """
    problem = search.problem
    layout = problem.plant.layout
    effect = layout.effect(item.start.candidate)
    needed = effect.needed(layout.choice_values(effect, vector))
    for belief in contradicted(problem.beliefs, vector, FAR):
        if belief.key == needed:
            now, unit = float(vector[belief.at]), layout.units_at(vector)[belief.key]
            return (
                f"with it, {belief.key} would be {now:.4g} {unit}, which is far from what is "
                f"believed of it, {belief.value:.4g} {unit}"
            )
    return ""


def _at_bound(search: Search, item: Accepted, vector: FloatArray) -> str:
    """Say that an effect's strength, or what was measured of it, stands at a bound, or nothing."""
    bound = item.start.bound_met(vector)
    if bound is not None:
        return f"its strength is at its bound, {bound:.4g}"
    if item.start.is_off(vector):
        return "fitted to the end it does nothing"
    reached = search.problem.places.bound_met(item.start.keys, vector)
    if reached is None:
        return ""
    key, most = reached
    layout = search.problem.plant.layout
    effect = layout.effect(item.start.candidate)
    name = key.removeprefix(f"{effect.id}.")
    unit = effect.parameter_at(name, layout.choice_values(effect, vector)).unit
    return f"its {name} is at the bound that the recordings set, {most:.4g} {unit}"


def _against(search: Search, item: Accepted) -> str:
    """Say what speaks against an effect that was added, or nothing."""
    found, limits = item.comparison, search.thresholds
    if reason := _beyond(search, item, search.fit.vector):
        return reason
    if found.explained_out <= 0.0 or found.gain_out <= 0.0:
        return "it explains nothing on runs left out of the fit"
    if found.p_value > limits.likely:
        return f"its gain may be chance (p {found.p_value:.2g})"
    missing = search.excess_base
    may_be_level = not (limits.has_structure(missing) or limits.is_much(missing))
    if may_be_level and not (
        limits.is_clear(found, missing.size) or _deviations_off(search, item) > limits.clear
    ):
        return _NOT_DISTINCT
    if len(search.effects) == 1 and not limits.is_enough(found, missing, 0):
        share = max(min(found.share, found.share_out), 0.0)
        return f"it explains only {per_cent(share)} of the error without it"
    return ""


def _deviations_off(search: Search, item: Accepted) -> float:
    """Return how many standard deviations an effect is from none.

    By its strength, or by its gain where that one is not determined: of two lags in a row either
    may be the one that is there.
    """
    off = deviations_off(search, item.start)
    return off if off > 0.0 else sqrt(max(item.comparison.gain, 0.0))


def _part_of_a_form(search: Search, item: Accepted) -> str:
    """Say that an effect takes only a part of the little that others leave, or nothing.

    However it was found: what takes less than most of that is more likely how their laws bend.
    """
    found = item.comparison
    before = found.gain / max(found.share, 1e-12) / max(search.excess_base.total, 1.0)
    if len(search.effects) < 2 or not search.thresholds.is_part_of_a_form(found, before):
        return ""
    share = max(min(found.share, found.share_out), 0.0)
    return (
        f"it takes {per_cent(share)} of the {per_cent(before, 1)} that the other causes leave: "
        "more likely the form of their laws"
    )


def _beside_others(search: Search, item: Accepted, refit: Fit) -> str:
    """Say why the others do as well without an effect that is not sure, or nothing.

    Args:
        search: with it. item: the effect. refit: without it.
    """
    if is_within_disagreement(search, item, refit.cost - search.fit.cost):
        return "without it the others explain as much, within what runs disagree by"
    limits, missing = search.thresholds, excess(search.problem, refit)
    found = compare(refit, search.fit, search.groups, missing.total)
    if (
        limits.is_unexplained(missing)
        or limits.is_clear(found, missing.size)
        or deviations_off(search, item.start) > limits.clear
    ):
        return ""
    return _NOT_DISTINCT


def _of_its_kind(search: Search, item: Accepted) -> Accepted | None:
    """Return another effect that changes the same term at the same place, None for none."""

    def acts_on(one: Accepted) -> frozenset[str]:
        layout = search.problem.plant.layout
        effect = layout.effect(one.start.candidate)
        spots = effect.spots_at(layout.choice_values(effect, search.fit.vector))
        names = effect.action.hooks
        return frozenset(hook.at for spot in spots for name in names for hook in spot.hooks[name])

    own = acts_on(item)
    others = [one for one in search.effects if one is not item]
    # a relief valve may drain to a tank as well, a lopsided friction may be viscous
    return next(
        (one for one in others if own and (own <= acts_on(one) or own >= acts_on(one))), None
    )


def _form_of(search: Search, item: Accepted, other: Accepted, refit: Fit) -> str:
    """Say that what another effect leaves alone is no second cause but its form, or nothing.

    What describes with more numbers what the other does (a valve that opens at a low pressure, and
    a leak) is its form as long as it takes little of all that is missing.

    Args:
        search: with both. item: that is asked for. other: the effect. refit: without `item`.
    """
    limits = search.thresholds
    left = max(excess(search.problem, refit).total, 0.0)
    share = left / max(other.comparison.gain, 1.0)
    alike = search.problem.plant.layout.effect(item.start.candidate).effect.yields_to
    if alike == other.start.candidate:
        share = min(share, left / max(search.excess_base.total, 1.0))
    if not share < (limits.behind_share if alike == other.start.candidate else limits.form):
        return ""
    return (
        f"{other.start.candidate} changes the same term, and explains all but "
        f"{per_cent(share, 2)} without it: more likely the law of that one has another form"
    )


def _takes_from_belief(search: Search, refit: Fit) -> str:
    """Say which parameter an effect takes far from what is believed of it, or nothing.

    What two can only do together is a trade: all pressures read too low, and a reservoir charged by
    as much more than it was declared to be. So is what takes a parameter as far away as before, on
    the other side: iron that saturates, of a motor that warms up. What explains nearly all by
    itself is there, whatever its law leaves to the parameters.

    Args:
        search: with the effect. refit: without it.
    """
    if refit.cost - search.fit.cost >= search.thresholds.nearly_all * search.excess_base.total:
        return ""
    for belief in contradicted(search.problem.beliefs, search.fit.vector, FAR):
        now, then = (float(fit.vector[belief.at]) for fit in (search.fit, refit))
        side = copysign(1.0, now - belief.value)
        if side * (then - belief.value) <= _NEAR * belief.within:
            unit = search.problem.plant.layout.units_at(search.fit.vector)[belief.key]
            return (
                f"with it, {belief.key} is {now:.4g} {unit}, without it {then:.4g} {unit}, and "
                f"{belief.value:.4g} {unit} is what is believed of it"
            )
    return ""


def _in_no_such_machine(search: Search, vector: FloatArray) -> str:
    """Say that a fit with causes leaves hardly a number near what is believed of it, or nothing.

    Where these leave something as well, they only imitate it together with the parameters: a servo
    whose reference moves at most so fast, as a soft joint with an eccentric encoder and 20 times
    the friction. What leaves nothing may be of a machine that was declared by guesses.
    """
    beliefs = search.problem.beliefs
    far = contradicted(beliefs, vector, FAR)
    if len(far) < 2 or 2 * len(far) <= len(beliefs) or not search.is_unexplained:
        return ""
    units = search.problem.plant.layout.units_at(vector)
    values = ", ".join(
        f"{item.key} {vector[item.at]:.4g} for {item.value:.4g} {units[item.key]}" for item in far
    )
    return (
        f"with it, {len(far)} of {len(beliefs)} parameters are far from what is believed of them "
        f"({values}), and something is missing still: they imitate it together"
    )


def _deepen_base(search: Search) -> None:
    """Begin the fit without any effect where the one with them has ended, too.

    It may have been caught where it began, and a better place would take from what effects gain.
    """
    vector = search.fit.vector
    for item in search.accepted:
        vector = item.start.off(vector)
    coarse = search.problem.at_step(max(search.problem.step, COARSE))
    other = levenberg_marquardt(coarse, vector, search.base.free, iterations=6, refresh=1)
    if other.cost > search.base.cost - search.thresholds.gain:
        return
    other = levenberg_marquardt(
        search.problem, other.vector, search.base.free, iterations=4, known=other.columns, refresh=0
    )
    if other.cost > search.base.cost - search.thresholds.gain:
        return
    search.base, search.excess_base = other, excess(search.problem, other)
    if len(search.accepted) == 1:
        item = search.accepted[0]
        found = compare(other, search.fit, search.groups, search.excess_base.total)
        search.accepted = [replace(item, comparison=found)]


def worse(found: Diagnosis, limits: Thresholds) -> str:
    """Say on which runs the revised model is worse than the recalibrated one, or nothing."""
    for kind, errors in (("held-out", found.holdout), ("unseen", found.unseen)):
        ratio = max(growth(errors), growth_of_each(errors))
        if ratio > limits.worse:
            by = f"{ratio:.3g} times" if isfinite(ratio) else "without end"
            return f"with it the error of whole replays of {kind} runs grows, {by}"
    return ""


def growth(errors: Mapping[str, ChannelError]) -> float:
    """Return the error of whole replays after over that before, over all channels in their noise.

    Where one standard deviation of the first sample moves a replay by more than its noise, that is
    the measure.
    """
    before = after = 0.0
    for item in _counted(errors):
        before += (item.before / item.replay_floor) ** 2
        after += (item.after / item.replay_floor) ** 2
    known = isfinite(before) and before > 0.0 and not isnan(after)
    return sqrt(after / before) if known else 1.0


def growth_of_each(errors: Mapping[str, ChannelError]) -> float:
    """Return the geometric mean of what the channels' errors grow by, each counting alike.

    A position that drifts by hundreds of its noise drowns pressures in the sum, whose errors may
    grow by half meanwhile. Below its noise no error counts as grown.
    """
    logs = [
        log(max(item.after, item.replay_floor) / max(item.before, item.replay_floor))
        for item in _counted(errors)
        if isfinite(item.before) and isfinite(item.after)
    ]
    return exp(sum(logs) / len(logs)) if logs else 1.0


def _counted(errors: Mapping[str, ChannelError]) -> list[ChannelError]:
    """Return errors of channels that are their own, with what noise makes of a replay."""
    twice = {"pressure_a", "pressure_b"} <= errors.keys()
    return [
        item
        for name, item in errors.items()
        if item.replay_floor > 0.0 and not (twice and name == "pressure_difference")
    ]


def curve_is_worse(found: Diagnosis, limits: Thresholds) -> str:
    """Say on which runs a learned curve makes the errors larger, or nothing.

    Runs that were never fitted count as they do for an effect; else all have to be worse.
    """
    if why := worse(found, limits):
        return why
    groups = [group for group in (found.train, found.holdout, found.unseen) if group]
    if groups and all(growth(group) > 1.0 for group in groups):
        return "with it the errors of fitted and of held-out runs both grow"
    return ""
