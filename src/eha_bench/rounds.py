"""`eha-bench close`: diagnose, plan, run, diagnose again, until nothing is left open."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from eha_bench.api import diagnose, next_experiment, run
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.interruption import signals_raised_after
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.progress import ProgressHook
from eha_bench.core.result import Result, Status
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.outcome.diagnosis import DIAGNOSIS_FILE, Verdict
from eha_bench.experiment.files import dataset_path, run_folder
from eha_bench.experiment.propose import ASKED, WITHIN
from eha_bench.report.rounds_report import write_rounds_report
from eha_bench.targets.resolve import open_target
from eha_bench.targets.simulator import Simulator
from eha_bench.targets.target import Target

OF = "of.json"
SUMMARY = "rounds.json"
PAGE = "rounds.html"


class Settled(StrEnum):
    """How the rounds ended.

    `settled`: nothing is open. `none_permitted`: no permitted experiment would go further, or none
    can be planned for what is unknown.
    `out_of_rounds`: as many were made as asked for. `stopped`: a run did not come to its end, or
    a step was refused.
    """

    SETTLED = "settled"
    NONE_PERMITTED = "none_permitted"
    OUT_OF_ROUNDS = "out_of_rounds"
    STOPPED = "stopped"


@dataclass(frozen=True)
class Round:
    """One diagnosis, and the experiment that followed it.

    Attributes:
        number: from 1. folder: of all it wrote. diagnosis: content of its diagnosis.json.
        experiment: content of its next.json; None where none was looked for.
        status: of the run; "" where none was made.
        reason: why the rounds stopped in it; "" where they did not.
    """

    number: int
    folder: Path
    diagnosis: Mapping[str, Any]
    experiment: Mapping[str, Any] | None = None
    status: str = ""
    reason: str = ""

    @property
    def verdict(self) -> Verdict:
        """The verdict of its diagnosis."""
        return Verdict(self.diagnosis["verdict"])

    @property
    def causes(self) -> tuple[str, ...]:
        """What was found, each with what the data do not distinguish from it: `a or b`."""
        ties = self.diagnosis.get("equivalent", [])
        found = [item["id"] for item in self.diagnosis.get("effects", [])]
        return tuple(
            " or ".join(next((tie for tie in ties if cause in tie), [cause])) for cause in found
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        experiment = self.experiment or {}
        return {
            "round": self.number,
            "folder": self.folder.name,
            "verdict": self.verdict.value,
            "effects": [item["id"] for item in self.diagnosis.get("effects", [])],
            "equivalent": self.diagnosis.get("equivalent", []),
            "experiment": experiment.get("sentence", ""),
            "trials": [trial["what"] for trial in experiment.get("trials", [])],
            "ending": experiment.get("ending"),
            "probability_right": experiment.get("probability_right"),
            "bench_seconds": experiment.get("bench_seconds"),
            "status": self.status,
            "reason": self.reason,
        }


@dataclass(frozen=True)
class Rounds:
    """All rounds, and how they ended; `notes` are what is to be known of them, a sentence each."""

    ending: Settled
    rounds: tuple[Round, ...]
    folder: Path
    notes: tuple[str, ...] = ()

    @property
    def bench_seconds(self) -> float:
        """Bench time of all experiments that were run, s."""
        return sum(float((item.experiment or {}).get("bench_seconds") or 0.0)
                   for item in self.rounds if item.status)  # fmt: skip

    @property
    def stops(self) -> tuple[str, ...]:
        """Why they stopped, a sentence each."""
        return tuple(_stop(item.number, item.reason) for item in self.rounds if item.reason)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of rounds.json."""
        return {
            "schema_version": 1,
            "ending": self.ending.value,
            "bench_seconds": self.bench_seconds,
            "rounds": [item.to_dict() for item in self.rounds],
            "notes": [*self.notes, *self.stops],
        }


def _stop(number: int, reason: str) -> str:
    return f"round {number} stopped: {reason}"


@signals_raised_after()
def close(
    dataset: str | Path,
    target: str | Path,
    out: str | Path,
    *,
    rounds: int = 3,
    budget: float = 30.0,
    safety: str | Path | None = None,
    probability: float = ASKED,
    within: float = WITHIN,
    progress: ProgressHook | None = None,
) -> Rounds:
    """Diagnose, plan the next experiment, run it on a target and diagnose again, until settled.

    What a folder holds already of an earlier call is taken as it is, so the same call goes on where
    it was interrupted.

    Args:
        dataset: dataset.yaml to start from. target: that experiments are run on.
        out: folder of all rounds; rounds.html and rounds.json stand in it.
        rounds: most diagnoses that are followed by an experiment. budget: of each, s.
        safety, probability, within: as `next_experiment` takes them.
        progress: called with the stage and the fraction of it done.

    Raises:
        InputError: a file is wrong or missing, the folder holds rounds of another dataset, or the
            target has none of the channels of the dataset's plant. Where rounds were begun,
            rounds.json and rounds.html say so as well.
    """
    folder = writable(Path(out))
    # before the first diagnosis, which takes minutes, not after it
    with noting_inputs() as read:
        opened = open_target(str(target))
    files = [*read, dataset, safety]
    if (folder / "round-1" / "diagnosis" / DIAGNOSIS_FILE).exists():
        notes = _notes_of(folder)
    else:
        loaded = load_dataset(dataset)
        files += loaded.files
        notes = _beside_the_plant(loaded, opened, target)
    own = (OF, SUMMARY, PAGE, *(f"round-{number}" for number in range(1, rounds + 2)))
    spare_inputs((folder / name for name in own), files)
    tell = progress or (lambda _stage, _fraction: None)
    _own(folder, dataset, target)
    plan = partial(_plan_once, tell=tell, budget=budget, safety=safety, probability=probability,
                   within=within)  # fmt: skip
    done: list[Round] = []
    try:
        ending = _go_round(done, folder, Path(dataset), target, notes, rounds, plan, tell)
    except EhaBenchError as error:
        if done:
            done[-1] = replace(done[-1], reason=str(error))
            _write(Rounds(Settled.STOPPED, tuple(done), folder, notes))
        raise
    found = Rounds(ending, tuple(done), folder, notes)
    _write(found)
    return found


def _go_round(
    done: list[Round],
    folder: Path,
    dataset: Path,
    target: str | Path,
    notes: tuple[str, ...],
    rounds: int,
    plan: Callable[[Path, Path], Mapping[str, Any]],
    tell: ProgressHook,
) -> Settled:
    """Make the rounds, and return how they ended.

    Args:
        done: takes every round, as far as it came. plan: returns the content of next.json for a
            round's folder and the suite to write. Others: as of `close`.
    """
    current = dataset
    for number in range(1, rounds + 2):
        place = folder / f"round-{number}"
        done.append(Round(number, place, _diagnose_once(current, place / "diagnosis", tell)))
        if number > rounds and done[-1].diagnosis.get("equivalent"):
            return Settled.OUT_OF_ROUNDS
        suite = place / "next.yaml"
        planned = plan(place, suite)
        done[-1] = replace(done[-1], experiment=planned)
        if planned["ending"] != "proposed":
            return _settled(planned, done[-1].verdict)
        if number > rounds:
            return Settled.OUT_OF_ROUNDS
        tell(f"run {number}", 0.0)
        result = run(suite, target, run_folder(suite), resume=run_folder(suite).exists())
        stopped = result.status in (Status.FAULT, Status.INCOMPLETE)
        why = _why_stopped(result) if stopped else ""
        done[-1] = replace(done[-1], status=result.status.value, reason=why)
        if stopped:
            return Settled.STOPPED
        _write(Rounds(Settled.OUT_OF_ROUNDS, tuple(done), folder, notes))
        current = dataset_path(suite)
    return Settled.OUT_OF_ROUNDS


def _settled(planned: Mapping[str, Any], verdict: Verdict) -> Settled:
    """Return how rounds end after which nothing is proposed."""
    # earlier versions had nothing open where something unknown had no rival
    open_ = planned["ending"] == "none_permitted" or verdict is Verdict.UNKNOWN
    return Settled.NONE_PERMITTED if open_ else Settled.SETTLED


def _why_stopped(result: Result) -> str:
    """Say why a run did not come to its end."""
    found = [
        f"{item.id}: {item.reason}"
        for item in result.trials
        if item.reason and item.status in (Status.FAULT, Status.INCOMPLETE)
    ]
    return "; ".join(found) or "the run was interrupted"


def _notes_of(folder: Path) -> tuple[str, ...]:
    """Return what was noted when the rounds of a folder were begun; not why they stopped."""
    file = folder / SUMMARY
    if not file.exists():
        return ()
    content = json.loads(file.read_text(encoding="utf-8"))
    stops = {_stop(item["round"], item.get("reason", "")) for item in content.get("rounds", ())}
    return tuple(note for note in content.get("notes", ()) if note not in stops)


def _beside_the_plant(dataset: Dataset, opened: Target, target: str | Path) -> tuple[str, ...]:
    """Return a note where a simulator is of another plant than a dataset.

    A plant with more detail may well play the machine.

    Raises:
        InputError: the target has none of the plant's channels.
    """
    own = dataset.model.plant
    channels = {*own.outputs, *own.states, *own.derived_channels}
    if opened.units is not None and not opened.units.keys() & channels:
        raise InputError(
            f"records none of {', '.join(own.outputs)}, and the dataset is of '{own.id}'",
            where=Place(file=str(target)),
            hint="its experiments would tell nothing of the model; give --target the machine "
            "that the recordings are of, or a simulator of it",
        )
    if isinstance(opened, Simulator) and opened.model.plant.id != own.id:
        return (
            f"{target} simulates '{opened.model.plant.id}', and the dataset's model is "
            f"'{own.id}': what its experiments tell is right only where both are one machine",
        )
    return ()


def _own(folder: Path, dataset: str | Path, target: str | Path) -> None:
    """Refuse a folder whose rounds are of something else."""
    asked = {"dataset": str(Path(dataset).resolve()), "target": str(target)}
    file = folder / OF
    if file.exists():
        kept = json.loads(file.read_text(encoding="utf-8"))
        if kept != asked:
            raise InputError(
                f"its rounds are of {kept['dataset']} on {kept['target']}",
                where=Place(file=str(folder)),
                hint="name another folder with --out",
            )
        return
    folder.mkdir(parents=True, exist_ok=True)
    write_text(file, json.dumps(asked, indent=1) + "\n")


def _diagnose_once(dataset: Path, place: Path, tell: ProgressHook) -> Mapping[str, Any]:
    file = place / DIAGNOSIS_FILE
    if file.exists():
        kept: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if kept.get("complete"):
            return kept
    found = diagnose(dataset, place, tell)
    if not found.complete:
        raise KeyboardInterrupt
    content: Mapping[str, Any] = found.to_dict()
    return content


def _plan_once(
    place: Path,
    suite: Path,
    *,
    tell: ProgressHook,
    budget: float,
    safety: str | Path | None,
    probability: float,
    within: float,
) -> Mapping[str, Any]:
    figures = suite.with_suffix(".json")
    if figures.exists() and (suite.exists() or not run_folder(suite).exists()):
        kept: Mapping[str, Any] = json.loads(figures.read_text(encoding="utf-8"))
        if kept["ending"] != "proposed" or dataset_path(suite).exists():
            return kept
    found = next_experiment(
        place / "diagnosis", suite, budget=budget, safety=safety, probability=probability,
        within=within, progress=tell,
    )  # fmt: skip
    content: Mapping[str, Any] = found.to_dict()
    return content


def _write(found: Rounds) -> None:
    text = json.dumps(found.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(found.folder / SUMMARY, text + "\n")
    write_rounds_report(found.folder / PAGE, found.to_dict())
