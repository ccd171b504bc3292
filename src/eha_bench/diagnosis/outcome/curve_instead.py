"""An effect that one unknown law stands for better, alone.

A drag that grows with the cube of the speed leaves less to a torque that saturates than to nothing,
and what that leaves follows the speed. Where an effect leaves a remainder that a curve of one
variable explains at another place, the same curve is fitted without the effect: where it leaves
much less than the effect does, and than the effect explains, the effect only imitated it. A curve
of what remains beside a cause that is there leaves what that explains.

A curve at the effect's own place is its law in another form, as long as the effect leaves no more
than a form does. A valve whose opening grows with the square of its command is no dead band for
that: what is smooth near nothing is all that they share.
"""

from __future__ import annotations

from eha_bench.core.per_cent import per_cent
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.problem import cost_of
from eha_bench.diagnosis.fit.short_windows import aligned_problem
from eha_bench.diagnosis.outcome.confounded import follows_pressure, is_pressure
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.diagnosis.search.backward import without
from eha_bench.diagnosis.search.state import Accepted, Search
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.learn import learn
from eha_bench.plants.effects.learned import KNOTS


def curve_instead(search: Search, left: Remainder, step: float) -> Refusal | None:
    """Return an effect that a curve of what remains beside it stands for, None for none.

    Args:
        search: with it. left: what remains beside the effects, and what that follows.
        step: integration step of the curve's fit, s.
    """
    limits, curve = search.thresholds, left.curve
    if curve is None or not left.variable or search.is_all_but_a_form:
        return None
    asked = [item for item in search.effects if _is_asked(search, item, left)]
    if not asked:
        return None
    long = search.problem.at_step(step)
    long.soft = 1.0

    def beyond_noise(cost: float) -> float:
        return cost - SOFT_MEAN * long.size

    missing = max(beyond_noise(cost_of(long, search.base.vector)), 1.0)
    effects_leave = beyond_noise(cost_of(long, search.fit.vector))
    for item in sorted(asked, key=lambda item: item.comparison.gain):
        fit = search.base if len(search.accepted) == 1 else without(search, item)
        explains = beyond_noise(cost_of(long, fit.vector)) - effects_leave
        curve_leaves = beyond_noise(_with_curve(search, fit, curve, step).cost)
        if curve_leaves < limits.instead * min(effects_leave, explains):
            known, alone = (1.0 - each / missing for each in (effects_leave, curve_leaves))
            return Refusal(
                item,
                f"with it {per_cent(known)} of what is missing is explained, and a curve of "
                f"{left.follows} at '{left.at}' explains {per_cent(alone)} without it",
                imitates=True,
            )
    return None


def _is_asked(search: Search, item: Accepted, left: Remainder) -> bool:
    """Whether what remains beside an effect may be the law that the effect imitates.

    A curve of the pressure that an effect follows is the same cause, however far off its law is.
    """
    limits = search.thresholds
    if item.start.candidate not in left.found_there:
        return left.explained >= limits.nearly_all
    plant = search.problem.plant
    effect = plant.layout.effect(item.start.candidate)
    if follows_pressure(effect) and is_pressure(plant, left.variable):
        return False
    more_than_a_form = left.share > 1.0 - limits.nearly_all
    return more_than_a_form and left.explained >= limits.explained


def _with_curve(search: Search, fit: Fit, curve: LocatedCurve, step: float) -> Fit:
    """Return a fit without the effect with the curve added, and all numbers fitted again."""
    short, _ = aligned_problem(search.problem.at_step(step), fit.vector, KNOTS)
    short.prepare(fit.vector)
    short.scale_to(short.residual(fit.vector))
    return learn(search.problem, short, fit, curve, step)[1]
