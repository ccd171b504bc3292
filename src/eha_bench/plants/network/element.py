"""A kind of element: its parameters, its ports, and what it adds to the balances of its nodes.

An element is written as small pure functions (its laws). A law names what it needs as its
arguments:

* an own parameter, or an own signal;
* `speed` and `position` of the node on its mechanical port; with more than one such port
  `speed_<port>` and `position_<port>`;
* `p_<port>`: pressure of the node on a hydraulic port; in a flow's law and slope also `p_source`
  and `p_sink`, the pressures of its own two ends;
* `t`: time, s.

So an element sees its nodes' states and says what goes into each: torque, force, flow (Karnopp,
Margolis, Rosenberg, System Dynamics, Wiley 2012). Everything is explicit, given the states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.plants.parameter import Parameter

Law = Callable[..., float]


class NodeKind(StrEnum):
    """What a node is."""

    ROTATION = "rotation"
    TRANSLATION = "translation"
    VOLUME = "volume"
    RESERVOIR = "reservoir"


MECHANICAL = (NodeKind.ROTATION, NodeKind.TRANSLATION)
HYDRAULIC = (NodeKind.VOLUME, NodeKind.RESERVOIR)


@dataclass(frozen=True)
class Port:
    """A place where an element joins a node.

    Attributes:
        name: key in the YAML; `between` joins two ports, `first` and `second`.
        kinds: kinds of nodes that fit.
        optional: whether it may be left out.
    """

    name: str
    kinds: tuple[NodeKind, ...]
    optional: bool = False


class BalanceSide(StrEnum):
    """Which side of a balance an effort belongs to: what moves it, or what it moves."""

    DRIVE = "drive"
    LOAD = "load"


@dataclass(frozen=True)
class Effort:
    """A torque or force on a mechanical node, positive in the node's direction.

    Attributes:
        port: the node. law: N*m or N. side: of the balance.
        hook: name under which effects may change it, "" where none may.
        stiffness: law of -d(law)/d(position), N*m/rad or N/m, where what hangs on it may swing
            faster than a step; never less than it is within the next step.
    """

    port: str
    law: Law
    side: BalanceSide = BalanceSide.LOAD
    hook: str = ""
    stiffness: Law | None = None


@dataclass(frozen=True)
class Friction:
    """Dry and viscous friction on a mechanical node.

    Attributes:
        port: the node. level: law of the dry friction, never negative; None where there is none.
        viscous: name of the coefficient among the parameters, "" where there is none.
        creep: name of the speed over which friction creeps at rest; 0: it sticks.
    """

    port: str
    level: Law | None
    viscous: str = ""
    creep: str = ""


@dataclass(frozen=True)
class Inertia:
    """Mass or inertia added to a mechanical node."""

    port: str
    law: Law


@dataclass(frozen=True)
class Flow:
    """A flow from one hydraulic node to another; without one end it comes from, or goes, nowhere.

    Attributes:
        source, sink: ports, "" where there is none. law: m^3/s.
        slope: d(law)/d(p_source - p_sink), m^3/(s*Pa), where that is stiff; never less than it is.
        switches: whether the slope comes and goes, as a valve's that opens and closes.
        hook: whether effects may change this flow, and under which name.
    """

    source: str
    sink: str
    law: Law
    slope: Law | None = None
    switches: bool = False
    hook: str = ""


@dataclass(frozen=True)
class Oil:
    """Volume of oil that an element adds to a volume, m^3; `low` is what is always left of it."""

    port: str
    law: Law
    low: Law | None = None
    hook: str = ""


@dataclass(frozen=True)
class Compliance:
    """What gives way besides the oil itself: dV/dp that an element adds to a volume, m^3/Pa."""

    port: str
    law: Law


@dataclass(frozen=True)
class Stops:
    """Ends of a translation's stroke, m."""

    port: str
    low: Law
    high: Law


@dataclass(frozen=True)
class Tie:
    """A node whose motion follows another one's, as behind a gear: it has no state.

    Attributes:
        port: the node that follows. leader: the port of the node that it follows.
        ratio: law of d(follower)/d(leader), of the leader's `position`.
        position: law of the follower's position, of the leader's `position`.
        bend: law of d2(follower)/d(leader)2, of the leader's `position`; None where it is 0.
    """

    port: str
    leader: str
    ratio: Law
    position: Law
    bend: Law | None = None


@dataclass(frozen=True)
class HeldSignal:
    """A number that an element holds over an integration step.

    Attributes:
        name: as laws name it.
        advance: law of its value after a time `h`, from itself and other signals; None: constant.
        start: law of its value at the first sample; None: 0.
        value: law of its value from other signals, asked for at every step.
        factor: law of its value from the time `h` by which `advance` moves on and from parameters:
            worked out once a step length.
        hook: name under which effects may change that value, "" where none may.
    """

    name: str
    advance: Law | None = None
    start: Law | None = None
    value: Law | None = None
    factor: Law | None = None
    hook: str = ""


@dataclass(frozen=True)
class Input:
    """A signal that a plant's inputs may drive.

    Attributes:
        port: name under `inputs:` in the YAML, as in `motor.current`.
        unit: SI.
        held: whether it keeps its value between samples; else it is linear between them.
        default: parameter that stands in where it is not driven, "" for 0.
        signal: where its value goes.
    """

    port: str
    unit: str
    held: bool
    signal: str
    default: str = ""


@dataclass(frozen=True)
class Command:
    """The way of a command through its drive: delayed, limited, lagging; the signal is what acts.

    Attributes:
        port: the input that asks. signal: what acts, held over a step.
        limit: parameter that bounds it on both sides, "" for none.
        unit: SI.
    """

    port: str
    signal: str
    unit: str
    limit: str = ""


@dataclass(frozen=True)
class Loop:
    """A controller inside an element, which sets another element's command once a period.

    Attributes:
        drives: key that names the element whose command it sets.
        reads: port of the node whose position it reads (through its sensor).
        reference, added: its inputs' ports: what is asked for, and what is added to the command.
        period: parameter, s.
        law: the command, of `reading`, `speed`, `reference` and parameters; `speed` is the mean
            slope of the last three readings.
    """

    drives: str
    reads: str
    reference: str
    added: str
    period: str
    law: Law


@dataclass(frozen=True)
class Quantity:
    """What a channel may show of an element, besides its nodes' states.

    Attributes:
        name: as in `motor.current`. unit: SI. law: its value.
        signal: the signal that an imposed channel of it sets, "" where none can be.
    """

    name: str
    unit: str
    law: Law
    signal: str = ""


Contribution = Effort | Friction | Inertia | Flow | Oil | Compliance | Stops | Tie


def ports_of(item: Contribution) -> tuple[str, ...]:
    """Return the ports that a contribution names."""
    if isinstance(item, Flow):
        return tuple(port for port in (item.source, item.sink) if port)
    return (item.port, item.leader) if isinstance(item, Tie) else (item.port,)


@dataclass(frozen=True)
class Anatomy:
    """What an element does, with the parameters that it was declared with.

    Attributes:
        parameters: those that the element has, in order.
        contributions: to the balances of its nodes.
        signals, inputs, commands, quantities: its own. loop: a controller within it.
        opens_with_bypass: whether its flows are there only while the bypass is open.
    """

    parameters: tuple[Parameter, ...]
    contributions: tuple[Contribution, ...] = ()
    signals: tuple[HeldSignal, ...] = ()
    inputs: tuple[Input, ...] = ()
    commands: tuple[Command, ...] = ()
    quantities: tuple[Quantity, ...] = ()
    loop: Loop | None = None
    opens_with_bypass: bool = False


@dataclass(frozen=True)
class ElementKind:
    """A kind of element.

    Attributes:
        id: as `kind:` names it. summary: one sentence. source: literature.
        ports: where it joins nodes.
        parameters: all that may be declared. required: names of those that have to be.
        one_of: names of those of which one has to be, and not more; () for none.
        anatomy: what it does, given the names of the parameters that are declared, and of the
            inputs that are used (as `input:port`).
        refers: keys that name another element; its laws see that one's parameters as
            `<key>_<parameter>`.
        changed_between_runs: names of parameters that people change from one recording to the next
            (a load, a mass bolted on): where a dataset declares one value, runs may differ.
        changed_by_warmth: names of parameters that change as a machine warms up.
    """

    id: str
    summary: str
    ports: tuple[Port, ...]
    parameters: tuple[Parameter, ...]
    anatomy: Callable[[frozenset[str]], Anatomy]
    required: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()
    source: str = ""
    refers: tuple[str, ...] = ()
    changed_between_runs: tuple[str, ...] = ()
    changed_by_warmth: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse to require what is no parameter: no plant could declare it.

        Raises:
            PluginError: it does.
        """
        known = [item.name for item in self.parameters]
        changed = (*self.changed_between_runs, *self.changed_by_warmth)
        asked = (*self.required, *self.one_of)
        for verb, names in (("requires", asked), ("changes", changed)):
            for name in names:
                if name not in known:
                    raise PluginError(
                        f"the element kind '{self.id}' {verb} '{name}', which is no parameter of "
                        "it",
                        hint=suggest(name, known),
                    )

    def parameter(self, name: str) -> Parameter | None:
        """Return the parameter of that name, None where it has none."""
        return next((item for item in self.parameters if item.name == name), None)
