"""Ranks recordings that exist already by how surely they would decide what a diagnosis left open.

A recording's inputs and first sample are simulated by every rival, over its posterior; what it
measured is not looked at, so the ranking says which to take up next and prejudges nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.errors import EhaBenchError, InputError
from eha_bench.core.file_kind import kind_by_keys
from eha_bench.core.finite import finite_or_none
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.core.yaml_file import peek
from eha_bench.diagnosis.data.dataset import Dataset, Run, load_dataset
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.replay.first_sample import first_state
from eha_bench.experiment.decision import (
    BLOCK,
    inner_products,
    layout_of,
    odds,
    posterior_after,
    shares_of_a_decision,
)
from eha_bench.experiment.hypothesis import Hypothesis, Question, read_question, rivals_to_separate
from eha_bench.experiment.narrowing import worst_width
from eha_bench.experiment.propose import no_progress
from eha_bench.experiment.response import Bench, predicted_readings
from eha_bench.recordings import read
from eha_bench.suites import trial_from_source

_DRAWS = 12


@dataclass(frozen=True)
class RankedRecording:
    """One recording.

    Attributes:
        name: of its file. seconds: its length.
        right, wrong: probability that the right rival is named with it, and that another one is;
            NaN where there is one rival.
        reached: what it gives, as a share of what a decision needs; of one rival, of what the
            widest interval needs.
        why: why it was not ranked; "" where it was.
    """

    name: str
    seconds: float
    right: float
    wrong: float
    reached: float
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "name": self.name,
            "seconds": finite_or_none(self.seconds),
            "probability_right": finite_or_none(self.right),
            "probability_wrong": finite_or_none(self.wrong),
            "reached": finite_or_none(self.reached),
            "why": self.why,
        }


def rank(
    diagnosis: str | Path,
    logs: Sequence[str | Path],
    *,
    channels: str | Path | None = None,
    within: float = 0.1,
    seed: int = 0,
    progress: Callable[[str, float], None] = no_progress,
) -> tuple[RankedRecording, ...]:
    """Return recordings, the one that would decide most surely first.

    Args:
        diagnosis: diagnosis.json, or its folder.
        logs: recordings, or a dataset.yaml whose runs are ranked with the setups it gives them.
        channels: channels.yaml of foreign logs. within: half of an interval that is asked for.
        seed: of the draws. progress: called with the stage and the fraction of it done.

    Raises:
        InputError: no diagnosis, or no recording was given.
    """
    question = read_question(diagnosis)
    rivals = rivals_to_separate(question.rivals)
    plant = rivals[0].model.plant
    bench = Bench.of(question.covered, plant.outputs, plant.command)
    runs = list(_runs(question, logs, channels))
    if not runs:
        raise InputError("no recording was given", hint="name logs, or a dataset.yaml")
    found = []
    for number, (run, inputs) in enumerate(runs):
        progress("recordings", number / len(runs))
        try:
            found.append(_rank_recording(rivals, run, inputs, bench, within, seed))
        except EhaBenchError as error:
            found.append(RankedRecording(run.log.name, np.nan, np.nan, np.nan, -1.0, str(error)))
    return tuple(sorted(found, key=lambda item: (
        -np.nan_to_num(item.right, nan=-1.0), -item.reached)))  # fmt: skip


def _runs(
    question: Question, logs: Sequence[str | Path], channels: str | Path | None
) -> Iterator[tuple[Run, tuple[str, ...]]]:
    """Yield runs with what drives them: of a dataset, or of logs by themselves."""
    for log in map(Path, logs):
        if log.suffix in (".yaml", ".yml") and log.name != "metadata.yaml":
            kind = kind_by_keys(peek(log))
            if kind is not None and kind.name == "dataset":
                dataset: Dataset = load_dataset(log)
                yield from ((run, dataset.inputs) for run in dataset.runs)
                continue
        content: dict[str, Any] = {
            "model": str(question.source.parent / "recalibrated.yaml"),
            "inputs": list(question.covered.inputs),
            "runs": [{"log": str(log.resolve()), "use": "train", **_setup(log)}],
        }
        if channels is not None:
            content["channels"] = str(Path(channels).resolve())
        alone = load_dataset(content)
        yield from ((run, alone.inputs) for run in alone.runs)


def _setup(log: Path) -> dict[str, str]:
    """Return the setup that our own recordings carry with their trial."""
    if log.suffix != ".mcap":
        return {}
    try:
        source = read(log).attachments.get("trial.json")
        if source is None:
            return {}
        trial: Trial = trial_from_source(source.decode("utf-8", "replace"))
    except EhaBenchError:
        return {}
    piston, bypass = trial.setup.piston, trial.setup.bypass
    return {"piston": Piston(piston).value, "bypass": Bypass(bypass).value}


def _rank_recording(
    rivals: Sequence[Hypothesis],
    run: Run,
    inputs: tuple[str, ...],
    bench: Bench,
    within: float,
    seed: int,
) -> RankedRecording:
    plant = rivals[0].model.plant
    measured = admit(run, run.read(), inputs, plant.determined(inputs), strict=False,
                     roles=plant.roles)  # fmt: skip
    count = measured.time.size
    seconds = float(measured.time[-1])
    drive = measured.drive(0, count, first_state(measured, rivals[0].model))
    draws = _DRAWS if len(rivals) > 1 else 0
    layout = layout_of(rivals, draws, np.random.default_rng([seed, 4]))
    layout_vectors = [
        np.stack([run.vector(plant.layout, vector) for vector in rival.at(z)])
        for rival, z in zip(rivals, layout.points, strict=True)
    ]
    outputs = predicted_readings(rivals, layout_vectors, drive)
    if not all(np.isfinite(item).all() for item in outputs):
        why = "a rival's simulation of it diverges"
        return RankedRecording(run.name, seconds, np.nan, np.nan, -1.0, why)
    known = replace(
        bench,
        channels=tuple(name for name in bench.channels if name not in inputs),
        noise=np.array([noise for name, noise in zip(bench.channels, bench.noise, strict=True)
                        if name not in inputs]),
    )  # fmt: skip
    ends = np.searchsorted(measured.time, np.arange(BLOCK, seconds, BLOCK))
    ticks = [int(tick) for tick in np.unique(np.append(ends[ends >= 2], count))]
    grams = inner_products(layout, outputs, plant.outputs, known, ticks, [seed, 5])
    if len(rivals) == 1:
        worst = worst_width(rivals[0], posterior_after(rivals[0], layout, grams[-1], 0))
        return RankedRecording(run.name, seconds, np.nan, np.nan, (within / max(worst, 1e-12)) ** 2)
    found = odds(layout, grams[-1:])[0]
    reached = float(shares_of_a_decision(layout, grams)[-1])
    return RankedRecording(run.name, seconds, found.right, found.wrong, reached)
