"""The page of a diagnosis: what is missing, how much better the model is with it, what remains."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote

from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.plants.model import Model
from eha_bench.plants.static_plant import StaticPlant
from eha_bench.report.curve_figure import curve_view, learned_curve
from eha_bench.report.diagnosis_scene import diagnosis_scene, gap
from eha_bench.report.diagnosis_text import (
    ErrorRow,
    ParameterRow,
    effect_rows,
    error_rows,
    headline,
    no_interval,
    parameter_row,
    probability,
    share,
    times,
    unknown_place,
    unknown_text,
    where,
    words_of,
)
from eha_bench.report.engineering import number
from eha_bench.report.error_by_value_table import error_tables
from eha_bench.report.figure_view import FigureView, figure_of
from eha_bench.report.page import Fact, write_page
from eha_bench.report.points_figure import points_view

DIAGNOSIS_NAME: Final = "diagnosis.html"

_POINTS: Final = 500
_LOSERS: Final = 12
_TOGETHER: Final = 3
"""Candidates from which on those rejected for one reason share a line."""


@dataclass(frozen=True)
class CauseView:
    """An effect that was added."""

    name: str
    id: str
    where: str
    summary: str
    share: str
    p_value: str
    rows: tuple[ParameterRow, ...]
    source: str


@dataclass(frozen=True)
class UnknownView:
    """Something that no known effect explains; `where` is empty where it was not located."""

    name: str
    where: str
    description: str
    variables: str
    times: str
    figure: FigureView | None


@dataclass(frozen=True)
class CandidateView:
    """One line of the ranking."""

    name: str
    score: str
    p_value: str
    reason: str
    added: bool


@dataclass(frozen=True)
class RejectedView:
    """Candidates that were rejected for one reason, each with its score."""

    reason: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class ReplayView:
    """One run as measured and as two models replay it."""

    name: str
    anchor: str
    setup: str
    use: str
    figure: FigureView


@dataclass(frozen=True)
class SetView:
    """Candidates that the data cannot distinguish, each with what would separate it."""

    names: str
    experiments: tuple[tuple[str, str], ...]


def write_diagnosis_report(folder: Path, found: Diagnosis, name: str, declared: Model) -> Path:
    """Write `diagnosis.html` into a folder and return its path.

    Args:
        folder: where diagnosis.json and the models lie; must exist.
        found: what to show.
        name: of the dataset.
        declared: the model as it was before.
    """
    status, verdict, sentence = headline(found)
    curve = learned_curve(found.revised)
    plant = found.revised.plant
    tables = _error_tables(found)
    models = (found.recalibrated, found.revised)[: 1 + _is_revised(found)]
    ranking, rejected = _ranking(found)
    why = no_interval(found.convergence)
    content = {
        "name": name,
        "plant": found.revised.plant_id,
        "status": status,
        "verdict": verdict,
        "sentence": sentence,
        "errors": tables,
        "by_value": error_tables(found.error_by_value, _floors(found)),
        "is_revised": _is_revised(found),
        "causes": _causes(found),
        "unknown": None if found.unknown is None else UnknownView(
            "Sensor" if found.unknown.sensor else "Unknown",
            unknown_place(found.unknown),
            unknown_text(found.unknown, found.revised.effects),
            "" if found.unknown.sensor else ", ".join(map(words_of, found.unknown.in_words)),
            times(found.unknown.when),
            curve_view(curve, key="learned", title="The learned curve") if curve else None,
        ),
        "sets": tuple(
            SetView(
                " / ".join(words_of(item) for item in group),
                tuple((words_of(item), found.separate.get(item, "")) for item in group),
            )
            for group in found.equivalent
        ),
        "ranking": ranking[:_LOSERS],
        "rejected": rejected,
        "left": max(0, len(ranking) - _LOSERS),
        "parameters": tuple(
            parameter_row(key, item, declared.value(key), why)
            for key, item in found.calibrated.items()
            if "[" not in key
        ) + tuple(
            parameter_row(f"{key} in {run}", item, why=why)
            for run, own in found.per_run.items() for key, item in own.items()
        ),
        "undetermined": found.undetermined,
        "notes": found.notes,
        "runs": () if isinstance(plant, StaticPlant) else _runs(found),
        "points": points_view(
            found.replays, plant, models, _floors(found), key="points"
        ) if isinstance(plant, StaticPlant) and found.replays else None,
        "recordings": len(found.replays),
        "facts": _facts(found, name),
    }  # fmt: skip
    title = f"{name}: diagnosis"
    return write_page(folder / DIAGNOSIS_NAME, "diagnosis.html.j2", content, title=title)


_USES = {Use.TRAIN: "training", Use.HOLDOUT: "held out", Use.UNSEEN: "unseen"}


def _error_tables(found: Diagnosis) -> tuple[tuple[str, tuple[ErrorRow, ...]], ...]:
    tables = (
        ("Held-out runs, never fitted", error_rows(dict(found.holdout))),
        ("Unseen runs, of another kind, never fitted", error_rows(dict(found.unseen))),
        ("Training runs", error_rows(dict(found.train))),
    )
    return tuple((heading, rows) for heading, rows in tables if rows)


def _causes(found: Diagnosis) -> tuple[CauseView, ...]:
    layout = found.revised.plant.layout
    return tuple(
        CauseView(
            words_of(item.id),
            item.id,
            where(item.equation),
            layout.effect(item.id).summary,
            share(item.share),
            probability(item.p_value),
            effect_rows(item, found),
            layout.effect(item.id).source,
        )
        for item in found.effects
    )


def _is_revised(found: Diagnosis) -> bool:
    """Whether the revised model differs from the recalibrated one: nothing new is shown twice."""
    return found.revised.to_yaml() != found.recalibrated.to_yaml()


def _ranking(found: Diagnosis) -> tuple[tuple[CandidateView, ...], tuple[RejectedView, ...]]:
    """Return the lines of the ranking, and what many were rejected for as one line each."""
    often = Counter(line.reason for line in found.ranking)
    lines = []
    together: dict[str, list[str]] = {}
    for line in found.ranking:
        name, score = words_of(line.id), share(line.score)
        if often[line.reason] >= _TOGETHER and not line.added:
            together.setdefault(line.reason, []).append(f"{name} ({score})")
            continue
        lines.append(CandidateView(name, score, probability(line.p_value), line.reason, line.added))
    rejected = (RejectedView(reason, tuple(names)) for reason, names in together.items())
    return tuple(lines), tuple(rejected)


def _runs(found: Diagnosis) -> tuple[ReplayView, ...]:
    """Return all runs: held-out ones first, among them the one that shows most."""
    floors, is_revised = _floors(found), _is_revised(found)
    ordered = sorted(found.replays, key=lambda item: (item.use is Use.TRAIN, -_worst(item, floors)))
    when = found.unknown.when if found.unknown is not None else ()
    views = []
    for place, item in enumerate(ordered):
        if not item.measured or item.time.size < 2:
            continue
        scene = diagnosis_scene(item, floors, when, is_revised=is_revised)
        figure = figure_of(
            scene,
            key=f"run{place}",
            title=f"{item.run}: measured, and simulated by the recalibrated"
            + (" and the revised model" if is_revised else " model"),
            points=_POINTS,
            static_panels=6 if place == 0 else 2,
        )
        setup = []
        if found.revised.plant.can_lock:
            setup.append("piston locked" if item.locked else "piston free")
        if item.bypass_open:
            setup.append("bypass open")
        setup.append(f"{number(float(item.time[-1]), 1)} s")
        use = _USES[item.use]
        anchor = f"trial={quote(item.run, safe='')}"
        views.append(ReplayView(item.run, anchor, " · ".join(setup), use, figure))
    return tuple(views)


def _floors(found: Diagnosis) -> dict[str, float]:
    groups = (found.train, found.holdout, found.unseen)
    return {name: item.noise_floor for group in groups for name, item in group.items()}


def _worst(item: Replay, floors: dict[str, float]) -> float:
    """How far the recalibrated model is off in the worst channel, in noise floors."""
    return max((gap(item, name, floors) for name in item.measured), default=0.0)


def _facts(found: Diagnosis, name: str) -> tuple[Fact, ...]:
    facts = [
        Fact("Dataset", name),
        Fact("Plant", found.revised.plant_id),
        Fact("Revised model, SHA-256", found.revised.sha256, code=True),
    ]
    if math.isfinite(found.seconds):
        took = f"{number(found.seconds, 1)} s"
        if math.isfinite(found.simulations):
            took += f", for as much as {found.simulations:.0f} simulations of all training data"
        facts.append(Fact("Time taken", took))
    files = "diagnosis.json, revised.yaml, recalibrated.yaml"
    return (*facts, Fact("Files in this folder", files))
