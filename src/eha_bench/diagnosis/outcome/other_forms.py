"""The other forms of an effect that fit as well: what one form predicts, another may not.

An effect is a family: friction may be asymmetric where it is dry or where it is viscous, a leak may
drain to the tank or to the reservoir. A search names the effect by the form that fits best.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.fit.least_squares import Fit
from eha_bench.diagnosis.fit.uncertainty import Estimate, estimates
from eha_bench.diagnosis.search.equivalent import is_as_good, tie
from eha_bench.diagnosis.search.forms import meets_a_bound, polished, roughly
from eha_bench.diagnosis.search.refit import at_the_bottom
from eha_bench.diagnosis.search.state import ALL_BUT_A_FORM, Accepted, Search
from eha_bench.plants.layout import Layout

_KEPT = 2
_FURTHER = 3.0
"""Multiple of what a tie may be behind by from which a fit's last steps bring no tie."""


@dataclass(frozen=True)
class OtherForm:
    """A form of an effect that fits as well as the one that was found.

    Attributes:
        words: what differs. fit: with it. sizes: what the effect's numbers are then, by name.
    """

    words: str
    fit: Fit
    sizes: Mapping[str, Estimate]


def other_forms(search: Search, item: Accepted, start: Start, fit: Fit) -> list[OtherForm]:
    """Return the other forms of an effect that fit as well as what was found, the best first.

    One that is far behind after a rough fit is not fitted further.

    Args:
        search: finished. item: what was found. start: of that, or of what stands in its place.
        fit: with it.
    """
    if start.is_parameter:
        return []
    layout, standing = search.problem.plant.layout, replace(item, start=start)
    asked = search.snapshot()
    asked.fit = fit
    asked.accepted = [standing if other is item else other for other in search.accepted]
    own = _form(layout, start, fit.vector)
    near: dict[tuple[tuple[str, str], ...], tuple[Start, Fit]] = {}
    for form, rough in roughly(asked, standing):
        known = _form(layout, form, rough.vector)
        if known != own and rough.cost - fit.cost < ALL_BUT_A_FORM * item.comparison.gain:
            near.setdefault(known, (form, rough))
    little = max(search.thresholds.behind, tie(item.comparison.gain, search.problem.size))
    found = []
    for form, done in polished(asked, standing, list(near.values())[:_KEPT]):
        if done.cost - fit.cost > _FURTHER * little:
            continue
        end = at_the_bottom(search, done)
        good = is_as_good(search, end, search.fit, item.comparison.gain)
        if good and not meets_a_bound(search, form, end):
            differ = [one for one in _form(layout, form, end.vector) if one not in own]
            words = ", ".join(f"{name} {word}" for name, word in differ)
            found.append(OtherForm(words, end, _sizes(search, form, end)))
    return sorted(found, key=lambda form: form.fit.cost)


def _form(layout: Layout, start: Start, vector: FloatArray) -> tuple[tuple[str, str], ...]:
    """Return the words of an effect's form that matter, and where it acts, name by name."""
    effect = layout.effect(start.candidate)
    numbers = {
        item.name: float(vector[layout.index[f"{effect.id}.{item.name}"]])
        for item in effect.parameters
        if item.size == 1
    }
    return (*effect.words_at(numbers).items(), ("at", effect.place(numbers)))


def _sizes(search: Search, start: Start, fit: Fit) -> dict[str, Estimate]:
    """Return an effect's numbers with their intervals, by name."""
    units = search.problem.plant.layout.units_at(fit.vector)
    values = estimates(fit, search.groups, units)
    return {key.rpartition(".")[2]: values[key] for key in start.keys if key in values}
