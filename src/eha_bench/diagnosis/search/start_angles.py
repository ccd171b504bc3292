"""Lets runs begin at different angles, where effects of the shaft's angle show only that way.

The scan says what a count gains with one phase, and with a phase in each run. Where the latter
explain significantly more than any count does with one phase, the best few are fitted over short
windows, each with the angles that its phases make. If these explain clearly more than the best one
with a common phase, the angles become part of the data, and the search goes on as it would have,
with one phase for all runs. Angles mean nothing to what does not turn: no other fit is touched.

What else is missing makes chance gain more than noise would: as much more as what is left is more
than noise (quasi-likelihood: Wedderburn, Biometrika 61 (1974) 439, doi:10.1093/biomet/61.3.439).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from eha_bench.diagnosis.data.start_angle import StartAngle
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.side_by_side import side_by_side
from eha_bench.diagnosis.fit.start_angles import (
    angles_of,
    begin_apart,
    counts_on,
    estimated_angles,
    starts_of,
    with_refined_angles,
)
from eha_bench.diagnosis.search.periodic import Wave, best_counts
from eha_bench.diagnosis.search.refit import Near, Nearby
from eha_bench.diagnosis.search.state import Search

_MOST = 0.5
"""Share of what the short windows hold that runs set apart have to explain: phases that are free
follow something larger that is missing instead, above all where the shaft hardly turns."""
_THROUGHOUT = 0.75
"""Share of what phases of each half of a run explain that those of whole runs have to: how far the
shaft turns from one half to the other is measured."""
_TRIED = 3
_ROUNDS = 2

Starts = Mapping[str, StartAngle]


def with_own_angles(search: Search, near: Near, starts: Sequence[Start]) -> Near:
    """Return the search over short windows with runs that begin where the data ask for.

    Where they do, the search's own problem begins there as well.

    Args:
        search: so far. near: its short windows. starts: of what is periodic in the shaft's angle.
    """
    if counts_on(search.problem.plant.layout, search.fit.vector):
        # effects of the angle already determine where runs begin
        return near
    waves = near.waves(starts)
    more = len(angles_of(near.problem)) - 1
    if not waves or more < 1:
        return near
    pairs = [(wave, wave.with_lead_angles(wave.lead_angles())) for wave in waves]
    pairs = [pair for pair in pairs if _is_an_angle(*pair, near.excess)]
    pairs.sort(key=lambda pair: -pair[1].gain)
    best = max((apart.gain for _, apart in pairs), default=0.0)
    common = max(wave.gain for wave in waves)
    level = max(1.0, 1.0 + (near.excess - best) / near.floor)
    if not begin_apart(common, best, more, level=level, tries=len(waves)):
        return near
    tried = side_by_side(lambda pair: _fit_phases(near, *pair), pairs[:_TRIED])
    angles, found = min(tried, key=lambda item: item[1].fit.cost)
    beside = best_counts(waves)[0]
    alike = near.fit_together((beside,), beside.apply(near.fit.vector))
    apart, common = near.gain(found), near.gain(alike)
    if not begin_apart(common, apart, more, level=level):
        return near
    # a run whose windows all began wrongly has had no say
    unseen = angles_of(search.problem).keys() - angles_of(near.problem).keys()
    if unseen:
        others = estimated_angles(search.problem, found.fit.vector)
        angles = {**angles, **{name: others[name] for name in sorted(unseen & others.keys())}}
    return near.adopt_angles(angles)


def _is_an_angle(wave: Wave, apart: Wave, excess: float) -> bool:
    """Whether a phase in each run explains most of an excess, and holds all through its run."""
    return apart.gain > max(_MOST * excess, _THROUGHOUT * wave.gain_in_halves())


def _fit_phases(near: Near, wave: Wave, apart: Wave) -> tuple[Starts, Nearby]:
    """Return where runs begin, and a fit there, for the phases that one count has in each run."""
    before = angles_of(near.problem)
    starts = {
        name: StartAngle(before[name] + turn, 1.0 / wave.count)
        for name, turn in wave.lead_angles().items()
    }
    here = near.at_angles(starts)
    found = here.fit_together((apart.start,), apart.start.apply(near.fit.vector))
    for _ in range(_ROUNDS):
        here = near.at_angles(starts_of(with_refined_angles(here.problem, found.fit.vector)))
        found = here.fit_together(found.starts, found.fit.vector, found.fit.columns)
    return starts_of(here.problem), found
