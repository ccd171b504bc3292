"""What an entrant hands back, and the files it is kept in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.league.question import FloatArray, Question

UNKNOWN = "unknown"
"""Cause that is none of the list: something else acts, in the balance that is named."""
EQUATIONS = ("", "actuation", "torque", "flow", "force", "measurement")
"""Balances that a cause may act in; "" where it is not said."""


@dataclass(frozen=True)
class Cause:
    """One cause: an effect's id, or `unknown`, and the balance that it acts in."""

    id: str
    equation: str = ""


@dataclass(frozen=True)
class Answer:
    """An entrant's answer.

    Attributes:
        claimed: what is missing, the strongest first; empty where nothing is.
        others: what else was considered, the likeliest first; never counted as an accusation.
        prediction: run -> channel -> (n,) SI at the ticks of the held-out run, by the model with
            what was claimed; infinite or NaN where it cannot be simulated.
    """

    claimed: tuple[Cause, ...]
    others: tuple[Cause, ...] = ()
    prediction: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)

    def checked(self, question: Question) -> Answer:
        """Return the answer itself where it fits its question.

        Raises:
            ValueError: a cause, run or channel that the question does not have, or lacks; an array
                of another length.
        """
        allowed = {*question.effects, UNKNOWN}
        named = [cause.id for cause in (*self.claimed, *self.others)]
        if strange := sorted(set(named) - allowed):
            raise ValueError(f"'{strange[0]}' may not be named; there are {sorted(allowed)}")
        if len(set(named)) < len(named):
            raise ValueError("a cause is named twice")
        if wrong := {cause.equation for cause in (*self.claimed, *self.others)} - {*EQUATIONS}:
            raise ValueError(f"'{wrong.pop()}' is not a balance; there are {EQUATIONS[1:]}")
        for run in question.held_out:
            for channel in question.channels:
                values = self.prediction.get(run.name, {}).get(channel)
                if values is None or np.shape(values) != run.time.shape:
                    raise ValueError(
                        f"'{channel}' of '{run.name}' is to be predicted at {run.time.size} ticks"
                    )
        return self

    def write(self, folder: Path) -> None:
        """Write answer.json and prediction.npz."""
        folder.mkdir(parents=True, exist_ok=True)
        columns = {
            f"{run}/{channel}": values
            for run, channels in self.prediction.items()
            for channel, values in channels.items()
        }
        np.savez_compressed(folder / "prediction.npz", **columns)
        content = {
            "claimed": [asdict(cause) for cause in self.claimed],
            "others": [asdict(cause) for cause in self.others],
        }
        (folder / "answer.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def read_answer(folder: Path) -> Answer:
    """Return the answer that a folder holds."""
    content = json.loads((folder / "answer.json").read_text(encoding="utf-8"))
    prediction: dict[str, dict[str, FloatArray]] = {}
    with np.load(folder / "prediction.npz") as columns:
        for key in columns.files:
            run, _, channel = key.rpartition("/")
            prediction.setdefault(run, {})[channel] = columns[key]
    return Answer(
        tuple(Cause(**entry) for entry in content["claimed"]),
        tuple(Cause(**entry) for entry in content["others"]),
        prediction,
    )
