"""dataset.yaml: the recordings a model is held against (contract, section 4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import Field

from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.core.trial import Bypass, Piston
from eha_bench.core.yaml_file import StrictModel
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.plant import Plant
from eha_bench.plants.static_plant import StaticPlant

_FEWEST = 10
_LONGEST = 86_400.0
"""A day, s: what is longer was logged in another unit, and would be simulated for hours."""


class Use(StrEnum):
    """What a run is for: `holdout` runs are only scored, when everything is decided."""

    TRAIN = "train"
    HOLDOUT = "holdout"


class RunEntry(StrictModel):
    """One recording with the setup it was made in."""

    log: Annotated[str, Field(min_length=1, description="path, relative to this file")]
    channels: Annotated[
        str | None, Field(description="its own channels.yaml instead of the dataset's")
    ] = None
    piston: Piston = Piston.FREE
    bypass: Bypass = Bypass.CLOSED
    use: Use = Use.TRAIN


class DatasetFile(StrictModel):
    """dataset.yaml: a model, and the recordings it is held against."""

    model: Annotated[str, Field(description="model.yaml, relative to this file")]
    channels: Annotated[
        str | None, Field(description="channels.yaml of all runs; none for our own recordings")
    ] = None
    inputs: Annotated[
        list[str],
        Field(
            default_factory=lambda: ["current_command"],
            min_length=1,
            description="measured signals that drive the model; also states",
        ),
    ]
    runs: Annotated[list[RunEntry], Field(min_length=1)]


@dataclass(frozen=True)
class Run:
    """One recording of a dataset, read when it is asked for.

    Attributes:
        name: file name without its ending; unique in the dataset.
        log, channels: paths; `channels` may be None.
        locked, bypass_open: setup.
        use: train or holdout.
        reader: returns the recording; a holdout run's is first called to score.
    """

    name: str
    log: Path
    channels: Path | None
    locked: bool
    bypass_open: bool
    use: Use
    reader: Callable[[], Recording]

    def read(self) -> Recording:
        """Read the recording.

        Raises:
            RecordingError: it cannot be read, has fewer than ten samples, or is longer than a day.
        """
        return self.reader()


@dataclass(frozen=True)
class Dataset:
    """A model and the runs it is held against.

    Attributes:
        model: declared model.
        inputs: channels that drive the model.
        runs: all runs, in the order of the file.
        source: the file, for messages. inputs_at: where it names its inputs.
    """

    model: Model
    inputs: tuple[str, ...]
    runs: tuple[Run, ...]
    source: str = ""
    inputs_at: Place = field(default_factory=Place)

    @property
    def training(self) -> tuple[Run, ...]:
        """Runs that may be fitted."""
        return tuple(run for run in self.runs if run.use is Use.TRAIN)

    @property
    def holdout(self) -> tuple[Run, ...]:
        """Runs that are only scored."""
        return tuple(run for run in self.runs if run.use is Use.HOLDOUT)

    def driven(self, plant: Plant) -> tuple[str, ...]:
        """Return the outputs of a plant that the inputs determine.

        Raises:
            InputError: there is none but the inputs themselves.
        """
        found = plant.determined(self.inputs)
        if not set(found) - set(self.inputs):
            raise InputError(
                f"nothing that {plant.id} gives is driven by {', '.join(self.inputs)}",
                where=self.inputs_at,
                hint="name a command that moves it, or a measured state that others follow; "
                f"it gives: {', '.join(plant.outputs)}",
            )
        return found

    def with_model(self, model: Model) -> Dataset:
        """Return the same runs held against another model.

        Raises:
            InputError: an input that the model's plant does not take.
        """
        return replace(self, model=model)


def load_dataset(path: Path) -> Dataset:
    """Read a dataset.yaml; recordings are read later, one by one.

    Raises:
        InputError: a wrong key or value, a missing file, with file, line and key.
    """
    content = yaml_file.load(path)
    file = yaml_file.validate(DatasetFile, content, str(path))
    folder = path.parent

    def place(*keys: int | str) -> Place:
        line = yaml_file.line_of(content, keys)
        return Place(file=str(path), line=line, key=".".join(str(key) for key in keys))

    def existing(name: str, *keys: int | str) -> Path:
        target = folder / name
        if not target.exists():
            raise InputError(f"'{name}' is not there", where=place(*keys))
        return target

    model = load_model(existing(file.model, "model"))
    shared = existing(file.channels, "channels") if file.channels else None
    runs: list[Run] = []
    uses: dict[tuple[Path, Path | None], Use] = {}
    for number, entry in enumerate(file.runs):
        log = existing(entry.log, "runs", number, "log")
        own = entry.channels
        channels = existing(own, "runs", number, "channels") if own else shared
        read_as = log.resolve(), channels.resolve() if channels else None
        if uses.setdefault(read_as, entry.use) is not entry.use:
            raise InputError(
                f"'{entry.log}' is both for training and held out",
                where=place("runs", number, "log"),
                hint="hold out a run that is not fitted: what was fitted tells nothing of the rest",
            )
        runs.append(
            Run(
                _free_name(log.stem or log.name, [run.name for run in runs]),
                log,
                channels,
                entry.piston is Piston.LOCKED,
                entry.bypass is Bypass.OPEN,
                entry.use,
                _reader(log, channels, 1 if isinstance(model.plant, StaticPlant) else _FEWEST),
            )
        )
    if not any(run.use is Use.TRAIN for run in runs):
        raise InputError(
            "no run is for training", where=place("runs"), hint="give at least one `use: train`"
        )
    return Dataset(model, tuple(file.inputs), tuple(runs), str(path), place("inputs"))


def _free_name(name: str, taken: Sequence[str]) -> str:
    """Return a name that no other run has, also where small letters are as good as capital ones.

    What is written of a run is a file of this name.
    """
    folded = {other.casefold() for other in taken}
    free, number = name, 1
    while free.casefold() in folded:
        number += 1
        free = f"{name}-{number}"
    return free


def _reader(log: Path, channels: Path | None, fewest: int) -> Callable[[], Recording]:
    def read() -> Recording:
        # imported here: reading formats pulls in large libraries that a schema check needs not
        from eha_bench.recordings import read as read_recording

        recording = read_recording(log, channels=channels)
        if len(recording) < fewest:
            raise RecordingError(
                f"only {len(recording)} samples, too few to hold a model against",
                where=Place(file=str(log)),
            )
        length = float(recording.time[-1] - recording.time[0])
        if fewest > 1 and length > _LONGEST:
            raise RecordingError(
                f"{len(recording)} samples over {length:.3g} s are more than a day",
                where=Place(file=str(log)),
                hint="check the unit of its time in channels.yaml, or cut it",
            )
        return recording

    return read
