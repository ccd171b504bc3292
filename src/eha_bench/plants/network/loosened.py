"""A plant one of whose joints gives way: another network, seen as if it were the declared one.

Parameters, channels and first readings are those of the plant as it was declared. What is beyond
the joint moves by itself, and no sensor needs to show how: where it begins follows from the forces.
Both sides begin at the same speed and, but for friction that holds one of them, with the same
acceleration. Of a coupling that is bent by s beyond its play the accelerations differ by

    r(s) = a_this(s) - a_other(s) = r(0) + s dr/ds,    so s = -r(0) / (dr/ds)

which two steps of a microsecond tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.plants.effect import AT
from eha_bench.plants.layout import Layout
from eha_bench.plants.network.rigid_joint import RigidJoint, motions_of
from eha_bench.plants.plant import Drive, Drives, Parametrised, Plant

_MOMENT = 1e-6
"""Time over which an acceleration is looked at, s."""
_MOMENTS = "first moments"
"""What a drive keeps them by."""
_TRIED = 1e-3
"""Force by which that is changed, in what is usual there."""
_AWAY = 20.0
"""Force by which the first bend may be off, in what is usual there."""
_SLOW = 100.0
"""Rate at which it may change at first by as much as it may be off, 1/s."""
_FASTEST, _TEETH = 1e3, 500.0
"""How fast the lighter side may swing on the coupling, rad/s, and how fast it swings on one whose
stiffness nobody says: stiffer, hardly a sensor tells it from a rigid one, and it asks for shorter
steps."""
_LIGHTEST = 1e-30
"""Share of the declared inertia of the lighter side that stands for none."""
_STIFFNESS, _DAMPING, _PLAY = "stiffness", "damping", "play"


class LoosenedPlant:
    """A plant with a joint that gives way.

    Args:
        plant: as declared. loose: the same with a coupling in the joint. joint: it.
        effort: a usual force (or torque) there, N (or N*m).
        read: states of the speed and position of the side with the sensors, in both plants.
        beyond: whether that is the other side.
    """

    def __init__(
        self,
        plant: Plant,
        loose: Plant,
        joint: RigidJoint,
        effort: float,
        read: tuple[str, str],
        *,
        beyond: bool,
    ) -> None:
        self.plant, self.loose, self.joint = plant, loose, joint
        self._effort, self._declared = effort, joint.inertia(plant.layout.defaults())
        self.read, self.hidden = read, motions_of(joint.node if beyond else joint.end)
        self.ahead = 1.0 if beyond else -1.0
        self.bend, self.rate = f"{joint.name}~bend", f"{joint.name}~rate"
        self._from, self._to, self._moved = _same_parameters(plant.layout, loose.layout)
        self._off = loose.layout.defaults()
        index = loose.layout.index
        self._coupling = {
            name: index[f"{joint.coupling}.{name}"] for name in (_STIFFNESS, _DAMPING, _PLAY)
        }
        self.speeds = tuple(
            loose.outputs.index(motions_of(node)[0]) for node in (joint.node, joint.end)
        )

    def at(
        self, vector: FloatArray, compliance: float, damping_time: float, play: float
    ) -> Parametrised:
        """Return the plant with its parameters set.

        Args:
            vector: as the declared plant's layout orders them.
            compliance: of the coupling, m/N (or rad/(N*m)). damping_time: s. play: m (or rad).
        """
        own = self._off.copy()
        own[self._to] = vector[self._from]
        for moved in self._moved:
            moved.set(vector, own)
        # of the sides as they are: a lighter one than was declared would ask for shorter steps
        lighter = max(self.joint.inertia(vector), _LIGHTEST * self._declared)
        stiffness = lighter * (_FASTEST if compliance > 0.0 else _TEETH) ** 2
        if compliance * stiffness > 1.0:
            stiffness = 1.0 / compliance
        for name, value in zip(
            (_STIFFNESS, _DAMPING, _PLAY), (stiffness, damping_time * stiffness, play), strict=True
        ):
            own[self._coupling[name]] = value
        bend, swing = self._effort / stiffness, math.sqrt(stiffness / lighter)
        away = _AWAY * bend + 0.5 * play
        hidden = {self.bend: away, self.rate: away * min(swing, _SLOW)}
        return _Loosened(self, vector, self.loose.at(own), play, _TRIED * bend, hidden)


@dataclass(frozen=True)
class _MovedPlaces:
    """An effect that has other places once the joint gives way.

    Attributes:
        here, there: places of its `at` in both vectors, None where it has but one place.
        numbers: of each of its places in the other layout, None where it is missing there.
        strength: its place in the other vector. off: neutral.
    """

    here: int | None
    there: int | None
    numbers: tuple[float | None, ...]
    strength: int
    off: float

    def set(self, vector: FloatArray, other: FloatArray) -> None:
        """Say in the other vector where it acts; nowhere where the place is missing."""
        number = self.numbers[0 if self.here is None else round(float(vector[self.here]))]
        if number is None:
            other[self.strength] = self.off
        elif self.there is not None:
            other[self.there] = number


def _same_parameters(
    of: Layout, other: Layout
) -> tuple[IndexArray, IndexArray, list[_MovedPlaces]]:
    """Return the places in two layouts of what both hold, and effects whose places differ.

    What sets a coupling in a joint stays off in the other one: it is there already.
    """
    acting = [effect for effect in of.effects if not effect.action.couples]
    own = {parameter.name for parameter in of.parameters}
    shared = own | {f"{e.id}.{p.name}" for e in acting for p in e.parameters if p.name != AT}
    others = {effect.id: effect for effect in other.effects}
    here: list[int] = []
    there: list[int] = []
    for key, parameter in of.items():
        if key in shared and key in other.index:
            here += range(of.index[key], of.index[key] + parameter.size)
            there += range(other.index[key], other.index[key] + parameter.size)
    moved = []
    for effect in acting:
        if (also := others.get(effect.id)) is None:
            continue
        key, words = f"{effect.id}.{AT}", also.places
        numbers = [float(words.index(word)) if word in words else None for word in effect.places]
        strength = other.index[f"{effect.id}.{also.strength.name}"]
        moved.append(
            _MovedPlaces(
                of.index.get(key), other.index.get(key), tuple(numbers), strength, also.neutral
            )
        )
    return np.array(here, dtype=np.intp), np.array(there, dtype=np.intp), moved


class _Loosened(Parametrised):
    """A plant with a joint that gives way, its parameters set.

    Args:
        of: it. vector: of the declared plant. loose: the one that is simulated.
        play: of the joint, m (or rad). tried: by how much the coupling is bent to see what it does.
        hidden: how far its bend, and the rate of that, may be from where it begins.
    """

    def __init__(
        self,
        of: LoosenedPlant,
        vector: FloatArray,
        loose: Parametrised,
        play: float,
        tried: float,
        hidden: Mapping[str, float],
    ) -> None:
        super().__init__(of.plant, vector)
        self._of, self._loose = of, loose
        self._play, self._tried, self._hidden = play, tried, hidden
        self._count = len(of.plant.outputs)

    def following(self, reference: str) -> Parametrised:
        """Return it driven by what a controller inside the plant follows.

        Raises:
            InputError: no controller inside the plant follows that.
        """
        return self._driven(self._loose.following(reference))

    def imposing(self, motion: str) -> Parametrised:
        """Return it driven by a motion.

        Raises:
            InputError: nothing can impose that motion, or it leaves another one undetermined.
        """
        return self._driven(self._loose.imposing(motion))

    def _driven(self, loose: Parametrised) -> _Loosened:
        """Return it with what is simulated driven in another way."""
        return _Loosened(self._of, self.vector, loose, self._play, self._tried, self._hidden)

    @property
    def hidden(self) -> Mapping[str, float]:
        """How far the bend of the joint and its rate may be from where they begin."""
        return self._hidden

    @property
    def state_places(self) -> Mapping[str, int]:
        """State -> place in the state vector of the plant that is simulated."""
        return self._of.loose.state_places

    @property
    def look_back(self) -> float:
        """How long ago an input may be that still acts, s."""
        return self._loose.look_back

    def simulate(self, drive: Drive, initial: Mapping[str, float], step: float) -> FloatArray:
        """Return (n, outputs) in the order of the declared plant's outputs, SI."""
        return self.simulate_to_end(drive, initial, step)[0]

    def simulate_to_end(
        self, drive: Drive, initial: Mapping[str, float], step: float
    ) -> tuple[FloatArray, dict[str, float]]:
        """Return what `simulate` does, and the states at its end."""
        (start,) = self._starts(Drives((drive,)), (0,), (initial,))
        out, ends = self._loose.simulate_to_end(drive, start, step)
        return out[:, : self._count], ends

    def simulate_each(
        self,
        drives: Drives,
        which: Sequence[int],
        initials: Sequence[Mapping[str, float]],
        step: float,
    ) -> list[FloatArray]:
        """Return what the sensors would read in several simulations, (n, outputs) each, SI."""
        starts = self._starts(drives, which, initials)
        found = self._loose.simulate_each(drives, which, starts, step)
        return [values[:, : self._count] for values in found]

    def start(self, initial: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return a state vector and a memory with nothing bent."""
        return self._loose.start(self._bent(initial, 0.0))

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
        shown = np.full((out.shape[0], len(self._of.loose.outputs)), np.nan)
        self._loose.advance(
            first, last, time, inputs, locked, bypass_open, step, fresh, memory, state, shown
        )
        out[first : last + 1] = shown[first : last + 1, : self._count]

    # --- where the other side begins -------------------------------------------------------------

    def _bent(self, initial: Mapping[str, float], bend: float) -> dict[str, float]:
        """Return a first state with this side `bend` ahead of the other, at the same speed.

        The side with the sensors is where the first readings say.
        """
        of = self._of
        start = {name: initial[name] for name in initial if name not in (of.bend, of.rate)}
        speed, position = (initial.get(name, 0.0) for name in of.read)
        rate, bend = initial.get(of.rate, 0.0), bend + initial.get(of.bend, 0.0)
        start |= {of.hidden[0]: speed + of.ahead * rate, of.hidden[1]: position + of.ahead * bend}
        return start

    def _starts(
        self, drives: Drives, which: Sequence[int], initials: Sequence[Mapping[str, float]]
    ) -> list[dict[str, float]]:
        """Return the first states at which both sides are accelerated alike."""
        if not initials:
            return []
        moments = _moments(drives)
        # how the joint is bent beyond that is added to what follows from the forces
        own = (self._of.bend, self._of.rate)
        read = [{name: item[name] for name in item if name not in own} for item in initials]
        straight = [self._bent(initial, 0.0) for initial in read]
        apart = self._apart(moments, which, straight)
        sides = np.where(apart >= 0.0, 1.0, -1.0)
        edges = 0.5 * self._play * sides
        tried = [
            self._bent(initial, float(bend))
            for initial, bend in zip(read, edges + self._tried * sides, strict=True)
        ]
        change = (self._apart(moments, which, tried) - apart) / (self._tried * sides)
        with np.errstate(divide="ignore", invalid="ignore"):
            bends = np.where(change < 0.0, -apart / change, 0.0)
        bends = np.where(np.isfinite(bends) & (apart != 0.0), edges + bends, 0.0)
        return [
            self._bent(initial, float(bend)) for initial, bend in zip(initials, bends, strict=True)
        ]

    def _apart(
        self, moments: Drives, which: Sequence[int], starts: Sequence[Mapping[str, float]]
    ) -> FloatArray:
        """Return by how much this side is accelerated more than the other one, (n,)."""
        this, other = self._of.speeds
        found = []
        for k, values in zip(
            which, self._loose.simulate_each(moments, which, starts, _MOMENT), strict=True
        ):
            first = moments.items[k].first
            change = (values[first + 1] - values[first]) / _MOMENT
            found.append(change[this] - change[other])
        return np.array(found)


def _moments(drives: Drives) -> Drives:
    """Return the first moment of each drive, cut out once."""
    kept = drives.laid_out.get(_MOMENTS)
    if not isinstance(kept, Drives):
        kept = drives.laid_out[_MOMENTS] = Drives(tuple(map(_first_moment, drives.items)))
    return kept


def _first_moment(drive: Drive) -> Drive:
    """Return a drive ended a moment after its first tick, with what was before it."""
    tick = drive.first_tick
    time = np.append(tick.time, tick.time[-1] + _MOMENT)
    inputs = {name: np.append(column, column[-1]) for name, column in tick.inputs.items()}
    return replace(tick, time=time, inputs=inputs, anchors={})
