"""What a model may say, and hardly means: a wide tolerance, a list that leaves out another's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from eha_bench.plants.model import Model

_TIMES: Final = 3.0
"""A tolerance of so many values says next to nothing, and is rather one in per cent."""


def remarks(model: Model) -> list[str]:
    """Return what is allowed in a model and may not be meant, one sentence each."""
    found = []
    for key, tolerance in model.within.items():
        value = abs(model.value(key))
        if value > 0.0 and tolerance > _TIMES * value:
            found.append(
                f"'{key}' is believed to within {tolerance:g}, {tolerance / value:.3g} times its "
                f"value of {value:g} (SI); a share is written 'within: {tolerance:g} %'"
            )
    return [*found, *held_parameters(model), *_rising_friction(model)]


def held_parameters(model: Model) -> list[str]:
    """Say which parameters a model's own list under `calibrate` leaves at their declared values."""
    if not model.held:
        return []
    stay, them, they = ("stays", "it", "it") if len(model.held) == 1 else ("stay", "them", "they")
    return [
        f"{', '.join(model.held)} {stay} as declared: the model's own list under `calibrate` (or "
        f"`per_run`) stands for that of the model below it, which has {them}; list {them} too "
        f"where {they} may be off"
    ]


def _rising_friction(model: Model) -> Iterator[str]:
    """Yield frictions whose level at rest is below that of motion: theirs would rise with speed."""
    layout = model.plant.layout
    known = {*layout.by_key, *layout.synonyms}
    for key in sorted(known):
        owner, _, name = key.rpartition(".")
        coulomb = f"{owner}.coulomb"
        if name != "static" or coulomb not in known:
            continue
        rest, moving = model.value(key), model.value(coulomb)
        if rest < moving:
            yield (
                f"'{key}' of {rest:g} (SI) is below '{coulomb}' of {moving:g}: friction that falls "
                "with the speed is largest at rest, and this one rises; leave 'static' and "
                "'stribeck_speed' out where it does not fall"
            )
