"""The page of a proposed experiment: what each rival predicts, where they part, what it costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.recording import Recording
from eha_bench.experiment.hypothesis import OF_VALUE
from eha_bench.experiment.proposal import NEAR, PlannedTrial, Proposal, ProposalEnding
from eha_bench.report.engineering import channel_name, display_unit, number, quantity
from eha_bench.report.figure_view import FigureView, figure_of
from eha_bench.report.page import Fact, write_page
from eha_bench.report.panels import Panel, Trace
from eha_bench.report.scene import Scene

_COLOURS: Final = ("blue", "vermilion", "green", "purple", "sky")
_POINTS: Final = 400
_APART: Final = "distance"


@dataclass(frozen=True)
class RoomRow:
    """One limit and what a trial leaves of it."""

    channel: str
    extremes: str
    limit: str
    reason: str
    used: str
    near: bool


@dataclass(frozen=True)
class ProposedTrialView:
    """One trial of the suite."""

    id: str
    words: str
    rooms: tuple[RoomRow, ...]
    figure: FigureView


@dataclass(frozen=True)
class RivalRow:
    """One rival, and how often it is named where it is the right one."""

    id: str
    named: str


@dataclass(frozen=True)
class WidthRow:
    """A parameter's interval before and after."""

    parameter: str
    before: str
    after: str


def write_experiment_report(path: Path, proposal: Proposal, suite: str) -> Path:
    """Write the page of a proposal and return its path.

    Args:
        path: of the page. proposal: what to show. suite: file name of the suite.
    """
    status = {
        ProposalEnding.PROPOSED: "passed",
        ProposalEnding.NOTHING_OPEN: "unjudged",
        ProposalEnding.NONE_PERMITTED: "undecided",
    }[proposal.ending]
    word = {
        ProposalEnding.PROPOSED: "Proposed",
        ProposalEnding.NOTHING_OPEN: "Nothing is open",
        ProposalEnding.NONE_PERMITTED: "No permitted experiment would tell more",
    }[proposal.ending]
    odds = proposal.odds
    content = {
        "name": proposal.source.resolve().parent.name,
        "suite": suite,
        "status": status,
        "word": word,
        "sentence": f"{proposal.sentence[:1].upper()}{proposal.sentence[1:].rstrip('.')}.",
        "is_open": proposal.ending is not ProposalEnding.NOTHING_OPEN,
        "rivals": tuple(
            RivalRow(name, "" if odds is None else _percent(odds.by_rival.get(name, 0.0)))
            for name in proposal.rivals
        ),
        "right": "" if odds is None else _percent(odds.right),
        "wrong": "" if odds is None else _percent(odds.wrong, 1),
        "open": "" if odds is None else _percent(1.0 - odds.right - odds.wrong),
        "draws": 0 if odds is None else odds.draws,
        "widths": tuple(
            WidthRow(
                item.parameter, _half_width(item.before, item.of), _half_width(item.after, item.of)
            )
            for item in proposal.widths
        ),
        "trials": tuple(_views(proposal)),
        "seconds": f"{number(proposal.bench_seconds, 2)} s",
        "notes": (proposal.permitted, *proposal.notes),
        "facts": tuple(_facts(proposal)),
    }
    return write_page(path, "experiment.html.j2", content, title="The next experiment")


def _half_width(share: float, of: str) -> str:
    below, text = _amount(share, 1)
    if of != OF_VALUE:
        text += f" of {of}"
    return f"below ± {text}" if below else f"± {text}"


def _percent(share: float, decimals: int = 0) -> str:
    below, text = _amount(share, decimals)
    return f"< {text}" if below else text


def _amount(share: float, decimals: int) -> tuple[bool, str]:
    """Return whether a share is below what the decimals show, and the least of them or itself."""
    least = 10.0**-decimals
    if 0.0 < 100.0 * share < 0.5 * least:
        return True, f"{least:g} %"
    return False, f"{number(100.0 * share, decimals if share else 0)} %"


def _views(proposal: Proposal) -> Iterator[ProposedTrialView]:
    for place, trial in enumerate(proposal.trials):
        figure = figure_of(
            scene_of_trial(trial),
            key=f"trial{place}",
            title=f"{trial.id}: what each rival predicts",
            points=_POINTS,
        )
        rooms = tuple(
            RoomRow(
                channel_name(room.channel),
                _span(trial, room.channel, room.low, room.high),
                _span(trial, room.channel, room.limit.low, room.limit.high),
                room.limit.reason,
                _percent(room.used),
                room.used > NEAR,
            )
            for room in trial.rooms
        )
        yield ProposedTrialView(trial.id, trial.words, rooms, figure)


def _span(trial: PlannedTrial, channel: str, low: float, high: float) -> str:
    return f"{_value(trial, channel, low)} … {_value(trial, channel, high)}"


def _value(trial: PlannedTrial, channel: str, value: float) -> str:
    unit = trial.units.get(channel, unit_of(channel))
    return quantity(value, unit) if np.isfinite(value) else number(value)


def scene_of_trial(trial: PlannedTrial) -> Scene:
    """Return a panel for each channel: each rival's prediction with the edges of its band."""
    values: dict[str, FloatArray] = {"reference": trial.reference}
    units: dict[str, str] = {"reference": trial.command_unit}
    command = [("reference", "reference", "reference", False)]
    panels = [_panel("Command", trial.command_unit, command, values)]
    channels = list(next(iter(trial.bands.values())))
    for channel in channels:
        unit = trial.units.get(channel, "")
        curves = []
        for colour, (rival, bands) in zip(_COLOURS, trial.bands.items(), strict=False):
            band = bands[channel]
            for part, curve in (("", band.middle), (", 5 %", band.low), (", 95 %", band.high)):
                key = f"{channel}: {rival}{part}"
                values[key], units[key] = curve, unit
                curves.append((key, f"{rival}{part}", colour, bool(part)))
        panels.append(_panel(channel_name(channel), unit, curves, values))
    if trial.parts.any():
        values[_APART], units[_APART] = trial.parts, ""
        label = "distance of the nearest two rivals, summed over time"
        panels.append(
            _panel("Separation of the rivals", "", [(_APART, label, "reference", False)], values)
        )
    return Scene(Recording(trial.time, values, units), tuple(panels))


def _panel(
    heading: str, si: str, curves: list[tuple[str, str, str, bool]], values: dict[str, FloatArray]
) -> Panel:
    ends = [float(end) for key, *_ in curves for end in (values[key].min(), values[key].max())]
    traces = tuple(Trace(*curve) for curve in curves)
    # no SI unit: differences of micrometres are to fill their panel
    return Panel(heading, "", display_unit(si, ends), traces)


def _facts(proposal: Proposal) -> Iterator[Fact]:
    yield Fact("Diagnosis", proposal.source.name)
    yield Fact("Budget", f"{number(proposal.budget, 1)} s of bench time")
    yield Fact("Experiments simulated", str(proposal.tried))
    if np.isfinite(proposal.seconds):
        yield Fact("Time taken", f"{number(proposal.seconds, 1)} s")
