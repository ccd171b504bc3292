"""The registered effects as a page of Markdown: `python -m eha_bench.plants.catalogue`."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from eha_bench.core import plugins
from eha_bench.plants.effect import Effect
from eha_bench.plants.parameter import Parameter

_INTRODUCTION = """\
# Effects

What a plant's declared equations may lack. Each is declared in `model.yaml` under `effects:`, and
is a candidate of `eha-bench diagnose`. The first parameter is its strength: at the neutral value
the effect is off. Defaults are typical sizes, from which a search starts. The formulas and their
sources are in each effect's file in `src/eha_bench/plants/effects`.

Written by `python -m eha_bench.plants.catalogue`; a test holds this page to the code.
"""


def markdown() -> str:
    """Return the page: every registered effect with equation, parameters and test."""
    effects = [plugins.load("effects", name) for name in sorted(plugins.names("effects"))]
    return "\n".join([_INTRODUCTION, *(line for effect in effects for line in _section(effect))])


def _section(effect: Effect) -> Iterator[str]:
    yield f"## {effect.id}"
    yield ""
    yield effect.summary
    yield ""
    for plant, action in effect.actions.items():
        where = f"{action.equation}"
        others = sorted({str(other) for other in action.equations.values()} - {where})
        more = f"; by `{action.chosen_by}` also {', '.join(others)}" if others else ""
        yield f"* in `{plant}`: {where}{more}"
    yield f"* told apart by: {effect.separate}"
    yield f"* source: {effect.source}"
    yield ""
    yield "| parameter | unit | default | range | |"
    yield "|---|---|---|---|---|"
    for place, parameter in enumerate(effect.parameters):
        note = f"strength, neutral {effect.neutral:g}" if place == 0 else _note(parameter)
        cells = (
            f"`{parameter.name}`",
            parameter.unit,
            _default(parameter),
            _range(parameter),
            note,
        )
        yield f"| {' | '.join(cells)} |"
    yield ""


def _default(parameter: Parameter) -> str:
    if parameter.choices:
        return str(parameter.decode(parameter.default))
    return f"{parameter.default:g}" + (f" × {parameter.size}" if parameter.size > 1 else "")


def _range(parameter: Parameter) -> str:
    if parameter.choices:
        return ", ".join(parameter.choices)
    ends = (f"{end:g}" if math.isfinite(end) else "" for end in (parameter.low, parameter.high))
    return " … ".join(ends).strip()


def _note(parameter: Parameter) -> str:
    kept = "" if parameter.searched else "not searched"
    name, words = parameter.when
    only = f"only for {name}: {', '.join(words)}" if name else ""
    return "; ".join(part for part in (parameter.source, only, kept) if part)


if __name__ == "__main__":
    sys.stdout.write(markdown())
