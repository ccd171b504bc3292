"""Intervals of sizes over all forms of a law that fit as well.

An interval of a fit holds the truth where the law is right. Where data do not tell a law from its
other forms (air that is compressed as an ideal gas, or by a polytrope), a size is as open as they
differ: its interval spans those of all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, FoundEffect
from eha_bench.diagnosis.outcome.other_forms import OtherForm

_WIDER = 1.1
"""Multiple of its width from which an interval is another one."""


def with_sizes_over_forms(found: Diagnosis, forms: Mapping[str, Sequence[OtherForm]]) -> Diagnosis:
    """Return a diagnosis whose intervals span those of all forms that fit as well, and says so.

    Args:
        found: with an interval for each number, or without: then it stays as it is.
        forms: effect -> its other forms that fit as well.
    """
    effects, notes = [], []
    for effect in found.effects:
        others = forms.get(effect.id, ())
        spanned = {name: _span(name, own, others) for name, own in effect.parameters.items()}
        wider = [name for name, own in effect.parameters.items() if spanned[name] is not own]
        if wider:
            effects.append(replace(effect, parameters=spanned))
            notes.append(_note(effect, wider, others))
        else:
            effects.append(effect)
    return replace(found, effects=tuple(effects), notes=(*found.notes, *notes))


def _span(name: str, own: Estimate, forms: Sequence[OtherForm]) -> Estimate:
    """Return a number with the interval over all forms; itself where they hardly widen it."""
    if not math.isfinite(own.high - own.low):
        return own
    others = [form.sizes[name] for form in forms if name in form.sizes]
    low = min([own.low, *(item.low for item in others)])
    high = max([own.high, *(item.high for item in others)])
    if high - low < _WIDER * (own.high - own.low):
        return own
    return Estimate(own.value, low, high, own.unit)


def _note(effect: FoundEffect, names: Sequence[str], forms: Sequence[OtherForm]) -> str:
    """Say which other forms fit as well, and what the numbers are with each."""
    said = []
    for form in forms:
        numbers = [
            f"{name} {form.sizes[name].value:.4g} {form.sizes[name].unit}".rstrip()
            for name in names
            if name in form.sizes
        ]
        if numbers:
            said.append(f"{form.words} ({', '.join(numbers)})")
    intervals = "its interval spans" if len(names) == 1 else "its intervals span"
    return (
        f"{effect.id} fits as well with {' or '.join(said)}: these runs do not tell its law, and "
        f"{intervals} all of them"
    )
