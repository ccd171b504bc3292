"""What every plant offers: parameters, effects, channels with units, and simulation.

A plant is simulated in one of two ways: from logged inputs over a whole recording (`simulate`,
`sweep`), or moment by moment under a controller (`Session`). Whatever stands above plants (targets,
rig, FMU, report) knows a plant by what is declared here, never by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, SupportsIndex

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.channels import unit_of
from eha_bench.core.errors import InputError, Place
from eha_bench.core.linkage import Linkage
from eha_bench.plants.channel_roles import KNOWN, ChannelRoles
from eha_bench.plants.layout import Layout

_FIRST_TICK, _FIRST_VALUES = "first tick", "first values"
_FOR_DATASETS = (
    "a model of that plant is for datasets: give it to `eha-bench predict`, `calibrate` or "
    "`diagnose`"
)


AT_ONCE = 1e-9
"""Time between two turns that are remembered, s: too short for anything to follow."""


@dataclass(frozen=True)
class Drive:
    """What drives a simulation: measured inputs on a clock, the setup, and where it starts.

    Attributes:
        time: (n,) s, increasing.
        inputs: channel -> (n,) SI; commands are held between samples, measured states that
            stand here are imposed (their own equation drops out), speeds by a cubic between
            samples, the rest linear.
        initial: channel -> what its sensor reads at the first sample, SI (the plant finds the
            state behind it); the rest starts at 0 or at what the plant takes as rest.
        locked, bypass_open: setup of the rig.
        first: tick at which the simulation starts; what is before it is history of the inputs
            (a delayed command looks back), and its rows of the result are NaN.
        turns: rows at its beginning that are turns of commands long before, all at once.
        anchors: state that nothing reads -> (n,) SI: where it is set anew every few samples, in a
            plant that is a network; NaN where it is not known.
    """

    time: FloatArray
    inputs: Mapping[str, FloatArray]
    initial: Mapping[str, float] = field(default_factory=dict)
    locked: bool = False
    bypass_open: bool = False
    first: int = 0
    turns: int = 0
    anchors: Mapping[str, FloatArray] = field(default_factory=dict)
    laid_out: dict[str, object] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What is kept of the inputs between simulations: a plant's by its id, and the first tick."""

    def starting(self, initial: Mapping[str, float]) -> Drive:
        """Return the same drive from another first state; what is laid out is shared."""
        other = replace(self, initial=initial)
        object.__setattr__(other, "laid_out", self.laid_out)
        return other

    @property
    def first_tick(self) -> Drive:
        """The drive ended at the tick where it starts."""
        kept = self.laid_out.get(_FIRST_TICK)
        if not isinstance(kept, Drive):
            end = self.first + 1
            inputs = {name: values[:end] for name, values in self.inputs.items()}
            kept = replace(self, time=self.time[:end], inputs=inputs)
            self.laid_out[_FIRST_TICK] = kept
        return kept

    @property
    def first_values(self) -> Mapping[str, float]:
        """The inputs at the tick where it starts: channel -> SI."""
        kept = self.laid_out.get(_FIRST_VALUES)
        if not isinstance(kept, dict):
            kept = {name: float(values[self.first]) for name, values in self.inputs.items()}
            self.laid_out[_FIRST_VALUES] = kept
        return kept


@dataclass(frozen=True)
class Drives:
    """Drives that are simulated together, with the same parameters.

    Attributes:
        items: the drives.
    """

    items: tuple[Drive, ...]
    laid_out: dict[str, object] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What a plant keeps of them between simulations, by its id."""

    @property
    def first_ticks(self) -> Drives:
        """The drives ended at the tick where each starts."""
        kept = self.laid_out.get(_FIRST_TICK)
        if not isinstance(kept, Drives):
            kept = Drives(tuple(drive.first_tick for drive in self.items))
            self.laid_out[_FIRST_TICK] = kept
        return kept


@dataclass(frozen=True)
class ElasticPair:
    """States of two parts with a spring between them.

    Attributes:
        positions: states of both. rates: states of their rates, in the same order.
        force: channel that shows the spring's force, "" for none.
    """

    positions: tuple[str, str]
    rates: tuple[str, str]
    force: str


class Parametrised:
    """A plant with its parameters set: what depends on them alone is looked up once.

    Attributes:
        plant: the plant. vector: its parameters, as `layout` orders them.
    """

    def __init__(self, plant: Plant, vector: FloatArray) -> None:
        self.plant = plant
        self.vector = vector
        self.sensors_are_ideal = plant.layout.sensors_are_ideal(vector)

    def simulate(self, drive: Drive, initial: Mapping[str, float], step: float) -> FloatArray:
        """Return what the sensors would read from another first state than the drive's own.

        Args and result are those of `Plant.simulate`.
        """
        return self.plant.simulate(self.vector, drive.starting(initial), step)

    def simulate_to_end(
        self, drive: Drive, initial: Mapping[str, float], step: float
    ) -> tuple[FloatArray, dict[str, float]]:
        """Return what `simulate` does, and the states at the end of it: name -> SI.

        Where a plant does not tell, the states are those that its sensors read.
        """
        out = self.simulate(drive, initial, step)
        outputs = enumerate(self.plant.outputs)
        read = {name: float(out[-1, k]) for k, name in outputs if name in self.plant.states}
        return out, read

    def simulate_each(
        self,
        drives: Drives,
        which: Sequence[int],
        initials: Sequence[Mapping[str, float]],
        step: float,
    ) -> list[FloatArray]:
        """Return what the sensors would read in several simulations, (n, outputs) each, SI.

        Args:
            drives: what drives them. which: number of the drive of each simulation.
            initials: first state of each simulation. step: largest integration step, s.
        """
        return [
            self.simulate(drives.items[k], initial, step)
            for k, initial in zip(which, initials, strict=True)
        ]

    def following(self, reference: str) -> Parametrised:
        """Return it driven by what a controller inside the plant follows, in place of its command.

        Raises:
            InputError: no controller inside the plant follows that.
        """
        raise InputError(
            f"'{reference}' is nothing that a controller inside {self.plant.id} follows",
            hint=f"it is commanded by {self.plant.command or 'nothing'}",
        )

    def imposing(self, motion: str) -> Parametrised:
        """Return it driven by a motion, which stands behind the inputs in `advance`'s columns.

        Raises:
            InputError: nothing can impose that motion, or it leaves another one undetermined.
        """
        raise InputError(
            f"no session of {self.plant.id} can impose '{motion}'",
            hint=f"it is commanded by {self.plant.command or 'nothing'}",
        )

    @property
    def hidden(self) -> Mapping[str, float]:
        """What nothing read says of a first state -> how far it may be from what follows from it.

        A first state may give these as well; they are 0 where it does not.
        """
        return {}

    # --- what a session rests on ------------------------------------------------

    @property
    def state_places(self) -> Mapping[str, int]:
        """State -> place in the state vector of `start` and `advance`."""
        return self.plant.state_places

    @property
    def look_back(self) -> float:
        """How long ago an input may be that still acts, s: the longest delay."""
        return self.plant.layout.look_back(self.vector)

    def start(self, initial: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return a state vector and a memory as `Plant.start` does."""
        return self.plant.start(self.vector, initial)

    def advance(
        self,
        first: int,
        last: int,
        time: FloatArray,
        inputs: FloatArray,
        locked: bool,
        bypass_open: bool,
        step: float,
        fresh: bool,
        memory: FloatArray,
        state: FloatArray,
        out: FloatArray,
    ) -> None:
        """Go on from one moment to another as `Plant.advance` does."""
        self.plant.advance(
            first, last, time, inputs, locked, bypass_open, step, fresh, self.vector, memory,
            state, out,
        )  # fmt: skip

    def derived_at(self, reading: FloatArray) -> tuple[float, ...]:
        """Return the derived channels at one reading (outputs,), in their order, SI."""
        plant = self.plant
        if not plant.derived_channels:
            return ()
        outputs = {name: reading[k : k + 1] for k, name in enumerate(plant.outputs)}
        found = plant.derived(self.vector, outputs)
        return tuple(float(found[name][0]) for name in plant.derived_channels)


class Plant:
    """A plant: equations compiled with all effects, simulated from inputs and a first state.

    One that is written in Python gives `start` and `advance`; everything else follows. One without
    sessions gives `simulate`.

    Attributes:
        id: public name.
        layout: where parameters and effects live in the parameter vector.
        outputs: channels that `simulate` returns, in the order of its columns.
        states: names that `Drive.initial` may give.
        state_places: state -> place in the state vector of `start` and `advance`.
        inputs: channels that drive a session, in the order of `advance`'s columns: what a
            controller commands, and disturbances. Inputs of `simulate` may be others, too.
        command: the one of `inputs` that a controller gives; "" where none does, and then there
            is not a session.
        references: those of `inputs` that a controller inside the plant follows: one of them may
            stand in a session for `command`, which that controller then gives.
        imposable_motions: motions of its parts that a session may impose where nothing commands it.
        resting_inputs: what inputs are by default, SI; 0 for the rest.
        derived_channels: channels that `derived` gives from all outputs, in a session's order.
        can_lock: whether the setup `piston: locked` means something.
        has_bypass: whether the setup `bypass: open` does.
        origin: the function that made it and its arguments, which another process calls again;
            None: it travels as any object does.
    """

    id: str
    layout: Layout
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    state_places: Mapping[str, int] = MappingProxyType({})
    inputs: tuple[str, ...] = ()
    command: str = ""
    references: tuple[str, ...] = ()
    imposable_motions: tuple[str, ...] = ()
    resting_inputs: Mapping[str, float] = MappingProxyType({})
    derived_channels: tuple[str, ...] = ()
    can_lock: bool = False
    has_bypass: bool = False
    origin: tuple[Callable[..., Plant], tuple[Any, ...]] | None = None

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Travel to other processes as `origin`: each compiles, or loads, its own kernel."""
        return self.origin or super().__reduce_ex__(protocol)

    def simulate(self, vector: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what the sensors would read, without noise; by `start` and `advance` as it is.

        Args:
            vector: parameters of plant and effects, as `layout` orders them.
            drive: inputs, setup and first state.
            step: largest integration step in s.

        Returns:
            (n, len(outputs)), SI.

        Raises:
            InputError: an input or a first value that this plant does not have.
        """
        for name in drive.inputs:
            if name not in self.inputs:
                raise InputError(
                    f"'{name}' cannot be an input of {self.id}",
                    hint=f"inputs may be: {', '.join(self.inputs)}",
                )
        n = drive.time.size
        rest = [np.full(n, self.resting_inputs.get(name, 0.0)) for name in self.inputs]
        given = [drive.inputs.get(name, rest[k]) for k, name in enumerate(self.inputs)]
        inputs = np.ascontiguousarray(np.column_stack(given), dtype=np.float64)
        state, memory = self.start(vector, drive.initial)
        out = np.full((n, len(self.outputs)), np.nan)
        self.advance(
            drive.first, n - 1, np.ascontiguousarray(drive.time, dtype=np.float64), inputs,
            drive.locked, drive.bypass_open, step, True, vector, memory, state, out,
        )  # fmt: skip
        return out

    @property
    def changed_between_runs(self) -> tuple[str, ...]:
        """Parameters that people change from one recording to the next: loads, bolted masses."""
        return ()

    @property
    def changed_by_warmth(self) -> tuple[str, ...]:
        """Parameters that change as a machine warms up: friction, leakage."""
        return ()

    @property
    def roles(self) -> ChannelRoles:
        """What its channels are; of a plant that says nothing, as their names are known."""
        return KNOWN

    def at(self, vector: FloatArray) -> Parametrised:
        """Return the plant with its parameters set, for many simulations with them."""
        return Parametrised(self, vector)

    # --- channels -----------------------------------------------------------------

    @property
    def units(self) -> Mapping[str, str]:
        """SI unit of every output, derived channel, state and input that it knows.

        Those of known channels stand in `core.channels`; a plant with others says theirs.
        """
        names = (*self.inputs, *self.outputs, *self.derived_channels, *self.states)
        return {name: unit_of(name) for name in dict.fromkeys(names)}

    # --- a session ------------------------------------------------------------------

    def weightless(self, vector: FloatArray) -> tuple[str, tuple[str, ...]] | None:
        """Return what parameters make weigh nothing, and which of them do, or None."""
        return None

    def check_session(
        self, *, command: str = "", locked: bool = False, bypass_open: bool = False
    ) -> None:
        """Refuse a session that cannot be, before anything is compiled.

        Args:
            command: what drives it; the plant's command by default. locked, bypass_open: setup.

        Raises:
            InputError: nothing drives this plant, or its setup cannot be so.
        """
        if not self.command and command not in self.imposable_motions:
            modes = " or ".join(f"`mode: {name}`" for name in self.imposable_motions)
            raise InputError(
                f"{self.id} has no input that a controller commands",
                hint=f"only a suite can drive it, with {modes}" if modes else _FOR_DATASETS,
            )
        self.check_setup(locked=locked, bypass_open=bypass_open)

    def check_setup(
        self, *, locked: bool = False, bypass_open: bool = False, where: Place | None = None
    ) -> None:
        """Refuse a setup that this machine cannot be in.

        Args:
            locked, bypass_open: setup. where: of the file that asks for it.

        Raises:
            InputError: it has no cylinder's piston to lock, or no bypass to open.
        """
        if locked and not self.can_lock:
            raise InputError(
                f"{self.id} has nothing to lock", where=where, hint="set `piston: free`"
            )
        if bypass_open and not self.has_bypass:
            raise InputError(f"{self.id} has no bypass", where=where, hint="set `bypass: closed`")

    def start(
        self, vector: FloatArray, initial: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the state vector behind what the sensors read first, and a memory for `advance`.

        Args:
            vector: parameters.
            initial: state -> what its sensor reads, SI; the rest is at rest.

        Raises:
            InputError: a channel that is not a state of this plant, or a plant without sessions.
        """
        raise self._no_session()

    def advance(
        self,
        first: int,
        last: int,
        time: FloatArray,
        inputs: FloatArray,
        locked: bool,
        bypass_open: bool,
        step: float,
        fresh: bool,
        vector: FloatArray,
        memory: FloatArray,
        state: FloatArray,
        out: FloatArray,
    ) -> None:
        """Go on from moment `first` to moment `last`: the one primitive that sessions rest on.

        Row k of `out` is what the sensors read at time[k], just before inputs[k] take effect. Rows
        first to last are written, and `state` and `memory` are left at time[last]. With
        first = last the plant is only read.

        Args:
            first, last: 0 <= first <= last < n; what is before `first` is history, which a delay
                looks back on.
            time: (n,) s, increasing up to `last`; undefined after it, as all rows are.
            inputs: (n, len(self.inputs)) SI, in C order. A command is held from time[k] to
                time[k + 1]. A disturbance is linear between them (a session holds it by writing
                both rows). A plant may write into the command's column what was asked for in its
                place.
            locked, bypass_open: setup.
            step: largest integration step, s.
            fresh: whether the effects' states are set from `state` first.
            vector: parameters, as `layout` orders them.
            memory, state: what `start` returned; changed.
            out: (n, len(self.outputs)) SI; rows first to last are changed.

        Raises:
            InputError: a plant without sessions.
        """
        raise self._no_session()

    def _no_session(self) -> InputError:
        return InputError(f"{self.id} is not simulated moment by moment", hint=_FOR_DATASETS)

    def rest(
        self,
        vector: FloatArray,
    ) -> Mapping[str, float]:
        """Return the states that are not 0 at rest, SI: a pressure that the oil is charged to."""
        return {}

    @property
    def held_inputs(self) -> tuple[str, ...]:
        """Inputs that keep their value between samples because nobody declared what they do."""
        return (self.command,) if self.command else ()

    @property
    def elastic_pairs(self) -> tuple[ElasticPair, ...]:
        """Pairs of parts that a spring joins, and so move nearly alike."""
        return ()

    def unbent(self, initial: Mapping[str, float]) -> dict[str, float]:
        """Return first states with parts that springs join to others where no spring is bent.

        Args:
            initial: state -> reading, SI; a part that is not in it is as far as its neighbour.
        """
        found = dict(initial)
        for _ in self.elastic_pairs:
            for first, second in (pair.positions for pair in self.elastic_pairs):
                for known, other in ((first, second), (second, first)):
                    if known in found and other not in found:
                        found[other] = found[known]
        return found

    @property
    def charged_by(self) -> Mapping[str, str]:
        """Pressures that nothing tells of at rest -> key of what each is charged to."""
        return {}

    def command_limit(
        self,
        vector: FloatArray,
    ) -> float:
        """Return the largest command that the plant follows, SI, either way; inf for none."""
        return math.inf

    def position_range(
        self,
        vector: FloatArray,
    ) -> Mapping[str, tuple[float, float]]:
        """Return the channels that are positions, with their ends, SI; +-inf where there are none.

        A trial may start at such a channel's value, and does where its reference is one.
        """
        return {}

    def followed_by(self, reference: str) -> str:
        """Return the position that a controller inside the plant makes follow a reference.

        "" where none does.
        """
        del reference
        return ""

    def hanging_weight(self, vector: FloatArray, node: str) -> float:
        """Return the largest torque of the declared weights that hang on a node, N*m.

        Args:
            vector: parameters, SI. node: of a plant.yaml.
        """
        del vector, node
        return 0.0

    def linkage(
        self,
        vector: FloatArray,
    ) -> Linkage | None:
        """Return the triangle of links that the rod moves a joint with, None for none."""
        return None

    @property
    def rods_behind(self) -> Mapping[str, str]:
        """Channels of joints' angles, with the output that is the position of the rod behind."""
        return {}

    def resting_values(self, vector: FloatArray) -> Mapping[str, float]:
        """Return what inputs are where they are not given, SI, by a vector of parameters."""
        del vector
        return self.resting_inputs

    # --- measurements ---------------------------------------------------------------

    def determined(
        self,
        inputs: Collection[str],
    ) -> tuple[str, ...]:
        """Return the outputs that these inputs determine: nothing drives the others."""
        return self.outputs

    def at_rest(
        self,
        measured: Mapping[str, float],
    ) -> dict[str, float]:
        """Return states that have no reading at the first sample, as those that have one tell them.

        Args:
            measured: state -> reading at the first sample, SI.
        """
        return {}

    def behind(
        self,
        vector: FloatArray,
        readings: Mapping[str, float],
    ) -> dict[str, float]:
        """Return states that other readings tell of, SI: a position behind a joint's angle.

        Args:
            vector: parameters. readings: channel -> reading at one sample, SI; any channels.
        """
        return {}

    def through_parts(
        self,
        vector: FloatArray,
        readings: Mapping[str, float],
    ) -> dict[str, float]:
        """Return states that readings of other parts tell of through gears and load cells, SI.

        Args:
            vector: parameters. readings: channel -> reading at one sample, SI; any channels.
        """
        return {}

    @property
    def reservoir_pressures(self) -> tuple[str, ...]:
        """Parameters that hold a pressure whatever flows: of a tank, or a supply."""
        return ()

    @property
    def tells_through_parts(self) -> bool:
        """Whether `through_parts` may return anything: it is asked for every window of a fit."""
        return True

    def derived(
        self,
        vector: FloatArray,
        outputs: Mapping[str, FloatArray],
    ) -> dict[str, FloatArray]:
        """Return channels that follow from the outputs alone, (n,) SI.

        Args:
            vector: parameters. outputs: channel -> (n,) SI, those that are known.
        """
        return {}

    def sweep(self, vectors: FloatArray, drive: Drive, step: float) -> FloatArray:
        """Return what `simulate` does for many parameter sets over the same input.

        Args:
            vectors: (m, len(P)), a set a row.
            drive, step: as in `simulate`.

        Returns:
            (m, n, len(outputs)), SI.
        """
        return np.stack([self.simulate(vector, drive, step) for vector in vectors])
