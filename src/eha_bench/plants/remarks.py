"""What a model may say, and hardly means: a tolerance that is many times the value."""

from __future__ import annotations

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
    return found
