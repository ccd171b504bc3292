"""The registered effects, or kinds of elements, as a page of Markdown.

`python -m eha_bench.plants.catalogue effects`, `... elements` and `... roles` print the pages.
"""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Iterator

from eha_bench.core import plugins
from eha_bench.plants.effect import Effect
from eha_bench.plants.network.element import Anatomy, ElementKind
from eha_bench.plants.network.network import NODE_PARAMETERS, QUANTITIES, element_kinds
from eha_bench.plants.network.roles import role_summary
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.role_catalogue import roles_page

_ASKED = re.compile(r"input:\w+")
_EFFECTS = """\
# Effects

What a plant's declared equations may lack. Each is declared in `model.yaml` under `effects:`, and
is a candidate of `eha-bench diagnose` wherever a plant has the role that it acts on; `at` says
where, as a node, an element or a channel of the plant. The first parameter is its strength: at the
neutral value the effect is off. Defaults are typical sizes, from which a search starts; where the
unit depends on the place (`{effort}`: N or N*m; [Roles](roles.md) has all such words), they are
shares of what is usual there.

Written by `python -m eha_bench.plants.catalogue effects`; a test compares this page with the code.
"""

_ELEMENTS = """\
# Nodes and elements

What a `plant.yaml` is made of ([how to write one](how-to/plant.md)). A node holds state; an element
joins nodes, and adds torque, force or flow to their balances. Units are SI; a file may use any of
the same dimension. Where a unit depends on rotation and translation, `{effort}` is N*m or N,
`{position}` rad or m, `{speed}` rad/s or m/s, `{damping}` N*m*s/rad or N*s/m, `{inertia}` kg*m^2 or
kg, `{ratio}` the quotient of both ends' positions, and `{command}` the unit of the command of the
motor that the element drives. In the equations T is a torque, F a force, q a flow, p a pressure and
x a position; w and v are speeds, and friction opposes them.

Written by `python -m eha_bench.plants.catalogue elements`; a test compares this page with the code.
"""


def elements_page() -> str:
    """Return the page of nodes and elements: every kind with ports, parameters and inputs."""
    kinds = element_kinds()
    lines = [_ELEMENTS, *_nodes()]
    for name in sorted(kinds):
        lines += _element(kinds[name])
    return "\n".join(lines)


def _equations(group: str, name: str) -> Iterator[str]:
    """Yield a plug-in's law as Markdown: what its module says before the source.

    Equations are indented there, which is code in Markdown too.
    """
    _, _, text = (inspect.getdoc(plugins.module_of(group, name)) or "").partition("\n\n")
    law, _, _ = text.partition("\n\nSource:")
    if law and not law.startswith("Source:"):
        yield law
        yield ""


def _nodes() -> Iterator[str]:
    yield "## Kinds of nodes"
    yield ""
    yield "| kind | parameters | channels |"
    yield "|---|---|---|"
    for kind, parameters in NODE_PARAMETERS.items():
        own = [f"`{item.name}` {item.unit}".strip() for item in parameters]
        channels = [f"`{name}` {unit}".strip() for name, unit in QUANTITIES[kind].items()]
        yield f"| `{kind}` | {', '.join(own)} | {', '.join(channels)} |"
    yield ""
    yield "A rotation or translation may have a `stroke: [low, high]`, its ends."
    yield ""


def _element(kind: ElementKind) -> Iterator[str]:
    yield f"## {kind.id}"
    yield ""
    yield kind.summary
    yield ""
    yield from _equations("elements", kind.id)
    for port in kind.ports:
        key = {"first": "`between`, first", "second": "`between`, second"}.get(port.name)
        left_out = "; may be left out" if port.optional else ""
        yield f"* joins {key or f'`{port.name}`'}: {' or '.join(port.kinds)}{left_out}"
    for refers in kind.refers:
        yield f"* names another element: `{refers}`"
    whole = _ways(kind)
    inputs = {item.port: item for anatomy in whole for item in anatomy.inputs}
    for driven in inputs.values():
        held = "held between samples" if driven.held else "linear between samples"
        yield f"* input `{driven.port}`{_in(driven.unit)}, {held}"
    quantities = {item.name: item for anatomy in whole for item in anatomy.quantities}
    for shown in quantities.values():
        yield f"* channel `{shown.name}`{_in(shown.unit)}"
    if kind.source:
        yield f"* source: {kind.source}"
    yield ""
    if not kind.parameters:
        return
    yield "| parameter | unit | where it is left out | range | |"
    yield "|---|---|---|---|---|"
    for parameter in kind.parameters:
        default = _default(parameter)
        if parameter.name in (*kind.required, *kind.one_of):
            default = "required" if parameter.name in kind.required else "one of these"
        cells = (
            f"`{parameter.name}`", parameter.unit, default, _range(parameter), _note(parameter)
        )  # fmt: skip
        yield f"| {' | '.join(cells)} |"
    yield ""


def _ways(kind: ElementKind) -> list[Anatomy]:
    """Return what a kind does by each way to declare it: its parameters and inputs decide."""
    required = frozenset(kind.required)
    asked = sorted(set(_ASKED.findall(inspect.getsource(kind.anatomy))))
    every = frozenset(item.name for item in kind.parameters)
    return [
        kind.anatomy(names) for names in (required, every, *(required | {one} for one in asked))
    ]


def _in(unit: str) -> str:
    return f" ({unit})" if unit else ""


def effects_page() -> str:
    """Return the page: every registered effect with equation, parameters and test."""
    effects = [plugins.load("effects", name) for name in sorted(plugins.names("effects"))]
    return "\n".join([_EFFECTS, *(line for effect in effects for line in _section(effect))])


def _section(effect: Effect) -> Iterator[str]:
    yield f"## {effect.id}"
    yield ""
    yield effect.summary
    yield ""
    yield from _equations("effects", effect.id)
    for role, action in effect.actions.items():
        own = [str(action.equation)] if action.equation else []
        more = sorted({str(other) for other in action.equations.values()} - set(own))
        by = f"; by `{action.chosen_by}` also {', '.join(more)}" if more else ""
        balance = f": {own[0]}{by}" if own else by
        yield f"* acts on `{role}` ({role_summary(role)}){balance}"
    yield f"* distinguished by: {effect.separate}"
    yield f"* source: {effect.source}"
    yield ""
    yield "| parameter | unit | default | range | |"
    yield "|---|---|---|---|---|"
    strengths: set[str] = set()
    for parameter in effect.parameters:
        # the first one of each role, or of all roles
        is_strength = parameter.role not in strengths and "" not in strengths
        strengths.add(parameter.role)
        strength = [f"strength, neutral {effect.neutral:g}"] if is_strength else []
        note = "; ".join([*strength, *([_note(parameter)] if _note(parameter) else [])])
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
    role = f"only in the role `{parameter.role}`" if parameter.role else ""
    return "; ".join(part for part in (parameter.source, only, role, kept) if part)


if __name__ == "__main__":
    pages = {"effects": effects_page, "elements": elements_page, "roles": roles_page}
    sys.stdout.write(pages[sys.argv[1]]())
