"""A Foxglove layout for our recordings: one plot for each kind of quantity, in the report's order.

A layout is JSON that Foxglove imports (menu Layouts, Import from file): panels by id, and a tree
that says how they share the window. https://docs.foxglove.dev/docs/visualization/layouts
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from eha_bench.core import yaml_file
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import InputError, Place
from eha_bench.core.trial import MODES
from eha_bench.recordings import load_channel_map, read
from eha_bench.recordings.sample import TOPIC, WideMessage
from eha_bench.report.engineering import channel_name
from eha_bench.report.panels import channel_groups, colour_of, heading_of
from eha_bench.suites import load_suite

# As in report.css for a dark page, Foxglove's default.
_COLOURS: Final = {
    "reference": "#aab4c0",
    "blue": "#58aef0",
    "vermilion": "#f0824c",
    "green": "#3fc49a",
    "purple": "#d08ccb",
    "sky": "#85c9f2",
    "orange": "#e8a83c",
}


@dataclass(frozen=True)
class PlottedSeries:
    """A channel to plot: its message path and the unit of the values found there ("": none)."""

    channel: str
    path: str
    unit: str


def layout_for(source: Path | None = None) -> dict[str, Any]:
    """Return the layout for what a file holds, or for all channels that eha-bench writes.

    Args:
        source: a recording of ours, a suite (its control modes decide what is shown with the
            reference), or a channels.yaml (its topics and fields); None for every channel.

    Raises:
        EhaBenchError: the file cannot be read, or has no topics (a table).
    """
    if source is None:
        return layout(own_series({name: c.unit for name, c in CHANNELS.items()}))
    if source.suffix.lower() not in (".yaml", ".yml"):
        units = read(source).units
        return layout(own_series(units), followed=_followers(units))
    content = yaml_file.peek(source)
    if isinstance(content, dict) and "trials" in content:
        modes = dict.fromkeys(trial.channel for trial in load_suite(source).trials)
        series = own_series({name: c.unit for name, c in CHANNELS.items()})
        return layout(series, followed=tuple(modes))
    return layout(_mapped_series(source))


def own_series(units: Mapping[str, str]) -> tuple[PlottedSeries, ...]:
    """Return where a recording of ours holds channels with these SI units."""
    message = WideMessage.of(units)
    return tuple(
        PlottedSeries(channel, f"{TOPIC}.{field}", units[channel])
        for channel, field in zip(message.channels, message.fields, strict=True)
    )


def layout(series: Sequence[PlottedSeries], followed: Sequence[str] = ()) -> dict[str, Any]:
    """Return a layout: a plot a group of channels, one below the other.

    Args:
        series: what there is to plot, at least one.
        followed: channels that should follow `reference`, each drawn with it.
    """
    by_name = {item.channel: item for item in series}
    panels: dict[str, Any] = {}
    for number, names in enumerate(channel_groups(by_name, followed)):
        panels[f"Plot!eha{number}"] = _plot(
            [by_name[name] for name in names], heading_of(names, followed)
        )
    panels["RawMessages!eha"] = {
        "topicPath": by_name[next(iter(by_name))].path.partition(".")[0],
        "diffEnabled": False,
        "diffMethod": "custom",
        "diffTopicPath": "",
        "showFullMessageForDiff": False,
    }
    plots = _panel_tree([name for name in panels if name.startswith("Plot!")])
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": plots,
            "second": "RawMessages!eha",
            "splitPercentage": 80,
        },
    }


def _plot(items: Sequence[PlottedSeries], title: str) -> dict[str, Any]:
    unit = next((item.unit for item in reversed(items) if item.unit), "")
    return {
        "title": f"{title} / {unit}" if unit else title,
        "paths": [
            {
                "value": item.path,
                "label": f"{channel_name(item.channel)} / {item.unit or unit or '1'}",
                "enabled": True,
                "timestampMethod": "receiveTime",
                "color": _COLOURS[colour_of(item.channel, place)],
                "lineSize": 1.5,
                "showLine": True,
            }
            for place, item in enumerate(items)
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }


def _panel_tree(names: Sequence[str]) -> Any:
    """The tree of panels one below the other, all of the same height."""
    if len(names) == 1:
        return names[0]
    return {
        "direction": "column",
        "first": names[0],
        "second": _panel_tree(names[1:]),
        "splitPercentage": round(100.0 / len(names), 3),
    }


def _followers(units: Mapping[str, str]) -> tuple[str, ...]:
    """What follows the reference of a recording, by the reference's unit."""
    unit = units.get("reference", "")
    known = [mode.channel for mode in MODES if mode.channel in units]
    own = [name for name in units if name not in CHANNELS]
    return tuple(name for name in (*known, *own) if unit and units[name] == unit)


def _mapped_series(source: Path) -> tuple[PlottedSeries, ...]:
    entries = load_channel_map(source).channels
    found = tuple(_fields(entries))
    if not found:
        raise InputError(
            "names columns of a table: a Foxglove layout shows topics",
            where=Place(file=str(source), key="channels"),
            hint="give a channels.yaml with topic and field, or a recording",
        )
    return found


def _fields(entries: Mapping[str, Any]) -> Iterable[PlottedSeries]:
    for name, entry in entries.items():
        if entry.topic is not None:
            known = CHANNELS.get(name)
            unit = entry.unit or (known.unit if known else "")
            yield PlottedSeries(name, f"{entry.topic}.{entry.field}", unit)
