"""dataset.yaml: the recordings that a model is compared with (contract, section 4)."""

from __future__ import annotations

import glob
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, model_validator

from eha_bench.core import yaml_file
from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import InputError, Place, RecordingError
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.note import Note
from eha_bench.core.recording import Recording
from eha_bench.core.shipped import by_name
from eha_bench.core.trial import Bypass, Piston
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import ErrorAt, Real, StrictModel
from eha_bench.diagnosis.data.beyond_sensors import without_marks
from eha_bench.diagnosis.data.channel_units import check_units
from eha_bench.diagnosis.data.rod_position import with_rod_positions
from eha_bench.plants.layout import Layout
from eha_bench.plants.model import Model, model_from, parse_parameter
from eha_bench.plants.plant import Plant
from eha_bench.plants.static_plant import StaticPlant
from eha_bench.recordings.computed import ComputedChannel, check_known, in_order, with_computed

if TYPE_CHECKING:
    from eha_bench.recordings.channel_map import ChannelMap

_FEWEST = 10
_PERIODS_SHORT = 2.0
"""A window that ends so many periods behind the last sample asks for all, and no more."""
_ENDS_BEFORE = (
    "the log ends {end:.6g} s after its first sample, before the end of the window (to: "
    "{stop:.6g} s); what there is was taken ('to' counts from the log's first sample)"
)
_LONGEST = 86_400.0
"""A day, s: what is longer was logged in another unit, and would be simulated for hours."""


class Use(StrEnum):
    """What a run is for: all but `train` are only scored, when everything is decided.

    `unseen` runs are held out as well, and of another kind (another load, another excitation):
    they are scored apart.
    """

    TRAIN = "train"
    HOLDOUT = "holdout"
    UNSEEN = "unseen"


class RunEntry(StrictModel):
    """One recording with the setup it was made in."""

    log: Annotated[
        str,
        Field(min_length=1, description="path or pattern (runs/*.csv), relative to this file"),
    ]
    channels: Annotated[
        str | None, Field(description="its own channels.yaml instead of the dataset's")
    ] = None
    piston: Piston = Piston.FREE
    bypass: Bypass = Bypass.CLOSED
    use: Use = Use.TRAIN
    start: Annotated[
        float,
        Unit("s"),
        Field(
            alias="from",
            ge=0.0,
            description="start of the window, counted from the log's first sample",
        ),
    ] = 0.0
    stop: Annotated[
        float | None,
        Unit("s"),
        Field(alias="to", description="end of the window, counted from the log's first sample"),
    ] = None
    parameters: Annotated[
        dict[str, Real | str],
        Field(
            default_factory=dict,
            description="what is known of this run and differs from the model: added_mass: 80 kg",
        ),
    ]

    @model_validator(mode="after")
    def _ends_later(self) -> RunEntry:
        if self.stop is not None and self.stop <= self.start:
            raise ErrorAt(
                f"it ends at {self.stop:g} s, not after its start at {self.start:g} s", "to"
            )
        return self


class DatasetFile(StrictModel):
    """dataset.yaml: a model, and the recordings that it is compared with."""

    model: Annotated[str, Field(description="model.yaml, relative to this file")]
    channels: Annotated[
        str | dict[str, ComputedChannel] | None,
        Field(
            description="channels.yaml of all runs, none for our own recordings; or channels that "
            "are computed from those of every run"
        ),
    ] = None
    inputs: Annotated[
        list[str],
        Field(
            default_factory=lambda: ["current_command"],
            description="measured signals that drive the model; also states. Where it is left out, "
            "current_command, the plant's own command, or all inputs of one without any; [] where "
            "nothing drives it, as in a free fall or a coast-down",
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
        use: train, holdout or unseen.
        reader: returns the recording; a held-out run's is first called to score.
        by_topic: returns a recording for each topic at its own stamps; None where one holds all.
        parameters: plant's parameter -> value that it has in this run, SI.
        own: parameter that is estimated for this run alone -> its place in a vector of parameters,
            behind those of the layout.
        until: s from the first sample from which on no reading is compared.
        stamped_late: channel -> s by which its topic is read earlier than it is stamped.
    """

    name: str
    log: Path
    channels: Path | None
    locked: bool
    bypass_open: bool
    use: Use
    reader: Callable[[], Recording]
    parameters: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, int] = field(default_factory=dict)
    by_topic: Callable[[], tuple[Recording, ...]] | None = None
    until: float = math.inf
    stamped_late: Mapping[str, float] = field(default_factory=dict)

    def read(self) -> Recording:
        """Read the recording.

        Raises:
            RecordingError: it cannot be read, has fewer than ten samples, or is longer than a day.
        """
        return self.reader()

    def topics(self) -> tuple[Recording, ...]:
        """Read a recording for each topic, at its own stamps; zero is that of the log.

        Raises:
            RecordingError: as `read`.
        """
        return (self.reader(),) if self.by_topic is None else self.by_topic()

    def read_once(self) -> Run:
        """Return the same run, which keeps what it has read of its log."""
        by_topic = None if self.by_topic is None else cache(self.by_topic)
        return replace(self, reader=cache(self.reader), by_topic=by_topic)

    def read_with(self, change: Callable[[Recording], Recording]) -> Run:
        """Return the same run with a change of each recording that is read of it."""
        log = _ChangedLog(self, change)
        return replace(self, reader=log.read, by_topic=self.by_topic and log.topics)

    def vector(self, layout: Layout, vector: FloatArray) -> FloatArray:
        """Return the plant's parameters as they are in this run, (layout.size,), SI.

        Args:
            layout: of the plant. vector: of all runs, with the runs' own values
                behind it or without.

        Raises:
            InputError: the plant has no parameter that the run names.
        """
        out = vector[: layout.size]
        if not self.parameters and not self.own:
            return out
        out = out.copy()
        for key, value in self.parameters.items():
            if key not in layout.index:
                raise InputError(
                    f"the run sets '{key}', which the model '{layout.plant}' does not have",
                    where=Place(file=str(self.log)),
                )
            out[layout.index[key]] = value
        for key, place in self.own.items():
            if place < vector.size:
                out[layout.index[key]] = vector[place]
        return out


@dataclass(frozen=True)
class _ChangedLog:
    """A run's log as it is read with a change; it can be sent to workers."""

    run: Run
    change: Callable[[Recording], Recording]

    def read(self) -> Recording:
        return self.change(self.run.read())

    def topics(self) -> tuple[Recording, ...]:
        return tuple(self.change(item) for item in self.run.topics())


@dataclass(frozen=True)
class Dataset:
    """A model and the runs that it is compared with.

    Attributes:
        model: declared model.
        inputs: channels that drive the model.
        runs: all runs, in the order of the file.
        source: the file, for messages. inputs_at: where it names its inputs.
        computed: channels that are computed in every run, by name.
        notes: what is read otherwise than the files say, one sentence each.
        misread: channels that their map mistakes, with how they are read instead.
        files: all that it was made of or reads: itself, its model's, channel maps, logs.
    """

    model: Model
    inputs: tuple[str, ...]
    runs: tuple[Run, ...]
    source: str = ""
    inputs_at: Place = field(default_factory=Place)
    computed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    misread: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def training(self) -> tuple[Run, ...]:
        """Runs that may be fitted."""
        return tuple(run for run in self.runs if run.use is Use.TRAIN)

    @property
    def held_out(self) -> tuple[Run, ...]:
        """Runs that are only scored, those of another kind included."""
        return tuple(run for run in self.runs if run.use is not Use.TRAIN)

    def determined(self, plant: Plant) -> tuple[str, ...]:
        """Return the outputs of a plant that the inputs determine.

        Raises:
            InputError: there is none but the inputs themselves.
        """
        found = plant.determined(self.inputs)
        if not set(found) - set(self.inputs):
            driving = ", ".join(self.inputs)
            raise InputError(
                f"nothing that {plant.id} gives is driven by {driving}"
                if driving
                else f"'inputs' is empty, and nothing that {plant.id} gives moves by itself",
                where=self.inputs_at,
                hint="name a command that moves it, or a measured state that others follow; "
                f"it gives: {', '.join(plant.outputs)}",
            )
        return found


def load_dataset(source: str | Path | Mapping[str, Any]) -> Dataset:
    """Read a dataset.yaml, or a dict of what it would hold; recordings are read later, one by one.

    Raises:
        InputError: a wrong key or value, a missing file, with file, line and key.
    """
    with noting_inputs() as read:
        loaded = _loaded(yaml_file.file_of(source, "dataset"))
    return replace(loaded, files=(*dict.fromkeys(read), *(run.log for run in loaded.runs)))


def _loaded(path: Path) -> Dataset:
    """Return what a dataset.yaml holds, as `load_dataset` does."""
    content = yaml_file.load(path)
    file = yaml_file.validate(DatasetFile, content, str(path), kind="dataset")
    folder = path.parent

    def place(*keys: int | str) -> Place:
        line = yaml_file.line_of(content, keys)
        return Place(file=str(path), line=line, key=".".join(str(key) for key in keys))

    def existing(name: str, *keys: int | str) -> Path:
        target = folder / name
        if not target.exists():
            raise InputError(
                f"'{name}' is not there", where=place(*keys), hint="check the name and its folder"
            )
        return target

    model = model_from(by_name("models", file.model) or existing(file.model, "model"))
    if isinstance(model.plant, StaticPlant):
        _refuse_own(model, file, place)
    fewest = 1 if isinstance(model.plant, StaticPlant) else _FEWEST
    given = file.channels
    shared = existing(given, "channels") if isinstance(given, str) else None
    computed = _computed_channels(given, place) if isinstance(given, dict) else {}
    runs: list[Run] = []
    read: list[_LogPart] = []
    for number, entry in enumerate(file.runs):
        own = entry.channels
        channels = existing(own, "runs", number, "channels") if own else shared
        if not isinstance(model.plant, StaticPlant):  # of points it says how they were measured
            _check_setup(model.plant, entry, number, place)
        for log in _logs(folder, entry.log, place("runs", number, "log")):
            part = _LogPart(log, channels, entry.start, entry.stop, entry.use, model)
            if any(part.contradicts(other) for other in read):
                raise InputError(
                    f"'{log.name}' is both for training and held out",
                    where=place("runs", number, "log"),
                    hint="hold out another run: only runs that are not fitted can judge the model",
                )
            read.append(part)
            runs.append(
                Run(
                    _free_name(log.stem or log.name, [run.name for run in runs]),
                    log,
                    channels,
                    entry.piston is Piston.LOCKED,
                    entry.bypass is Bypass.OPEN,
                    entry.use,
                    _reader(part, fewest, computed, place("channels")),
                    {
                        key: parse_parameter(
                            model.plant.layout, key, raw, place("runs", number, "parameters", key)
                        )
                        for key, raw in entry.parameters.items()
                    },
                    by_topic=None if computed else _topics_reader(part, fewest),
                )
            )
    for path_of_map in dict.fromkeys(run.channels for run in runs if run.channels is not None):
        check_units(path_of_map, model.plant)
    if not any(run.use is Use.TRAIN for run in runs):
        raise InputError(
            "no run is for training", where=place("runs"), hint="give at least one `use: train`"
        )
    inputs = tuple(file.inputs)
    if "inputs" not in file.model_fields_set and not {*inputs} & {*model.plant.inputs}:
        driving = tuple(item for item in model.plant.inputs if item != "oil_temperature")
        inputs = (model.plant.command,) if model.plant.command else driving
    return Dataset(model, inputs, tuple(runs), str(path), place("inputs"), (*computed,))


@dataclass(frozen=True)
class _LogPart:
    """A part of a log, and what it is for."""

    log: Path
    channels: Path | None
    start: float
    stop: float | None
    use: Use
    model: Model

    def channel_map(self) -> ChannelMap | None:
        """Read the channel map, which the plant's own names are no strangers to."""
        from eha_bench.recordings import load_channel_map

        if self.channels is None:
            return None
        plant = self.model.plant
        names = (*plant.inputs, *plant.outputs, *plant.states)
        return load_channel_map(self.channels).knowing(names)

    def contradicts(self, other: _LogPart) -> bool:
        """Whether a part of both is fitted by one and held out by the other."""
        if (self.use is Use.TRAIN) is (other.use is Use.TRAIN):
            return False
        mine, theirs = (item.channels and item.channels.resolve() for item in (self, other))
        ends, others_end = (item.stop or math.inf for item in (self, other))
        together = self.start < others_end and other.start < ends
        return together and mine == theirs and self.log.resolve() == other.log.resolve()


def _logs(folder: Path, name: str, where: Place) -> Iterator[Path]:
    """Yield the logs that a path or a pattern names, in the order of their names.

    Raises:
        InputError: there is none.
    """
    if (folder / name).exists():
        yield folder / name
        return
    if not glob.has_magic(name):
        raise InputError(
            f"'{name}' is not there",
            where=where,
            hint="check its path; `eha-bench run` makes recordings",
        )
    # Path.glob takes no absolute pattern
    found = sorted(glob.glob(name, root_dir=folder, recursive=True))  # noqa: PTH207
    if not found:
        raise InputError(f"no log matches '{name}'", where=where)
    for log in found:
        yield folder / log


def _check_setup(plant: Plant, entry: RunEntry, number: int, place: Callable[..., Place]) -> None:
    """Refuse a run in a setup that its machine cannot be in: it would be simulated free."""
    plant.check_setup(locked=entry.piston is Piston.LOCKED, where=place("runs", number, "piston"))
    plant.check_setup(
        bypass_open=entry.bypass is Bypass.OPEN, where=place("runs", number, "bypass")
    )


def _refuse_own(model: Model, file: DatasetFile, place: Callable[..., Place]) -> None:
    """Refuse what belongs to one run only, where runs are operating points."""
    for number, entry in enumerate(file.runs):
        if entry.parameters:
            raise InputError(
                f"{model.plant_id} has operating points, which all have the model's parameters",
                where=place("runs", number, "parameters"),
            )
    if model.per_run:
        raise InputError(
            f"{model.plant_id} has operating points, and no parameter per run",
            where=place("model"),
            hint="take per_run out of the model",
        )


def _computed_channels(
    channels: Mapping[str, ComputedChannel], place: Callable[..., Place]
) -> Mapping[str, ComputedChannel]:
    """Return computed channels whose units and order have been checked."""
    for name, entry in channels.items():
        try:
            check_known(name, entry.unit)
        except ErrorAt as error:
            raise InputError(str(error), where=place("channels", name, *error.keys)) from error
    in_order(channels, place("channels"))
    return channels


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


def _reader(
    part: _LogPart, fewest: int, computed: Mapping[str, ComputedChannel], where: Place
) -> Callable[[], Recording]:
    def read() -> Recording:
        # imported here: reading formats pulls in large libraries that a schema check needs not
        from eha_bench.recordings import read as read_recording

        recording = read_recording(part.log, channels=part.channel_map())
        if fewest > 1:  # a table of points has no samples that a logger marks
            recording = without_marks(recording)
        if computed:
            recording = with_computed(recording, computed, where)
        (recording,) = with_rod_positions((recording,), part.model)
        return _comparable(_window_of(recording, part), (recording,), part, fewest)

    return read


def _topics_reader(part: _LogPart, fewest: int) -> Callable[[], tuple[Recording, ...]]:
    def read() -> tuple[Recording, ...]:
        from eha_bench.recordings import read_topics

        read = map(without_marks, read_topics(part.log, channels=part.channel_map()))
        topics = with_rod_positions(tuple(read), part.model)
        if len(topics) == 1:
            return (_comparable(_window_of(topics[0], part), topics, part, fewest),)
        first = min(float(item.time[0]) for item in topics if len(item))
        last = max(float(item.time[-1]) for item in topics if len(item))
        cut = tuple(_window_of(item, part, first, last) for item in topics)
        _comparable(max(cut, key=len), topics, part, fewest)
        return cut

    return read


def _comparable(
    recording: Recording, topics: Sequence[Recording], part: _LogPart, fewest: int
) -> Recording:
    """Return a recording, the part of a log of some topics, that a model can be compared with.

    Raises:
        RecordingError: it has too few samples, or is longer than a day.
    """
    if len(recording) < fewest:
        samples = "sample" if len(recording) == 1 else "samples"
        raise RecordingError(
            f"only {len(recording)} {samples}{_window(part)}, too few to compare a model with",
            where=Place(file=str(part.log)),
            hint=_way_to_window(topics, part) if _window(part) else "",
        )
    length = float(recording.time[-1] - recording.time[0])
    if fewest > 1 and length > _LONGEST:
        raise RecordingError(
            f"{len(recording)} samples over {length:.3g} s are more than a day",
            where=Place(file=str(part.log)),
            hint="check the unit of its time in channels.yaml, or cut it",
        )
    return recording


def _way_to_window(topics: Sequence[Recording], part: _LogPart) -> str:
    """Say how a window is given; where the log's own time stamps were meant, which it would be."""
    way = "'from' and 'to' count from the log's first sample"
    times = [item.time for item in topics if len(item)]
    if not times:
        return way
    own = min(float(time[0]) for time in times)
    length = max(float(time[-1]) for time in times) - own
    for zero in (own, own + topics[0].epoch_ns / 1e9):
        start = part.start - zero
        if zero > 0.0 and 0.0 <= start < length:
            keys = f"from: {_instant(start)}"
            keys += f", to: {_instant(part.stop - zero)}" if part.stop is not None else ""
            return f"{way}, which is stamped {_instant(zero)}: give {keys}"
    return f"{way}, and the log lasts {_instant(length)}"


def _instant(time: float) -> str:
    """Write a time to the microsecond, as a stamp that counts from 1970 has many digits."""
    return f"{time:.6f}".rstrip("0").rstrip(".") + " s"


def _window_of(
    recording: Recording, part: _LogPart, first: float | None = None, last: float | None = None
) -> Recording:
    """Return the window of a recording that a run asks for, counted from its log's first sample.

    Args:
        recording: of all that was logged, or of a topic. part: says the window.
        first, last: of the log's samples, s; those of the recording by default.
    """
    if not len(recording) or (part.start == 0.0 and part.stop is None):
        return recording
    first = float(recording.time[0]) if first is None else first
    last = float(recording.time[-1]) if last is None else last
    stop = math.inf if part.stop is None else part.stop
    cut = recording.between(first + part.start, first + stop)
    missing = first + stop - last
    if part.stop is None or not missing > _PERIODS_SHORT * recording.sample_period:
        return cut
    note = Note(_ENDS_BEFORE, end=last - first, stop=stop)
    return replace(cut, notes=(*cut.notes, note))


def _window(part: _LogPart) -> str:
    """Say which window was asked for, where it is not all of the log."""
    if part.stop is not None:
        return f" from {_instant(part.start)} to {_instant(part.stop)}"
    return f" from {_instant(part.start)} on" if part.start else ""
