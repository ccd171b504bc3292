"""Ranks recordings that exist already: which to take up next after a diagnosis.

Where the diagnosis explains its recordings, by how surely one would decide what is open. Its inputs
and first sample are simulated by every rival, over its posterior, and what it measured is not
looked at. Where more than the noise is left unexplained, no rival is the truth, and what they
predict of each other says little: recordings are ranked by how badly the model predicts them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.file_kind import kind_by_keys
from eha_bench.core.finite import finite_or_none
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.core.yaml_file import peek
from eha_bench.diagnosis.data.dataset import Dataset, Run, load_dataset
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.measured import Measured
from eha_bench.diagnosis.replay.first_sample import first_state
from eha_bench.experiment.decision import (
    BLOCK,
    DrawRows,
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
from eha_bench.posterior.covered import Covered
from eha_bench.recordings import read
from eha_bench.suites import trial_from_source

_DRAWS = 12
_WILD = set("*?[")
"""What makes a pattern of a name."""


@dataclass(frozen=True)
class RankedRecording:
    """One recording.

    Attributes:
        name: of its file. seconds: its length.
        right, wrong: probability that the right rival is named with it, and that another one is;
            NaN where there is one rival.
        reached: what it gives, as a share of what a decision needs; of one rival, of what the
            widest interval needs; NaN where it is ranked by its error.
        why: why it was not ranked; "" where it was.
        error: root mean square of what the model errs by there, over what it erred by in what was
            fitted; NaN where the diagnosis explains its recordings.
    """

    name: str
    seconds: float
    right: float
    wrong: float
    reached: float
    why: str = ""
    error: float = np.nan

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "name": self.name,
            "seconds": finite_or_none(self.seconds),
            "probability_right": finite_or_none(self.right),
            "probability_wrong": finite_or_none(self.wrong),
            "reached": finite_or_none(self.reached),
            "error_over_fitted": finite_or_none(self.error),
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
    if not question.covered.is_explained:
        rivals = rivals[:1]
    runs = list(_runs(question, logs, channels))
    if not runs:
        raise InputError("no recording was given", hint="name logs, or a dataset.yaml")
    found = []
    for number, (run, inputs) in enumerate(runs):
        progress("recordings", number / len(runs))
        try:
            recording = PredictedRecording.read(run, inputs, rivals, seed)
            if question.covered.is_explained:
                found.append(_by_decision(recording, question.covered, within, seed))
            else:
                found.append(_by_error(recording, question.covered))
        except EhaBenchError as error:
            found.append(RankedRecording(run.log.name, np.nan, np.nan, np.nan, -1.0, str(error)))
    return tuple(sorted(_told_apart(found, [run.log for run, _ in runs]), key=_place))


def _told_apart(
    found: Sequence[RankedRecording], logs: Sequence[Path]
) -> Iterator[RankedRecording]:
    """Yield recordings, those that share a name by as much of their paths as tells them apart."""
    for item, log in zip(found, logs, strict=True):
        others = {other.resolve() for other in logs if other.name == log.name} - {log.resolve()}
        own = log.resolve().parts
        depth = 1
        while depth < len(own) and any(other.parts[-depth:] == own[-depth:] for other in others):
            depth += 1
        yield replace(item, name=str(Path(*own[-depth:]))) if depth > 1 else item


def _place(item: RankedRecording) -> tuple[float, float, float]:
    """Return what recordings are sorted by; one that was not ranked comes last."""
    if item.why:
        return (1.0, 0.0, 0.0)
    return (
        -np.nan_to_num(item.error, nan=0.0),
        -np.nan_to_num(item.right, nan=0.0),
        -np.nan_to_num(item.reached, nan=0.0),
    )


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
        if not log.exists() and not _WILD & set(str(log)):
            raise InputError("no such recording", where=Place(file=str(log)))
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


@dataclass(frozen=True)
class PredictedRecording:
    """A recording, and what every rival predicts of it over draws of its posterior.

    Attributes:
        measured: as read. inputs: channels that drive it. rivals: explanations.
        layout: of the draws. outputs: of each rival, (m, n, outputs) SI.
    """

    measured: Measured
    inputs: tuple[str, ...]
    rivals: Sequence[Hypothesis]
    layout: DrawRows
    outputs: tuple[FloatArray, ...]

    @staticmethod
    def read(
        run: Run, inputs: tuple[str, ...], rivals: Sequence[Hypothesis], seed: int
    ) -> PredictedRecording:
        """Read a run and simulate it by every rival.

        Raises:
            EhaBenchError: it cannot be read, or a simulation of it diverges.
        """
        plant = rivals[0].model.plant
        measured = admit(run, run.read(), inputs, plant.determined(inputs), strict=False,
                         roles=plant.roles)  # fmt: skip
        drive = measured.drive(0, measured.time.size, first_state(measured, rivals[0].model))
        draws = _DRAWS if len(rivals) > 1 else 0
        layout = layout_of(rivals, draws, np.random.default_rng([seed, 4]))
        vectors = [
            np.stack([run.vector(plant.layout, vector) for vector in rival.at(z)])
            for rival, z in zip(rivals, layout.points, strict=True)
        ]
        outputs = predicted_readings(rivals, vectors, drive)
        if not all(np.isfinite(item).all() for item in outputs):
            raise InputError("a rival's simulation of it diverges")
        return PredictedRecording(measured, inputs, rivals, layout, outputs)

    @property
    def seconds(self) -> float:
        """Its length, s."""
        return float(self.measured.time[-1])


def _by_error(recording: PredictedRecording, covered: Covered) -> RankedRecording:
    """Return a recording with what the first rival errs by in it."""
    measured, plant = recording.measured, recording.rivals[0].model.plant
    squares = []
    for column, name in enumerate(measured.outputs):
        valid, usual = measured.valid[:, column], covered.error(name)
        if name in recording.inputs or not valid.any() or not usual > 0.0:
            continue
        simulated = measured.at_sample_instants(
            name, recording.outputs[0][0, :, plant.outputs.index(name)], measured.lateness
        )
        missed = (measured.values[:, column] - simulated)[valid]
        squares.append(float(np.mean(np.square(missed / usual))))
    if not squares:
        raise InputError("it has no channel that was fitted")
    return RankedRecording(
        measured.run.name, recording.seconds, np.nan, np.nan, np.nan,
        error=math.sqrt(sum(squares) / len(squares)),
    )  # fmt: skip


def _by_decision(
    recording: PredictedRecording, covered: Covered, within: float, seed: int
) -> RankedRecording:
    """Return a recording with how surely it decides between rivals, or tells one's parameters."""
    rivals, layout, measured = recording.rivals, recording.layout, recording.measured
    plant = rivals[0].model.plant
    bench = Bench.of(covered, plant, "")
    known = replace(
        bench,
        channels=tuple(name for name in bench.channels if name not in recording.inputs),
        noise=np.array([noise for name, noise in zip(bench.channels, bench.noise, strict=True)
                        if name not in recording.inputs]),
    )  # fmt: skip
    name, seconds = measured.run.name, recording.seconds
    ends = np.searchsorted(measured.time, np.arange(BLOCK, seconds, BLOCK))
    ticks = [int(tick) for tick in np.unique(np.append(ends[ends >= 2], measured.time.size))]
    grams = inner_products(layout, recording.outputs, plant.outputs, known, ticks, [seed, 5])
    if len(rivals) == 1:
        worst = worst_width(rivals[0], posterior_after(rivals[0], layout, grams[-1], 0))
        return RankedRecording(name, seconds, np.nan, np.nan, (within / max(worst, 1e-12)) ** 2)
    found = odds(layout, grams[-1:])[0]
    reached = float(shares_of_a_decision(layout, grams)[-1])
    return RankedRecording(name, seconds, found.right, found.wrong, reached)
