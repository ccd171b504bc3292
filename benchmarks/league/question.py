"""What an entrant is given: a data set to learn from, and runs to predict."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fixtures.rig.sensors import COLUMNS
from numpy.typing import NDArray
from ruamel.yaml import YAML

from eha_bench.diagnosis.data.dataset import Run as Recorded
from eha_bench.diagnosis.data.dataset import Use, load_dataset

FloatArray = NDArray[np.float64]

OPENING = 0.02
"""How much of a held-out run's readings an entrant sees, s: enough to know where it starts."""


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        name: its name. locked: the piston is held. bypass_open: the chambers are joined.
        time: (n,) s from the first sample.
        command: (n,) current asked for, A; held from one sample to the next.
        measured: channel -> (n,) SI; of a run to predict NaN after its opening.
    """

    name: str
    locked: bool
    bypass_open: bool
    time: FloatArray
    command: FloatArray
    measured: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Question:
    """One case.

    Attributes:
        case: its name, which tells nothing.
        dataset: dataset.yaml of the training runs, with the declared model and the logs beside it.
        effects: ids of the causes that may be named.
        training: the same runs as arrays.
        held_out: runs to predict.
        budget: how hard to try, 1 for a league's figures; less for a quick look.
    """

    case: str
    dataset: Path
    effects: tuple[str, ...]
    training: tuple[Run, ...]
    held_out: tuple[Run, ...]
    budget: float = 1.0

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels to predict."""
        return COLUMNS


def ask(
    case: Path, folder: Path, effects: Sequence[str], budget: float = 1.0
) -> tuple[Question, Mapping[str, Mapping[str, FloatArray]]]:
    """Return the question of a recorded case, and what its held-out runs measured.

    Args:
        case: folder of the case, as `fixtures.rig` records it.
        folder: where the entrant's copy is written, without the held-out logs.
        effects: causes that may be named. budget: of the question.

    Returns:
        The question; and run -> channel -> (n,) SI, which only the scorer sees.
    """
    recorded = load_dataset(case / "dataset.yaml").runs
    _copy_training(case, folder, recorded)
    runs = [(item.use, _read(item)) for item in recorded]
    held_out = [run for use, run in runs if use is not Use.TRAIN]
    question = Question(
        case.name,
        folder / "dataset.yaml",
        tuple(effects),
        tuple(run for use, run in runs if use is Use.TRAIN),
        tuple(_opening(run) for run in held_out),
        budget,
    )
    return question, {run.name: run.measured for run in held_out}


def _copy_training(case: Path, folder: Path, recorded: Sequence[Recorded]) -> None:
    """Write a copy of a case that holds no held-out run, whole or not at all."""
    scratch = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(scratch, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)
    scratch.mkdir(parents=True)
    hidden = {run.log.name for run in recorded if run.use is not Use.TRAIN}
    for path in case.iterdir():
        if path.name not in hidden and path.name != "dataset.yaml":
            shutil.copyfile(path, scratch / path.name)
    content = YAML().load(case / "dataset.yaml")
    content["runs"] = [entry for entry in content["runs"] if entry["log"] not in hidden]
    with (scratch / "dataset.yaml").open("w", encoding="utf-8") as file:
        YAML().dump(content, file)
    scratch.rename(folder)


def _read(item: Recorded) -> Run:
    recording = item.read()
    time = np.array(recording.time - recording.time[0])
    measured = {name: np.array(recording[name]) for name in COLUMNS}
    command = np.array(recording["current_command"])
    return Run(item.name, item.locked, item.bypass_open, time, command, measured)


def _opening(run: Run) -> Run:
    """Return a run with nothing measured after its opening."""
    seen = run.time <= OPENING
    return Run(
        run.name, run.locked, run.bypass_open, run.time, run.command,
        {name: np.where(seen, values, np.nan) for name, values in run.measured.items()},
    )  # fmt: skip
