"""What held-out runs show that training runs do not.

Where nothing is missing, a model that explains the training runs down to their noise explains runs
that were never fitted about as well. Where it does not, something acts where training did not go:
the verdict is no `none`, and the place is looked for in the held-out runs themselves. No effect is
accepted on them: they were left out to judge, not to choose. Beside effects that were found it is
a note.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite, nan
from typing import Final

from eha_bench.diagnosis.data.dataset import Dataset
from eha_bench.diagnosis.fit.thresholds import Thresholds
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Verdict
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError

SHOWN_BY_HELD_OUT: Final = "held-out runs show what training runs do not"
"""How a note on it begins."""
_LIKELY = 2.0
"""Standard deviations up to which an error may be that of what was fitted."""


def beyond_training(
    found: Diagnosis, limits: Thresholds, spread: Callable[[], Mapping[str, float]] = dict
) -> str:
    """Say what held-out runs show that training runs do not, or nothing.

    Args:
        found: with its errors. limits: of growth. spread: asked where whole replays have grown for
            channel -> what the fitted numbers change there, SI, as uncertain as they are. A wheel's
            angle of a long run tells its friction better than windows do that were fitted.
    """
    windows = _worst(found, _over_windows, limits.windows)
    replays = _worst(found, _over_replays, limits.replays)
    if windows is None and replays is not None:
        replays = _worst(found, _over_replays, limits.replays, spread())
    worst = windows or replays
    if worst is None:
        return ""
    name, seen, trained = worst
    over = "over short windows" if windows else "as whole replays"
    return (
        f"{SHOWN_BY_HELD_OUT}: {over} '{name}' errs by {seen:.3g} times "
        f"its noise there, and by {trained:.3g} times in training"
    )


def unchecked(found: Diagnosis, dataset: Dataset) -> str:
    """Say that effects were found which no held-out run can speak against, or nothing."""
    if found.verdict is not Verdict.EFFECT or dataset.held_out:
        return ""
    return (
        "no run is held out, so nothing checks what was found on motions that it was not fitted "
        "to: give a run 'use: holdout'"
    )


def _worst(
    diagnosis: Diagnosis,
    in_floors: Callable[[ChannelError], float],
    limit: float,
    spread: Mapping[str, float] | None = None,
) -> tuple[str, float, float] | None:
    """Return the channel whose error grows most, in noise floors there and in training.

    Args:
        diagnosis: with its errors. in_floors: an error in them. limit: of growth.
        spread: channel -> what its error may be there by the uncertainty of what was fitted, SI.
    """
    found: list[tuple[float, str, float, float]] = []
    for name, item in diagnosis.holdout.items():
        if name not in diagnosis.train:
            continue
        if spread and item.after <= _LIKELY * spread.get(name, 0.0):
            continue
        seen, trained = in_floors(item), in_floors(diagnosis.train[name])
        if isfinite(trained) and seen > limit * max(trained, 1.0):
            found.append((seen / max(trained, 1.0), name, seen, trained))
    return max(found)[1:] if found else None


def _over_windows(error: ChannelError) -> float:
    return error.after_windows / error.noise_floor if error.noise_floor > 0.0 else nan


def _over_replays(error: ChannelError) -> float:
    return error.after / error.replay_floor if error.replay_floor > 0.0 else nan
