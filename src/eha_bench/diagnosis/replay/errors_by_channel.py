"""Simulation error by channel, before and after, with the noise floor; root mean square, SI.

The errors that count are those of whole runs replayed freely, from a start within the noise of
their first sample. Next to them stand those of `predict`, from the first sample as it is: the same
but for the channels that one noisy sample moves for good, as a free rod's position. And those over
the windows of the fit (locked and bypassed runs whole, free ones about 0.4 s): where small errors
add up over a whole run, these say how good the equations are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.diagnosis.replay.replay import Replay

_MOVED = 2.0
_ADDED_UP = 3.0
_BENT = 1.5
"""Error over the declared model's from which what was calibrated has been bent."""
_SPOILED = 1.3
"""Error of a channel over what it was, from which what was added spoils it: of 130 diagnoses by
three simulators two had more, a wrong cause and one whose position drifts."""


@dataclass(frozen=True)
class ChannelError:
    """Root mean square errors of one channel, SI.

    Attributes:
        uncalibrated: of the declared model. before: recalibrated, without what was found.
        after: with it. All three over whole runs, replayed freely; inf where a replay diverges.
        noise_floor: of the channel's noise.
        unit: of all of them.
        before_predict, after_predict: as `predict` gives it, from the first sample as it is.
        before_windows, after_windows: over the windows of the fit.
        start: what one standard deviation of the first sample changes in a whole replay.
    """

    uncalibrated: float
    before: float
    after: float
    noise_floor: float
    unit: str
    before_predict: float = nan
    after_predict: float = nan
    before_windows: float = nan
    after_windows: float = nan
    start: float = nan

    @property
    def replay_floor(self) -> float:
        """What no whole replay goes below: the noise, or what its first sample's noise moves."""
        return max(self.noise_floor, self.start if isfinite(self.start) else 0.0)


def replay_errors(
    replays: Sequence[Replay],
    floors: Mapping[str, float],
    windows: tuple[Mapping[str, float], Mapping[str, float]] = ({}, {}),
) -> dict[str, ChannelError]:
    """Return the errors of the declared, the recalibrated and the revised model, by channel.

    Args:
        replays: by these models.
        floors: channel -> noise floor, SI.
        windows: the recalibrated and the revised model's errors over windows, by channel.
    """
    found = {}
    for name in sorted({name for item in replays for name in item.measured}):
        own = [item for item in replays if name in item.measured]
        errors = [item.errors(name) for item in own]
        predicted = [item.prediction_errors(name) for item in own]
        declared, before, after = (_rms([e[k] for e in errors]) for k in range(3))
        counts = [float(np.isfinite(item.measured[name]).sum()) for item in own]
        moved = [item.moved.get(name, nan) for item in own]
        found[name] = ChannelError(
            declared,
            before,
            after,
            floors.get(name, nan),
            own[0].unit(name),
            _rms([e[1] for e in predicted]),
            _rms([e[2] for e in predicted]),
            windows[0].get(name, nan),
            windows[1].get(name, nan),
            float(np.sqrt(np.average(np.square(moved), weights=counts))) if sum(counts) else nan,
        )
    return found


def _rms(errors: Sequence[FloatArray]) -> float:
    """Root mean square of errors, NaN where nothing was measured; inf where a replay diverged."""
    total, count = 0.0, 0
    for error in errors:
        there = error[~np.isnan(error)]
        with np.errstate(over="ignore"):
            total += float(there @ there)
        count += there.size
    return float(np.sqrt(total / count)) if count else nan


def replay_notes(
    replays: Sequence[Replay], errors: Mapping[str, ChannelError], runs: str
) -> Iterator[str]:
    """Say where the error of a whole replay tells little about the model, one sentence each.

    Args:
        replays: of one kind of runs. errors: of them. runs: their kind, in words.
    """
    loose = [
        f"{name} of {item.run} by {moved / errors[name].noise_floor:.1f}"
        for item in replays
        for name, moved in item.moved.items()
        if name in errors and moved > _MOVED * errors[name].noise_floor
    ]
    if loose:
        yield (
            f"one standard deviation of the first sample moves a whole replay ({', '.join(loose)} "
            "noise floors): such runs are replayed from the best-fitting start within that noise, "
            "while predict starts from the sample itself"
        )
    added_up = []
    for name, error in errors.items():
        if error.after == inf:
            yield f"a whole replay of {name} in {runs} runs diverges with the revised model"
        elif error.after > _ADDED_UP * max(error.after_windows, error.noise_floor):
            added_up.append(
                f"{name} to {error.after:.3g} {error.unit} ({error.after_windows:.3g} in windows)"
            )
    if added_up:
        yield f"small errors add up over whole {runs} runs: {', '.join(added_up)}"


def bent_notes(errors: Mapping[str, ChannelError], runs: str) -> Iterator[str]:
    """Say where the last model is much worse than the declared one, the worst channel alone.

    What is missing bends the parameters that are fitted without it, and runs that were not fitted
    show it.

    Args:
        errors: of runs that were never fitted. runs: their kind, in words.
    """
    if (worst := _worst(errors, lambda item: item.uncalibrated, _BENT)) is not None:
        ratio, name, item = worst
        yield (
            f"CAUTION: on {runs} runs the fitted model errs {ratio:.3g} times as much as the "
            f"declared one in '{name}' ({item.after:.3g} for {item.uncalibrated:.3g} {item.unit}): "
            "what is missing has bent its parameters"
        )


def spoiled_notes(errors: Mapping[str, ChannelError], runs: str) -> Iterator[str]:
    """Say which channel errs more with what was added than without it, the worst alone.

    A wrong cause may lower the error of all channels together and raise that of one; so may a right
    one, where a position adds up small errors over a whole run.

    Args:
        errors: of runs that were never fitted. runs: their kind, in words.
    """
    if (worst := _worst(errors, lambda item: item.before, _SPOILED)) is not None:
        ratio, name, item = worst
        yield (
            f"CAUTION: on {runs} runs '{name}' errs {ratio:.3g} times as much with what was added "
            f"as without it ({item.after:.3g} for {item.before:.3g} {item.unit}), though the "
            "channels together err less: look at that channel before you believe it"
        )


def _worst(
    errors: Mapping[str, ChannelError], earlier: Callable[[ChannelError], float], grown: float
) -> tuple[float, str, ChannelError] | None:
    """Return by how much the error has grown most, in which channel; None where none has grown.

    Args:
        errors: by channel. earlier: an error before. grown: growth that counts, of what is as far
            above its floor.
    """
    worse = [
        (item.after / earlier(item), name, item)
        for name, item in errors.items()
        if isfinite(item.after)
        and item.after > grown * earlier(item) > 0.0
        and item.after > grown * item.replay_floor
    ]
    return max(worse, key=lambda found: found[:2], default=None)


def rms_by_channel(problem: Problem, vector: FloatArray) -> dict[str, float]:
    """Return each channel's root mean square error over windows, SI, P1 - P2 included.

    Args:
        problem: prepared at the vector. vector: parameters.
    """
    residual = problem.with_best_start(vector) * problem.scale
    names = problem.plant.outputs
    sums: dict[str, list[float]] = {}
    for piece in problem.pieces:
        rows = residual[piece.rows]
        by_name: dict[str, tuple[IndexArray, FloatArray]] = {}
        for channel, mask in piece.by_channel():
            name = names[channel]
            error = rows[mask]
            by_name[name] = (piece.ticks[mask], error)
            _add(sums, name, error)
        if "pressure_a" in by_name and "pressure_b" in by_name:
            ticks_a, error_a = by_name["pressure_a"]
            ticks_b, error_b = by_name["pressure_b"]
            _, at_a, at_b = np.intersect1d(ticks_a, ticks_b, return_indices=True)
            _add(sums, "pressure_difference", error_a[at_a] - error_b[at_b])
    return {name: float(np.sqrt(total / max(count, 1))) for name, (total, count) in sums.items()}


def _add(sums: dict[str, list[float]], name: str, error: FloatArray) -> None:
    entry = sums.setdefault(name, [0.0, 0.0])
    entry[0] += float(error @ error)
    entry[1] += error.size


def floors(noise: Mapping[str, float]) -> dict[str, float]:
    """Return each channel's noise floor, SI, the pressure difference included."""
    found = dict(noise)
    if "pressure_a" in noise and "pressure_b" in noise:
        found["pressure_difference"] = float(np.hypot(noise["pressure_a"], noise["pressure_b"]))
    return found
