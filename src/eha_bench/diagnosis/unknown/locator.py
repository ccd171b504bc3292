"""Where something acts that no known effect explains, and what it depends on.

In windows of 0.1 s, each from its own start state, an error cannot travel far from the balance it
enters. At every place (each balance, each sensor) an input is offered that is free at every time;
what speaks for it is weighed by its marginal likelihood (`free_input`), and again with most of it
following a curve of one variable, simulated. A fault in a sensor does not propagate: it is found
only where a free error of that sensor leaves nothing in any other channel (the generalised observer
scheme: Frank, Automatica 26 (1990) 459, doi:10.1016/0005-1098(90)90018-D). Then curves of one
variable (hat functions as the effect `learned` has them; for the time also a sine and its second
harmonic at any frequency) describe what acts there, by what they explain on runs left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.baseline import SCREENING
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN
from eha_bench.diagnosis.fit.least_squares import Fit, jacobian, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem, soften
from eha_bench.diagnosis.fit.short_windows import aligned_problem
from eha_bench.diagnosis.fit.side_by_side import PROCESSORS, side_by_side
from eha_bench.diagnosis.unknown.curves import Curves, LocatedCurve
from eha_bench.diagnosis.unknown.free_input import KNOTS, FreeInput, Support
from eha_bench.diagnosis.unknown.places import (
    SuspectPlace,
    Template,
    curve_on,
    places_of,
    usual_size,
)
from eha_bench.plants.effects.learned import KNOTS as CURVE_KNOTS

_ROUNDS = 3
_SETTLED = 0.01
_IN_THE_RACE = 0.6
"""Share of the best place's support from which another one's curve may still overtake it."""
_RIVALS = 3
"""Places of one equation of which curves are simulated: a sensor, its twin, and both alike."""
_AS_GOOD = 0.9
"""Share of the best one's support, or of what its curve explains, that counts as equal."""
_CLEARLY = 0.02
"""Share of a balance's support by which a sensor has to exceed it: models are never quite right."""
_LEAST = 10.0
"""And at least this log likelihood ratio; 5 is very strong for right models (Kass, Raftery, J. Am.
Stat. Assoc. 90 (1995) 773, doi:10.1080/01621459.1995.10476572)."""
_COMPLETE = 0.15
"""Share of other channels' excess that a sensor's error may leave: an input through instants 9 ms
apart leaves that much of jumps."""
_SMALLEST = 0.03
"""Excess of other channels, in the noise's cost, of which shares are taken at least."""
_OWN = 0.3
"""Share of its own channels' excess that a sensor's error may leave: a free error of a sensor can
be whatever that sensor reads, and where it still leaves more, what goes on is faster than samples.
"""
_FAR_AHEAD = 1.3
"""Multiple of the best balance's support from which a sensor is believed that explains its channels
and the others for the most part: a play or a jump of its own leaves more than `_COMPLETE`."""
_MOST = 0.6
"""Share of any channels' excess that it may leave then."""
_FURTHEST = 0.3
_TELLING = 0.1
"""Share of the excess from which what a curve follows means anything."""

_VOLUMES = SuspectPlace("flow", "additive", "volumes", ())
"""All volumes, each with its own input: to be weighed, not to be described."""


@dataclass(frozen=True, eq=False)
class SupportedPlace:
    """A place with what speaks for it.

    Attributes:
        place: where. size: of one unit of the input, SI. influence: (N, KNOTS) of its instants.
        free: support of an input that follows nothing.
        support: log likelihood above that of nothing acting, by a curve where that is more.
        left: what stays, as a share, of the excess in the channels that its sensors do not read.
        own_left: the same of the channels that its sensors read.
    """

    place: SuspectPlace
    size: float
    influence: FloatArray
    free: Support
    support: float
    left: float
    own_left: float

    @property
    def is_a_sensors_fault(self) -> bool:
        """Whether a free error of its sensors explains them, and leaves nothing elsewhere."""
        return bool(self.place.sensors) and self.left < _COMPLETE and self.own_left < _OWN

    @property
    def is_mostly_a_sensors_fault(self) -> bool:
        """Whether a free error of its sensors explains most of what shows, there and elsewhere."""
        return bool(self.place.sensors) and max(self.left, self.own_left) < _MOST


class Locator:
    """Weighs every place over short windows.

    Args:
        problem: the long problem, for its runs and noise.
        fit: the best that is known. step: integration step, s.
    """

    def __init__(self, problem: Problem, fit: Fit, step: float) -> None:
        self.plant = problem.plant
        self.short, self.period = aligned_problem(problem.at_step(step), fit.vector, CURVE_KNOTS)
        free = tuple(item for item in fit.free if "[" not in item.key)
        self.short.prepare(fit.vector)
        self.short.scale_to(self.short.residual(fit.vector))
        # over long windows the parameters had been bent to imitate what acts
        near = levenberg_marquardt(self.short, fit.vector, free, iterations=4, refresh=1)
        self.vector, self.free = near.vector, near.free
        self.short.prepare(self.vector)
        self.base = self.short.residual(self.vector)
        self.short.scale_to(self.base)
        self.limit = 1e3 * self.short.soft
        # only changes by what acts count
        self.rough = self.short.at_step(SCREENING)
        self.rough_base = self.rough.residual(self.vector)
        self.matrix = jacobian(self.rough, self.vector, self.free, self.rough_base)
        self.input = FreeInput(self.short, self.base, self.matrix)
        self.nothing = self.input.nothing
        here = replace(near, residual=self.base, jacobian=self.matrix, soft=self.short.soft)
        self.curves = Curves(self.short, self.period, here)
        self.channels = np.concatenate([piece.channels for piece in self.short.pieces])
        self.near: tuple[str, ...] = ()
        """Balances that nearly as much speaks for as for the believed one, and that one."""

    def supported_places(self, progress: ProgressHook) -> list[SupportedPlace]:
        """Return every place that can act at all, the one with most support first."""
        places = [
            place
            for place in places_of(self.plant)
            if all(name in self.short.noise for name in place.sensors)
        ]
        found: list[SupportedPlace] = []
        for number in range(0, len(places), PROCESSORS):
            progress("locate", number / len(places))
            several = side_by_side(self._supported, places[number : number + PROCESSORS])
            found += [item for item in several if item is not None]
        own = set(self.plant.roles.volumes)
        volumes = [item for item in found if item.place.at in own]
        if len(volumes) > 1:
            together = np.hstack([item.influence for item in volumes])
            found.append(self._support_of(_VOLUMES, 1.0, together))
        return sorted(self._with_curves(found), key=lambda item: -item.support)

    def _supported(self, place: SuspectPlace) -> SupportedPlace | None:
        """Return a place with what speaks for it, None where it does not act at all."""
        size = usual_size(place, self.plant, self.short.noise, self.curves.span)
        influence = self._influence(place, size)
        acts = float(np.abs(influence).max()) > 1e-6
        return self._support_of(place, size, influence) if acts else None

    def _influence(self, place: SuspectPlace, size: float) -> FloatArray:
        """Return the change of the residual by the input's value at each instant, (N, KNOTS)."""
        centres = np.linspace(0.0, CURVE_KNOTS - 2.0, KNOTS)
        template = Template(place.equation, place.form, place.at, "time")
        columns = []
        for k in range(KNOTS):
            hat = np.interp(np.arange(float(CURVE_KNOTS)), centres, np.eye(KNOTS)[k])
            # the last knot lies between a window and the next
            hat[-1] = 0.0
            vector = curve_on(self.plant, self.vector, template, 0.0, 1.0, hat * size, self.period)
            change = self.rough.residual(vector) - self.rough_base
            columns.append(np.clip(change, -self.limit, self.limit))
        return np.column_stack(columns)

    def _support_of(
        self, place: SuspectPlace, size: float, influence: FloatArray
    ) -> SupportedPlace:
        free = self.input.support(influence)
        return SupportedPlace(
            place,
            size,
            influence,
            free,
            free.log - self.nothing,
            *self._remaining_excess(place, free.rest),
        )

    def _remaining_excess(self, place: SuspectPlace, rest: FloatArray) -> tuple[float, float]:
        """Return what stays of the excess, as shares: where no sensor's fault reaches, and there.

        No other channel bears a sensor's fault out: 1.
        """
        names = self.plant.outputs
        own = np.isin(self.channels, [names.index(name) for name in place.sensors])
        soft, _ = soften(self.curves.before.residual, self.short.soft)
        shares = []
        for rows in (~own, own):
            count = float(np.count_nonzero(rows))
            floor = SOFT_MEAN * count
            before = float(soft[rows] @ soft[rows]) - floor
            # squares of so many standard normal numbers scatter by the root of twice their count
            after = float(rest[rows] @ rest[rows]) - floor - 2.0 * math.sqrt(2.0 * count)
            shares.append(max(after, 0.0) / max(before, _SMALLEST * floor) if count else 1.0)
        return shares[0], shares[1]

    def _with_curves(self, found: list[SupportedPlace]) -> list[SupportedPlace]:
        """Simulate curves where more than one equation is in the race."""
        found.sort(key=lambda item: -item.support)
        top = found[0].support if found else 0.0
        race = [item for item in found if item.support > _IN_THE_RACE * top]
        if len({item.place.equation for item in race}) < 2:
            return found
        best: dict[tuple[str, str], tuple[SupportedPlace, Support, str]] = {}
        for item, predicted in zip(race, side_by_side(self._predicted_curve, race), strict=True):
            key = item.place.equation, item.place.at
            # forms at one place differ little: only the better one's curve is simulated
            if predicted is not None and (key not in best or predicted[0].log > best[key][1].log):
                best[key] = (item, *predicted)
        asked: list[tuple[SupportedPlace, Support, str]] = []
        counts: dict[str, int] = {}
        for rival in best.values():
            equation = rival[0].place.equation
            if counts.get(equation, 0) < _RIVALS:
                counts[equation] = counts.get(equation, 0) + 1
                asked.append(rival)
        curves = side_by_side(lambda rival: self._with_curve(*rival), asked)
        simulated = {item.place: item for item in curves}
        return [simulated.get(item.place, item) for item in found]

    def _predicted_curve(self, item: SupportedPlace) -> tuple[Support, str] | None:
        """Return what speaks for a place's best curve to first order, and its variable."""
        best: tuple[Support, str] | None = None
        for variable in item.place.variables:
            if self.curves.varies(variable):
                curve = self.curves.columns(item.influence, variable)
                support = self.input.support_of_curve(item.influence, curve, item.free)
                if best is None or support.log > best[0].log:
                    best = support, variable
        return best

    def _with_curve(self, item: SupportedPlace, found: Support, variable: str) -> SupportedPlace:
        """Return a place with what speaks for a curve, simulated, where that is more."""
        knots = self.curves.knots(variable)
        template = Template(item.place.equation, item.place.form, item.place.at, variable)
        p = len(self.free)
        vector = self.vector
        amplitudes = np.zeros(knots.size)
        for _ in range(_ROUNDS):
            vector = self._vector_after(vector, found.step[:p])
            amplitudes = found.step[p:]
            again = self._simulated_support(item, template, vector, knots, amplitudes)
            last, found = found.log, again
            if found.log - self.nothing > item.support:
                left, own_left = self._remaining_excess(item.place, found.rest)
                item = replace(item, support=found.log - self.nothing, left=left, own_left=own_left)
            if abs(found.log - last) < _SETTLED * abs(found.log - self.nothing):
                break
        return item

    def _simulated_support(
        self,
        item: SupportedPlace,
        template: Template,
        vector: FloatArray,
        knots: FloatArray,
        amplitudes: FloatArray,
    ) -> Support:
        """Return what speaks for a curve from a simulation with it on."""

        def on(values: FloatArray) -> FloatArray:
            fine = np.interp(np.linspace(knots[0], knots[-1], CURVE_KNOTS), knots, values)
            return curve_on(
                self.plant, vector, template, float(knots[0]), float(knots[-1]), fine * item.size
            )

        residual = self.short.residual(on(amplitudes))
        rough = self.rough.residual(on(amplitudes))
        matrix = jacobian(self.rough, on(amplitudes), self.free, rough)
        reach = max(1.0, 0.1 * float(np.abs(amplitudes).max()))
        columns = []
        for k in range(knots.size):
            change = self.rough.residual(on(amplitudes + reach * np.eye(knots.size)[k])) - rough
            columns.append(np.clip(change, -self.limit, self.limit) / reach)
        here = FreeInput(self.short, residual, matrix)
        return here.support_of_curve(
            item.influence, np.column_stack(columns), item.free, amplitudes
        )

    def _vector_after(self, vector: FloatArray, step: FloatArray) -> FloatArray:
        out = vector.copy()
        for item, share in zip(self.free, np.clip(step, -_FURTHEST, _FURTHEST), strict=True):
            out[item.at] = min(max(out[item.at] + float(share) * item.scale, item.low), item.high)
        return out

    def best_curves(self, offered: Sequence[SupportedPlace]) -> list[LocatedCurve]:
        """Return curves of one variable at some places, the one that explains most first."""
        asked = [
            (item, variable)
            for item in offered
            for variable in item.place.variables
            if self.curves.varies(variable)
        ]
        found = side_by_side(
            lambda one: self.curves.best_curve(one[0].place, one[1], one[0].influence, one[0].size),
            asked,
        )
        found.sort(key=lambda located: -located.share)
        # a curve of the time can follow a little of anything
        telling = [
            item for item in found if item.template.variable != "time" or item.share > _TELLING
        ]
        return telling or found


def locate(
    problem: Problem, fit: Fit, step: float, progress: ProgressHook
) -> tuple[Locator, str, list[LocatedCurve]]:
    """Return the equation that is short, and curves in it, the one that explains most first.

    The equation is empty where nothing can act at all; there are no curves where no variable that
    they could depend on is measured.
    """
    locator = Locator(problem, fit, step)
    offered = locator.supported_places(progress)
    if not offered:
        return locator, "", []
    believed = believed_place(offered)
    best = believed.place.equation
    locator.near = near_balances(offered, believed)
    curves = described_places(locator, offered)
    return locator, curves[0].template.equation if curves else best, curves


def near_balances(offered: Sequence[SupportedPlace], believed: SupportedPlace) -> tuple[str, ...]:
    """Return the balances that nearly as much speaks for as for a place, its own among them.

    Args:
        offered: places, that with most support first. believed: the one that is named.
    """
    near = [item for item in offered if item.support > _AS_GOOD * believed.support]
    return tuple(dict.fromkeys(item.place.equation for item in near if not item.place.sensors))


def described_places(locator: Locator, offered: Sequence[SupportedPlace]) -> list[LocatedCurve]:
    """Return curves at the places that may be meant by the one that is believed."""
    best = believed_place(offered)
    kind = bool(best.place.sensors)
    near = [
        item
        for item in offered
        if item.support > _AS_GOOD * best.support and bool(item.place.sensors) is kind
    ]
    drive = [item for item in near if item.place.equation == "actuation"]
    own = [item for item in near if item.place.equation == best.place.equation]
    machine = [item for item in near if item not in drive] if best in drive else own
    # both chambers at once have no curve: each of them has
    anywhere = [item for item in offered if item.place.equation == best.place.equation]
    return by_what_it_follows(
        locator.best_curves(drive),
        locator.best_curves(machine) or ([] if best in drive else locator.best_curves(anywhere)),
        best.place,
    )


def by_what_it_follows(
    driven: list[LocatedCurve], machine: list[LocatedCurve], best: SuspectPlace
) -> list[LocatedCurve]:
    """Return the drive's curves where what acts follows time or command, else the machine's.

    The torque of motor and pump enter one balance, and no sensor lies between them. Mechanics and
    oil do not know the time, nor what the drive was asked for; whoever drives them does. So the
    drive's curve has to explain as much as the machine's: a command that nearly goes with the speed
    explains nearly as much, so all of it where the machine is believed and follows what it knows.
    Or anything, where the drive is believed and the best that the machine could do instead is what
    it cannot: follow the time.
    """
    if not driven or not machine:
        return driven or machine
    own, theirs = driven[0].template.variable, machine[0].template.variable
    ours = best.equation == "actuation"
    least = _AS_GOOD * machine[0].share
    if theirs == "time" and ours:
        least = 0.0
    elif not ours and "time" not in (own, theirs) and own != theirs:
        least = machine[0].share
    return driven if driven[0].share > max(least, _TELLING) else machine


def believed_place(offered: Sequence[SupportedPlace]) -> SupportedPlace:
    """Return the place with most support; a sensor only where the case against it is complete.

    A free error of a sensor can hide what shows in that sensor only, wherever it comes from.
    """
    balances = [item for item in offered if not item.place.sensors]
    best = offered[0]
    if not balances or not best.place.sensors:
        return best
    support = balances[0].support
    clear = support + max(_LEAST, _CLEARLY * support)
    far = max(clear, _FAR_AHEAD * support)
    sensors = [
        item
        for item in offered
        if (item.is_a_sensors_fault and item.support > clear)
        or (item.is_mostly_a_sensors_fault and item.support > far)
    ]
    return sensors[0] if sensors else balances[0]
