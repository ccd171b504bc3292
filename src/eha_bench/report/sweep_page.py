"""The page of a sweep: how many points pass, which limit fails where, and all points."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from eha_bench.core.arrays import FloatArray
from eha_bench.core.finite import finite_or_none
from eha_bench.core.per_cent import per_cent
from eha_bench.report.engineering import (
    channel_name,
    limit_text,
    metric_name,
    number,
    printed_unit,
)
from eha_bench.report.page import Fact, write_page
from eha_bench.report.sweep_plots import (
    Axis,
    conflict,
    heat_svg,
    parallel_svg,
    pareto_svg,
    pass_share_bars,
)
from eha_bench.sweeps.factor import Factor
from eha_bench.sweeps.span import Range
from eha_bench.sweeps.sweep import SweepResult

PAGE: Final = "sweep.html"
POINTS: Final = "points"
"""Folder of the points that were run again with their reports."""
_MOST_AXES: Final = 8
_SHOWN: Final = 50
_DIGITS: Final = 5


@dataclass(frozen=True)
class LimitRow:
    """A limit in the table of what fails where.

    Attributes:
        kept: share of the points that keep it. alone: points that fail by it alone.
        best: its largest margin. bars: kept over each factor, as drawings.
    """

    trial: str
    metric: str
    limit: str
    kept: str
    alone: int
    best: str
    look: str
    bars: tuple[Markup, ...]


@dataclass(frozen=True)
class PointRow:
    """A point in the table of the best ones."""

    place: int
    values: tuple[str, ...]
    look: str
    margin: str
    worst: str
    href: str


def write_sweep_page(sweep: SweepResult, command: tuple[str, ...]) -> Path:
    """Write sweep.html into the sweep's folder; return its path.

    Args:
        sweep: what is shown. command: that ran it, to which a point can be added.
    """
    places = sorted(sweep.results)
    margins = sweep.margins
    passed = np.array([sweep.results[place].passed for place in places], dtype=np.bool_)
    least = np.array([sweep.results[place].margin for place in places], dtype=np.float64)
    factors = [_axis(factor, sweep, places, k) for k, factor in enumerate(sweep.space.factors)]
    limits = [Axis(limit.key, "", margins[:, k]) for k, limit in enumerate(sweep.limits)]
    overall = Axis("least margin", "", least)
    moving = [axis for axis in factors if np.unique(axis.values).size > 1]
    pair = conflict(margins)
    best = sweep.best
    content = {
        "suite": sweep.space.case.suite.name,
        "target": sweep.space.case.simulator.identity.name,
        "file": sweep.file.name,
        "look": "passed" if passed.any() else "failed" if sweep.complete else "incomplete",
        "word": f"{int(passed.sum())} of {len(places)} points keep all limits",
        "headline": _headline(sweep, margins),
        "factors": factors,
        "best": None if best is None else _best(sweep, best),
        "limits": [_limit_row(sweep, k, margins, factors) for k in range(len(sweep.limits))],
        "heat": heat_svg(moving[0], moving[1], least) if len(moving) > 1 else None,
        "parallel": parallel_svg([*factors, overall, *_worst(limits)], passed) if places else None,
        "pareto": pareto_svg(limits[pair[0]], limits[pair[1]], passed) if pair else None,
        "points": _point_rows(sweep),
        "shown": _SHOWN,
        "command": shlex.join((*command, "--point")),
        "data": _data(sweep, factors, limits, overall, pair),
        "facts": [
            Fact("Points", f"{len(places)} of {len(sweep.points)}"),
            Fact("Design", sweep.file.name),
            *(
                Fact(
                    f"{name.removesuffix('_sha256').capitalize()}, SHA-256", digest[:12], code=True
                )
                for name, digest in sweep.space.case.simulator.identity.digests.items()
            ),
        ],
    }
    title = f"Sweep of {sweep.space.case.suite.name}"
    path = sweep.folder / PAGE
    return write_page(path, "sweep.html.j2", content, title=title, scripts=("sweep.js",))


def _axis(factor: Factor, sweep: SweepResult, places: list[int], column: int) -> Axis:
    values = [factor.in_file_unit(sweep.points[place][column]) for place in places]
    log = isinstance(factor.span, Range) and factor.span.log
    if any(isinstance(value, str) for value in values):
        words = tuple(dict.fromkeys(str(value) for value in values))
        return Axis(
            factor.key, "", np.array([words.index(str(value)) for value in values], float), words
        )
    found = np.array([float(value) for value in values], dtype=np.float64)
    return Axis(factor.key, factor.shown_in or factor.unit, found, log=log)


def _headline(sweep: SweepResult, margins: FloatArray) -> str:
    if not sweep.complete:
        return f"Stopped after {len(sweep.results)} of {len(sweep.points)} points."
    if sweep.passing_points:
        best = sweep.best
        assert best is not None
        least = number(sweep.results[best].margin, 3, sign=True)
        return f"The best point keeps every limit with a margin of {least} or more."
    never = [
        limit.key for k, limit in enumerate(sweep.limits) if not bool(np.any(margins[:, k] >= 0.0))
    ]
    if never:
        return f"No point keeps {', '.join(never)}."
    return "Each limit is kept at some point; no point keeps all."


def _best(sweep: SweepResult, place: int) -> dict[str, Any]:
    found = sweep.results[place]
    rows = []
    for factor, value in zip(sweep.space.factors, sweep.points[place], strict=True):
        now = factor.declared_value(sweep.space.case)
        rows.append(
            (
                factor.key,
                printed_unit(factor.formatted(value)),
                "" if now is None else printed_unit(factor.formatted(now)),
            )
        )
    return {
        "place": place,
        "rows": rows,
        "margin": number(found.margin, 3, sign=True),
        "passed": found.passed,
        "worst": _nearest(sweep, place),
    }


def _nearest(sweep: SweepResult, place: int) -> str:
    """Return the limit with the least margin at a point."""
    found = sweep.results[place]
    if found.reason:
        return found.reason
    margins = np.array(found.margins)
    if not margins.size or not np.isfinite(margins).all():
        missing = [
            limit.key
            for limit, value in zip(sweep.limits, margins, strict=True)
            if not math.isfinite(value)
        ]
        return f"not scored: {', '.join(missing)}"
    return sweep.limits[int(np.argmin(margins))].key


def _limit_row(sweep: SweepResult, k: int, margins: FloatArray, factors: list[Axis]) -> LimitRow:
    limit, own = sweep.limits[k], margins[:, k]
    kept = own >= 0.0
    others = np.delete(margins, k, axis=1)
    alone = int(np.sum(~kept & np.all(others >= 0.0, axis=1)))
    scored = own[np.isfinite(own)]
    name = metric_name(limit.metric)
    return LimitRow(
        trial=limit.trial,
        metric=f"{name} ({channel_name(limit.channel)})" if limit.channel else name,
        limit=limit_text(limit.text),
        kept=per_cent(float(np.mean(kept))) if own.size else "",
        alone=alone,
        best=number(float(scored.max()) if scored.size else math.nan, 3, sign=True),
        look="passed" if kept.all() else "failed" if not kept.any() else "warned",
        bars=tuple(pass_share_bars(axis, own) for axis in factors),
    )


def _worst(limits: list[Axis]) -> list[Axis]:
    """Return the limits that fail most, as many as a plot has room for."""
    order = sorted(limits, key=lambda axis: float(np.mean(axis.values >= 0.0)))
    failing = [axis for axis in order if not bool(np.all(axis.values >= 0.0))]
    return failing[:_MOST_AXES]


def _point_rows(sweep: SweepResult) -> list[PointRow]:
    def rank(place: int) -> tuple[bool, float]:
        found = sweep.results[place]
        return found.passed, found.margin if math.isfinite(found.margin) else -math.inf

    ranked = sorted(sweep.results, key=lambda place: (*rank(place), -place), reverse=True)
    return [
        PointRow(
            place,
            tuple(
                printed_unit(factor.formatted(value))
                for factor, value in zip(sweep.space.factors, sweep.points[place], strict=True)
            ),
            sweep.results[place].status.value,
            number(sweep.results[place].margin, 3, sign=True),
            _nearest(sweep, place),
            _report_of(sweep, place),
        )
        for place in ranked[:_SHOWN]
    ]


def _report_of(sweep: SweepResult, place: int) -> str:
    """Return the link to a point's own report; "" where it has none yet."""
    path = Path(POINTS) / str(place) / "report.html"
    return path.as_posix() if (sweep.folder / path).is_file() else ""


def _data(
    sweep: SweepResult,
    factors: list[Axis],
    limits: list[Axis],
    overall: Axis,
    pair: tuple[int, int] | None,
) -> dict[str, Any]:
    """Return what sweep.js draws: all points, rounded."""
    places = sorted(sweep.results)
    return {
        "points": places,
        "passed": [int(sweep.results[place].passed) for place in places],
        "factors": [_to_json(axis) for axis in factors],
        "margins": [_to_json(axis) for axis in (overall, *limits)],
        "pareto": [pair[0] + 1, pair[1] + 1] if pair else [],
        "axes": [1 + limits.index(axis) for axis in _worst(limits)],
        "reports": {str(place): href for place in places if (href := _report_of(sweep, place))},
    }


def _to_json(axis: Axis) -> dict[str, Any]:
    rounded = [finite_or_none(float(f"{value:.{_DIGITS}g}")) for value in axis.values]
    return {
        "label": axis.label, "name": axis.name, "log": axis.log, "words": list(axis.words),
        "values": rounded,
    }  # fmt: skip
