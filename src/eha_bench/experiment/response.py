"""What a trial would record, by every rival and over its posterior, in units of the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.processors import usable_processors
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.experiment.candidates import Experiment, ExperimentSettings
from eha_bench.experiment.commanded import BeforeTrial, Commanded
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.permitted import SHARE, SIGMAS, Limit, SetUp
from eha_bench.plants.network.integration import LANES
from eha_bench.plants.plant import Drive, Plant
from eha_bench.posterior.covered import Covered

STEP = 3.4e-4
"""Integration step, s: as coarse as while a diagnosis searches, where differences count."""
MEMORY = 0.02
"""Correlation time of an unexplained remainder, s: it does not average out as white noise does."""
REST = 0.5
"""Time at rest that is simulated before a trial, s. A machine is at rest when its trial
starts, with the pressures that its weights and leaks make; what moves on the way there is in no
recording, and differs from rival to rival."""
_FORM = 0.01
"""Error of a form beyond what was recorded, as a share of the way: a friction that is fitted to
slow motions was off by that much in ones ten times as large."""
_REMAINDER = 3.0
_TAIL = 3.1
"""Standard deviations that one of a thousand draws goes beyond."""
_SIZES = (1.0, 0.7, 0.45, 0.25, 0.12, 0.05)
"""Shares of an experiment's size that are tried, the largest first."""
SMALLEST = _SIZES[-1]
"""... and the last."""


@dataclass(frozen=True)
class Bench:
    """What an experiment is measured by.

    Attributes:
        channels: compared outputs. noise: of each, (c,) SI; the unexplained remainder is in it, as
            white noise that is as strong at low frequencies.
        margin: channel -> distance that a prediction keeps from a limit for noise and remainder.
        inputs: channel -> value of what is not commanded, SI. rate: samples a second.
        starts: setup -> channel -> what a machine at rest reads there, SI: its pressures, and what
            it is commanded.
        recorded: setup -> channel -> (lowest, highest), SI. positions: channels that are.
    """

    channels: tuple[str, ...]
    noise: FloatArray
    margin: Mapping[str, float]
    inputs: Mapping[str, float]
    rate: float
    starts: Mapping[SetUp, Mapping[str, float]] = field(default_factory=dict)
    recorded: Mapping[SetUp, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    positions: frozenset[str] = frozenset()

    @staticmethod
    def of(covered: Covered, plant: Plant, command: str) -> Bench:
        """Return the sensors that made the recordings, and what was left unexplained in them."""
        rate = float(f"{covered.rate:.3g}")
        channels = tuple(name for name in plant.outputs if covered.noise.get(name, 0.0) > 0.0)
        alike = _alike(rate)
        noise, margin = [], {}
        for name in channels:
            own, left = covered.noise[name], covered.unexplained.get(name, 0.0)
            noise.append(float(np.sqrt(own**2 + alike * left**2)))
            margin[name] = SIGMAS * own + _REMAINDER * left
        margin |= {name: SIGMAS * own for name, own in covered.input_noise.items()}
        inputs = {name: ends[2] for name, ends in covered.inputs.items() if name != command}
        starts = {
            item.setup: {
                name: value
                for name, value in item.starts.items()
                if (name == command and item.at_rest)
                or (name in plant.roles.pressures and name not in covered.inputs)
            }
            for item in covered.setups
        }
        recorded = {item.setup: item.extremes for item in covered.setups}
        positions = frozenset(plant.roles.rate_of)
        return Bench(channels, np.array(noise), margin, inputs, rate, starts, recorded, positions)

    def beyond(self, setup: SetUp, readings: Mapping[str, FloatArray]) -> Bench:
        """Return it with the error of forms where predictions go beyond what was recorded.

        Two forms that are alike in what was recorded part further away from it, and so does the
        machine from both: an error of `_FORM` of the way beyond, in the noise as a remainder is.
        Another place is no further out by itself: how fast a machine goes and what it carries is.

        Args:
            setup: of the trial. readings: channel -> predictions, SI.
        """
        known, alike = self.recorded.get(setup, {}), _alike(self.rate)
        noise = self.noise.copy()
        for column, name in enumerate(self.channels):
            if name in self.positions:
                continue
            low, high = known.get(name, (math.inf, -math.inf))
            lowest, highest = float(readings[name].min()), float(readings[name].max())
            inside = max(min(highest, high) - max(lowest, low), 0.0)
            noise[column] = math.sqrt(
                noise[column] ** 2 + alike * (_FORM * (highest - lowest - inside)) ** 2
            )
        return replace(self, noise=noise)


def _alike(rate: float) -> float:
    """Return how many samples of an unexplained remainder are as one."""
    return max(1.0, MEMORY * rate)


@dataclass(frozen=True)
class LimitMargin:
    """How near a trial comes to one limit, over all that was simulated.

    Attributes:
        channel: what is limited. limit: what it has to keep. low, high: extremes that a thousand
            draws would reach, SI.
        used: share of the way from where it starts to the limit; the margin for noise and
            remainder is used as well. 1 is at the limit.
    """

    channel: str
    low: float
    high: float
    limit: Limit
    used: float


@dataclass(frozen=True)
class Responses:
    """One trial, simulated.

    Attributes:
        trial: what was simulated.
        outputs: of each rival, (m, n, outputs) SI.
        bench: what measures it, with the error of forms where it goes beyond what was recorded.
        rooms: what is left of every limit.
    """

    trial: Trial
    outputs: tuple[FloatArray, ...]
    bench: Bench
    rooms: tuple[LimitMargin, ...]

    @property
    def safe(self) -> bool:
        """Whether every extreme keeps its limit with margin, and nothing ran away."""
        finite = all(np.isfinite(item).all() for item in self.outputs)
        return finite and all(room.used <= 1.0 for room in self.rooms)


def respond(
    rivals: Sequence[Hypothesis],
    draws: Sequence[FloatArray],
    trial: Trial,
    bench: Bench,
    limits: Mapping[str, Limit],
    commanded: Commanded,
) -> Responses:
    """Simulate a trial without a controller of its own, by every rival.

    Args:
        rivals: explanations. draws: (m, p) coordinates of each rival's posterior.
        trial: to run. bench: sensors. limits: by channel. commanded: what the trial gives.
    """
    reference = trial.reference(trial.clock())
    setup = (trial.setup.piston, trial.setup.bypass)
    vectors = [rival.at(z) for rival, z in zip(rivals, draws, strict=True)]
    vectors = [
        own if rival.doubted is None else np.vstack((own, rival.doubted))
        for rival, own in zip(rivals, vectors, strict=True)
    ]
    cases = [
        _after_command(rivals, vectors, trial, bench, commanded, before)
        for before in commanded.before(trial, reference, bench.starts.get(setup, {}))
    ]
    # what is doubted counts where a limit is kept, and tells no rivals apart
    likeliest = tuple(item[: len(z)] for item, z in zip(cases[0], draws, strict=True))
    fitted = np.stack([item[0] for item in likeliest])
    names = rivals[0].model.plant.outputs
    here = bench.beyond(
        setup,
        {name: fitted[:, :, column] for column, name in enumerate(names)},
    )
    every = [np.concatenate(own) for own in zip(*cases, strict=True)]
    repeated = [np.concatenate([own] * len(cases)) for own in vectors]
    return Responses(trial, likeliest, here, rooms_of(rivals, repeated, every, bench, limits))


def _after_command(
    rivals: Sequence[Hypothesis],
    vectors: Sequence[FloatArray],
    trial: Trial,
    bench: Bench,
    commanded: Commanded,
    before: BeforeTrial,
) -> tuple[FloatArray, ...]:
    """Return the outputs of a trial before which a machine stood so, by every rival."""
    reference = trial.reference(trial.clock())
    rest = round(REST * trial.sample_rate)
    command = np.concatenate((np.full(rest, before.command), reference))
    inputs = {name: np.full(command.size, value) for name, value in bench.inputs.items()}
    inputs[commanded.channel] = command
    places = commanded.start(trial, reference)
    start = rivals[0].model.plant.unbent({**before.pressures, **places})
    start.pop(commanded.channel, None)
    drive = Drive(
        np.arange(command.size) / trial.sample_rate,
        inputs,
        start,
        locked=trial.setup.piston is Piston.LOCKED,
        bypass_open=trial.setup.bypass is Bypass.OPEN,
    )
    return tuple(
        _after_rest(readings, rest, {} if commanded.follows else _places_at_start(rival, start))
        for rival, readings in zip(rivals, predicted_readings(rivals, vectors, drive), strict=True)
    )


def _places_at_start(rival: Hypothesis, start: Mapping[str, float]) -> dict[int, float]:
    """Return the columns that show positions, and where each starts, SI."""
    plant = rival.model.plant
    positions = plant.position_range(rival.vector)
    return {
        column: start.get(name, 0.0)
        for column, name in enumerate(plant.outputs)
        if name in positions
    }


def _after_rest(readings: FloatArray, rest: int, starts: Mapping[int, float]) -> FloatArray:
    """Return readings from the tick `rest` on; positions start where they are read first."""
    after = readings[:, rest:]
    for column, value in starts.items():
        after[:, :, column] += value - after[:, :1, column]
    return after


def largest(
    rivals: Sequence[Hypothesis],
    draws: Sequence[FloatArray],
    candidate: Experiment,
    plan: ExperimentSettings,
    bench: Bench,
    limits: Mapping[str, Limit],
) -> Experiment | None:
    """Return an experiment at the largest size that keeps every limit; None where none does.

    Args:
        rivals, draws, bench, limits: as of `respond`. candidate: at its full size.
        plan: what all trials have in common.
    """
    for size in _SIZES:
        item = candidate.at_size(size * candidate.size)
        trial = plan.trials([item], ["t"])[0]
        if respond(rivals, draws, trial, bench, limits, plan.commanded).safe:
            return item
    return None


def predicted_readings(
    rivals: Sequence[Hypothesis], vectors: Sequence[FloatArray], drive: Drive
) -> tuple[FloatArray, ...]:
    """Return what each rival's sensors would read without noise, (m, n, outputs) SI.

    Args:
        rivals: explanations. vectors: (m, size) parameters of each. drive: inputs and setup.
    """
    tasks = [
        (number, block)
        for number, own in enumerate(vectors)
        for block in np.array_split(own, max(1, round(len(own) / LANES)))
    ]

    def one(task: tuple[int, FloatArray]) -> FloatArray:
        with np.errstate(all="ignore"):
            return rivals[task[0]].model.plant.sweep(task[1], drive, STEP)

    found = list(_pool().map(one, tasks))
    return tuple(
        np.concatenate(
            [item for (owner, _), item in zip(tasks, found, strict=True) if owner == number]
        )
        for number in range(len(rivals))
    )


def rooms_of(
    rivals: Sequence[Hypothesis],
    vectors: Sequence[FloatArray],
    outputs: Sequence[FloatArray],
    bench: Bench,
    limits: Mapping[str, Limit],
) -> tuple[LimitMargin, ...]:
    """Return how near simulations come to every limit; the fullest first."""
    found = []
    for name, limit in limits.items():
        curves = [
            curve
            for rival, own, some in zip(rivals, vectors, outputs, strict=True)
            for curve in _channel(rival, own, some, name)
        ]
        if curves:
            found.append(_room(name, np.stack(curves), limit, bench))
    return tuple(sorted(found, key=lambda room: -room.used))


def _channel(
    rival: Hypothesis, vectors: FloatArray, outputs: FloatArray, name: str
) -> list[FloatArray]:
    """Return a channel of each simulation: an output, or what follows from outputs."""
    plant = rival.model.plant
    places = {output: k for k, output in enumerate(plant.outputs)}
    if name in places:
        return list(outputs[:, :, places[name]])
    if name == "pressure_difference" and {"pressure_a", "pressure_b"} <= places.keys():
        return list(outputs[:, :, places["pressure_a"]] - outputs[:, :, places["pressure_b"]])
    if name not in plant.derived_channels:
        return []
    with np.errstate(all="ignore"):
        return [
            plant.derived(vector, {o: some[:, k] for o, k in places.items()})[name]
            for vector, some in zip(vectors, outputs, strict=True)
        ]


def _room(name: str, curves: FloatArray, limit: Limit, bench: Bench) -> LimitMargin:
    margin = bench.margin.get(name, 0.0)
    if name == "pressure_difference":
        margin = bench.margin.get("pressure_a", 0.0) + bench.margin.get("pressure_b", 0.0)
    high = _furthest(curves.max(axis=1))
    low = -_furthest(-curves.min(axis=1))
    begin = float(np.median(curves[:, 0]))
    used = 0.0
    for end, extreme, side in ((limit.high, high, 1.0), (limit.low, low, -1.0)):
        way = side * (end - begin)
        if not np.isfinite(end):
            continue
        gone = side * (extreme - begin) + margin
        allowed = (1.0 - SHARE) * way
        if allowed > 0.0:
            used = max(used, gone / allowed)
        # what starts at its limit, as a shaft at rest against a stop, may stay there
        elif gone > margin or -way > margin + SHARE * _width_of(limit):
            used = np.inf
    if np.isfinite(limit.rate):
        rate = float(np.abs(np.diff(curves, axis=1)).max()) * bench.rate
        used = max(used, (rate + 1.5 * margin * bench.rate) / ((1.0 - SHARE) * limit.rate))
    return LimitMargin(name, low, high, limit, float(used) if np.isfinite(used) else 1e9)


def _width_of(limit: Limit) -> float:
    """Return the distance between two limits, or from 0 where there is one."""
    ends = [end for end in (limit.low, limit.high) if math.isfinite(end)]
    return ends[1] - ends[0] if len(ends) > 1 else abs(ends[0])


def _furthest(tops: FloatArray) -> float:
    """Return how far an extreme may go: of those simulated, or of a thousand draws like them."""
    return float(max(tops.max(), tops.mean() + _TAIL * tops.std()))


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that simulate: the kernel runs without the interpreter's lock."""
    return ThreadPoolExecutor(usable_processors(), thread_name_prefix="experiment")
