"""The roles that effects act on, as a page of Markdown: what each lets change and offers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from eha_bench.core.shipped import names, shipped_file
from eha_bench.plants.effect import ANYTHING, Spot
from eha_bench.plants.model import load_model
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.roles import role_summary, roles_of

_PAGE: Final = """\
# Roles

What an [effect](how-to/effect.md) may act on. A *hook* is a value that a function of the effect
gets as its first argument and returns, changed; whatever the role *offers* its other arguments may
name, beside the effect's own parameters and states. Gathered from the plants that ship, so another
plant may offer fewer: one without a valve has no `valve`. All values are SI; an effort is N*m of
a rotation and N of a translation. Where the unit of an effect's parameter depends on the place, it
is written with the role's words: `{effort}/{speed}^2` is N*m*s^2/rad^2 or N*s^2/m^2, and its
default is a share of what is usual there.

`diagnose` also uses the role `anything`: each place where something unknown may act, for `learned`.
"""

_END: Final = """\
Written by `python -m eha_bench.plants.catalogue roles`; a test compares this page with the code.
"""

_CHANGED: Final = {
    "dry": "level of the dry friction, an effort; `direction` of the motion may be named as well, "
    "and how far bristles are `bent`, -1 to 1; 0 where there are none",
    "sticks": "effort up to which friction holds what rests; the level of `dry` by default",
    "viscous": "coefficient of the viscous friction, effort over speed",
    "net": "sum of all efforts but the dry friction, whose `level` may be named as well",
    "load": "sum of the efforts from outside",
    "inertia": "inertia, kg*m^2, or mass, kg",
    "torque": "torque (or force) of the motor on its own shaft; in a drive: of a motor's alone",
    "command": "command as it is given, before any limit; `commands` has it at all samples",
    "demand": "command within its limits",
    "drive": "what acts: what the command asked for",
    "reference": "position that a loop follows; its `reading`, `period` and `speed` may be named "
    "as well, and what was asked for at all ticks, as for `command`",
    "loop_command": "command by the law of a position loop, before any limit, of an `error` that "
    "`reference` may have changed; `reading`, `period` and `speed` may be named as well",
    "asked": "command as its own channel shows it",
    "opening": "opening of the lands, as a share of the travel; in a drive: of a valve's alone",
    "inflow": "sum of the flows into the volume, m^3/s",
    "ground": "conductance from the volume to elsewhere, m^3/(s*Pa): minus the slope over the "
    "pressure of what `inflow` adds, where that is stiff",
    "into_a": "sum of the flows into the first volume, m^3/s",
    "into_b": "sum of the flows into the second volume, m^3/s",
    "link": "conductance between both, m^3/(s*Pa): the slope of what flows, where it is stiff",
    "bulk": "bulk modulus of the oil, Pa",
    "delivery": "flow that the pump moves, m^3/s",
    "turning": "coefficient of viscous friction of the rotation, N*m*s/rad",
    "sliding": "coefficient of viscous friction of what slides, N*s/m",
    "leakage": "flow through a laminar gap, m^3/s",
    "leakage_slope": "conductance of a laminar gap, m^3/(s*Pa)",
    "reading": "what the sensor reads",
    "initial": "what is behind the sensor's first reading",
    "read_position": "position that is read",
    "initial_position": "position behind the first reading",
    "read_speed": "speed that is read",
    "read_current": "current in the winding that is read",
    "longest": "longest integration step, s",
    "pressure": "pressure of the reservoir, Pa",
}
"""Hook -> what a function of an effect gets there and returns."""

_ENDS: Final = {"_a": "port a", "_b": "port b", "_supply": "the supply", "_tank": "the tank"}


def roles_page() -> str:
    """Return the page: every role with its hooks, and what functions may name there."""
    lines = [_PAGE, _END]
    for role, spots in _spots().items():
        if role != ANYTHING:
            lines += _section(role, spots)
    return "\n".join(lines)


def _spots() -> dict[str, list[Spot]]:
    """Return the places of every role in all plants that ship."""
    found: dict[str, list[Spot]] = {}
    for name in names("plants"):
        plant = load_model(shipped_file(f"plants/{name}.yaml")).plant
        assert isinstance(plant, NetworkPlant)
        for role, spots in roles_of(plant.system).items():
            found.setdefault(role, []).extend(spots)
    return found


def _section(role: str, spots: list[Spot]) -> Iterator[str]:
    yield f"## {role}"
    yield ""
    yield f"{role_summary(role).capitalize()}."
    yield ""
    offered = list(dict.fromkeys(name for spot in spots for name in spot.names))
    if offered:
        yield f"* offers {', '.join(f'`{name}`' for name in offered)}"
    units: dict[str, list[str]] = {}
    for spot in spots:
        for word, unit in spot.units.items():
            known = units.setdefault(word, [])
            if unit and unit not in known:
                known.append(unit)
    if units:
        listed = (f"`{{{word}}}` ({' or '.join(known)})" for word, known in units.items())
        yield f"* units that depend on the place: {', '.join(listed)}"
    adjusted = list(dict.fromkeys(name for spot in spots for name in spot.parameters))
    if adjusted:
        yield f"* has the parameters {', '.join(f'`{name}`' for name in adjusted)}"
    yield ""
    hooks = list(dict.fromkeys(hook for spot in spots for hook in spot.hooks))
    if not hooks:
        return
    yield "| hook | what is changed |"
    yield "|---|---|"
    for hook in hooks:
        yield f"| `{hook}` | {_meaning(hook)} |"
    yield ""


def _meaning(hook: str) -> str:
    """Return what a hook changes; one of a port is that of a volume, at that port."""
    if hook in _CHANGED:
        return _CHANGED[hook]
    what, _, port = hook.rpartition("_")
    return f"{_CHANGED[what]}; at {_ENDS[f'_{port}']}"
