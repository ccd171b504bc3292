"""The section of a history's page about what is behind the nights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from markupsafe import Markup

from eha_bench.report.cause_plot import cause_svg, scaled_unit
from eha_bench.report.causes_text import unit_of_cause, untold_sentence, wear_sentence
from eha_bench.report.engineering import limit_text, number
from eha_bench.trends.wear import Causes, CauseTrend

_DRAWN: Final = 4
_MOST_OTHERS: Final = 60
_MOST_UNTOLD: Final = 20


@dataclass(frozen=True)
class WearingCauseView:
    """A cause as a row of a table shows it."""

    name: str
    healthy: str
    newest: str
    interval: str
    unit: str
    nights: int
    state: str
    look: str
    sign: str


@dataclass(frozen=True)
class CausesView:
    """What is written, drawn and listed.

    Attributes:
        wear: (look, sign, word, sentence) of each cause that moves.
        plots: (title, plot) of the cause that moves and of its rivals. others: of the rest. rows:
            of all. untold, notes: sentences.
        chances: (nights, probability) that the first limit is still kept, in words.
    """

    wear: tuple[tuple[str, str, str, str], ...]
    plots: tuple[tuple[str, Markup], ...]
    others: tuple[tuple[str, Markup], ...]
    rows: tuple[WearingCauseView, ...]
    chances: tuple[tuple[int, str], ...]
    untold: tuple[str, ...]
    notes: tuple[str, ...]


def causes_view(causes: Causes | None) -> CausesView | None:
    """Return the section; None where causes were not requested."""
    if causes is None:
        return None
    worn = {item.trend.name: item for item in causes.wear}
    wear = tuple(
        ("failed", "✕", "wears", wear_sentence(item)) if item.alarm
        else ("warned", "↗", "moves", wear_sentence(item))
        for item in causes.wear
    )  # fmt: skip
    named = {*worn, *(rival for item in causes.wear for rival in item.rivals)}
    drawn = [
        (trend.name, (_title(trend), cause_svg(trend, worn.get(trend.name), number=place)))
        for place, trend in enumerate(causes.trends)
    ]
    chances = causes.wear[0].chances if causes.wear else ()
    return CausesView(
        wear,
        tuple(plot for name, plot in drawn if name in named)[:_DRAWN],
        tuple(plot for name, plot in drawn if name not in named)[:_MOST_OTHERS],
        tuple(_row(trend, alarmed=trend.name in worn) for trend in causes.trends),
        tuple((ahead, f"{100.0 * chance:.0f}\N{NO-BREAK SPACE}%") for ahead, chance in chances),
        untold_sentence(causes)[:_MOST_UNTOLD],
        tuple(_as_sentence(note) for note in causes.notes),
    )


def _as_sentence(note: str) -> str:
    """Return a note with a capital letter, and limits in it as they are printed."""
    text = limit_text(note)
    return text[:1].upper() + text[1:]


def _title(trend: CauseTrend) -> str:
    symbol = scaled_unit(trend).symbol
    return f"{trend.name}, in {symbol}" if symbol else trend.name


def _row(trend: CauseTrend, *, alarmed: bool) -> WearingCauseView:
    unit = unit_of_cause(trend)
    newest, half = float(trend.values[-1]), 1.96 * float(trend.deviations[-1])
    moves = trend.state == "moves"
    look, sign = ("passed", "✓") if trend.state == "steady" else ("undecided", "?")
    if moves:
        look, sign = ("failed", "↗") if alarmed else ("undecided", "↗")
    return WearingCauseView(
        trend.name,
        number(unit.from_si(trend.healthy)),
        number(unit.from_si(newest)),
        f"± {number(unit.difference(half))}",
        unit.symbol,
        len(trend.nights),
        "moves" if alarmed else "moves with it" if moves else trend.state,
        look,
        sign,
    )
