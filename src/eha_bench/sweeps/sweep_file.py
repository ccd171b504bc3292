"""sweep.yaml: what is varied, how far, and at which points.

design: latin_hypercube          # grid (the default), latin_hypercube, sobol
points: 200                      # of the last two
over:
gains:
pressure.k_p: {from: 3 A/MPa, to: 9 A/MPa, steps: 7, scale: log}
parameters:
leakage: {from: 1e-15 m^3/(s*Pa), to: 1e-13 m^3/(s*Pa), scale: log}
trials:
pressure_step.sample_rate: [500 Hz, 1 kHz]
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field

from eha_bench.core.located import Located
from eha_bench.core.yaml_file import NUMBER, Real, StrictModel, file_of, parse, read_text, validate
from eha_bench.sweeps.span import RangeFile

MOST_POINTS: Final = 1_000_000
_BLOCKS: Final = ("gains", "parameters", "trials")


def _spanning(value: object) -> object:
    if not isinstance(value, (list, dict, RangeFile)):
        raise ValueError(f"'{value}' is one value: give a range {{from, to}}, or a list of values")
    return value


Entries = Annotated[
    dict[str, Annotated[list[Real | str] | RangeFile, BeforeValidator(_spanning)]],
    Field(description="by name: a list of values, or {from, to, steps, scale}"),
]


class DesignKind(StrEnum):
    """How points are chosen."""

    GRID = "grid"
    LATIN_HYPERCUBE = "latin_hypercube"
    SOBOL = "sobol"


class Over(StrictModel):
    """What is varied."""

    gains: Entries = Field(default={}, description="of the controllers: mode.gain")
    parameters: Entries = Field(
        default={}, description="of the model, also effect.parameter of a declared effect"
    )
    trials: Entries = Field(
        default={}, description="keys of the suite: trial.key, or defaults.key for all trials"
    )


class SweepForm(StrictModel):
    """sweep.yaml: what is varied, how far, and at which points."""

    description: str = ""
    design: Annotated[
        DesignKind, Field(description="grid: all combinations; the others: `points` of them")
    ] = DesignKind.GRID
    points: Annotated[
        int | None,
        Field(ge=1, le=MOST_POINTS, description="how many, of a latin_hypercube or sobol"),
        NUMBER,
    ] = None
    seed: Annotated[int, Field(ge=0, lt=2**32, description="of the points"), NUMBER] = 0
    over: Over


@dataclass(frozen=True)
class SweepFile:
    """What a sweep.yaml says, before it is checked against a suite and its target.

    Attributes:
        form: design, points, seed. blocks: entries by factor, for each kind.
        path: the file. sha256: digest of its text.
    """

    form: SweepForm
    blocks: Mapping[str, Located]
    path: Path
    sha256: str


def load_sweep(source: str | Path | Mapping[str, Any]) -> SweepFile:
    """Read a sweep.yaml, or a dict of what it would hold.

    Raises:
        InputError: with file, line and key: an unknown key, an empty range, nothing to vary, a
            grid of too many points.
    """
    path = file_of(source, "sweep")
    text = read_text(path)
    content = Located.of(parse(text, str(path)), str(path))
    form = validate(SweepForm, content.value, str(path), places=content.place, kind="sweep")
    over = content.at("over")
    blocks = {name: over.at(name).mapping("entries by name") for name in _BLOCKS}
    if not any(block.value for block in blocks.values()):
        raise over.error("there is nothing to vary", hint=f"add a block: {', '.join(_BLOCKS)}")
    if form.design is not DesignKind.GRID and form.points is None:
        where = content.at("design")
        raise where.error("'points' is missing", hint=f"say how many points a {form.design} has")
    return SweepFile(form, blocks, path, hashlib.sha256(text.encode()).hexdigest())
