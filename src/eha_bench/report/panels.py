"""Which channels are drawn together, in which order, unit and colour."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from eha_bench.core.recording import Recording
from eha_bench.report.engineering import DisplayUnit, channel_name, display_unit

# Panels of an actuator's log from top to bottom; the followed channel's panel comes first.
_TOGETHER: Final = (
    ("current_command", "current"),
    ("motor_speed",),
    ("pressure_a", "pressure_b"),
    ("pressure_difference",),
    ("joint_angle",),
    ("piston_position",),
    ("piston_velocity",),
    ("force",),
    ("oil_temperature",),
)
_HEADINGS: Final = {
    "current_command": "Motor current",
    "pressure_a": "Chamber pressures",
}
_LABELS: Final = {
    "current_command": "command",
    "current": "measured",
    "pressure_a": "A",
    "pressure_b": "B",
}

# A channel has the same colour on every page; the hues are Okabe and Ito's, which people with
# any colour vision tell apart. Their light and dark shades are in report.css.
_COLOURS: Final = {
    "reference": "reference",
    "current_command": "reference",
    "current": "orange",
    "motor_speed": "green",
    "pressure_a": "vermilion",
    "pressure_b": "sky",
    "pressure_difference": "blue",
    "joint_angle": "blue",
    "piston_position": "blue",
    "piston_velocity": "green",
    "force": "purple",
    "oil_temperature": "vermilion",
}
_OTHER_COLOURS: Final = ("blue", "vermilion", "green", "purple", "sky", "orange")


@dataclass(frozen=True)
class Trace:
    """A channel in a panel; `colour` names a shade of the page's style sheet."""

    channel: str
    label: str
    colour: str
    dashed: bool


# Less than this (SI) is not spread over the height of a panel: it is the sensor's noise.
_LEAST_SPANS: Final = {
    "Pa": 1e5,
    "A": 0.5,
    "rad": 3.5e-3,
    "rad/s": 1.0,
    "m": 2e-4,
    "m/s": 2e-3,
    "N": 20.0,
    "K": 1.0,
}


_FEWEST: Final = 50
"""Samples of which noise can be distinguished from movement."""
_WHITE: Final = 1.0


@dataclass(frozen=True)
class Panel:
    """Channels that share a pair of axes, with the unit they are shown in.

    `quiet` are those that only show their sensors' noise: a locked piston's position; between the
    first two of `band` the area is filled: the difference of two recordings.
    """

    heading: str
    si_unit: str
    unit: DisplayUnit
    traces: tuple[Trace, ...]
    quiet: bool = False
    band: tuple[str, ...] = ()

    @property
    def least_span(self) -> float:
        """The least range of values (SI) that the panel's height stands for."""
        return _LEAST_SPANS.get(self.si_unit, 0.0)

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of the channels drawn here."""
        return tuple(trace.channel for trace in self.traces)


def panels_of(recording: Recording, followed: str = "") -> tuple[Panel, ...]:
    """Return the panels of a recording: what follows the reference first, unknown channels last.

    Args:
        recording: what was measured.
        followed: the channel that should follow `reference`; "" where unknown.
    """
    drawn = [name for name in recording if np.isfinite(recording[name]).any()]
    return tuple(
        _panel(recording, list(names), heading_of(names, (followed,)))
        for names in channel_groups(drawn, (followed,))
    )


def channel_groups(
    names: Iterable[str], followed: Sequence[str] = ()
) -> tuple[tuple[str, ...], ...]:
    """Return which of these channels are drawn together, from top to bottom.

    Args:
        names: of channels that are there.
        followed: those that should follow `reference`: drawn first, each together with it.
    """
    there = list(names)
    groups: list[tuple[str, ...]] = []
    for name in followed:
        if name in there:
            groups.append(("reference", name) if "reference" in there else (name,))
    left = [name for name in there if not any(name in group for group in groups)]
    for together in (*_TOGETHER, *((name,) for name in left)):
        group = tuple(name for name in together if name in left)
        groups += [group] if group else []
        left = [name for name in left if name not in group]
    return tuple(groups)


def colour_of(channel: str, place: int) -> str:
    """Return a channel's shade; one that is not ours has that of its place in its panel."""
    return _COLOURS.get(channel) or _OTHER_COLOURS[place % len(_OTHER_COLOURS)]


def heading_of(names: Sequence[str], followed: Sequence[str] = ()) -> str:
    """Return what stands over channels that are drawn together."""
    own = next((name for name in followed if name in names), "")
    first = own or names[0]
    alone = len(names) == 1 and not own
    return channel_name(first) if alone else _HEADINGS.get(first, channel_name(first))


def _panel(recording: Recording, names: list[str], heading: str) -> Panel:
    # The reference carries the unit of what follows it.
    si = recording.unit(names[-1])
    values = [v for name in names for v in _range(recording, name)]
    unit = display_unit(si, [*values, _LEAST_SPANS.get(si, 0.0)])
    known = [name for name in names if name != "reference"]
    traces = tuple(
        Trace(
            channel=name,
            label="reference"
            if name == "reference"
            else (_LABELS.get(name, channel_name(name)) if len(names) > 1 else heading),
            colour=colour_of(name, known.index(name) if name in known else 0),
            dashed=name in ("reference", "current_command"),
        )
        for name in names
    )
    quiet = "reference" not in names and all(_is_noise(recording, name, si) for name in names)
    return Panel(heading, si, unit, traces, quiet)


def _is_noise(recording: Recording, name: str, si: str) -> bool:
    """Whether a channel shows nothing but its sensor's noise.

    It moves less than what a panel would be stretched to, or from sample to sample as much as
    altogether: the mean square of successive differences over the variance (von Neumann, 1941,
    doi:10.1214/aoms/1177731677) is 2 of white noise and far below 1 of anything that moves.
    """
    values = recording[name][np.isfinite(recording[name])]
    if np.max(values) / 2.0 - np.min(values) / 2.0 < _LEAST_SPANS.get(si, 0.0):
        return True
    if values.size < _FEWEST or not np.any(values):
        return False
    values = values / np.max(np.abs(values))  # whose squares are numbers, too
    variance = float(np.var(values))
    return variance > 0.0 and float(np.mean(np.diff(values) ** 2)) > _WHITE * variance


def _range(recording: Recording, name: str) -> tuple[float, float]:
    values = recording[name]
    return float(np.nanmin(values)), float(np.nanmax(values))
