"""dataset.yaml as a kind of file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.file_kind import FileKind

if TYPE_CHECKING:
    from eha_bench.diagnosis.data.dataset import Dataset


def _check(path: Path) -> object:
    from eha_bench.diagnosis.data.dataset import load_dataset
    from eha_bench.recordings.channel_map import load_channel_map

    dataset = load_dataset(path)
    mapped: set[str] = set(dataset.computed)
    for channels in dict.fromkeys(run.channels for run in dataset.runs if run.channels):
        mapped.update(load_channel_map(channels).channels)
    _check_inputs(path, dataset, mapped)
    return dataset


def _check_inputs(path: Path, dataset: Dataset, mapped: set[str]) -> None:
    """Raise an InputError for an input that neither plant nor channel map knows.

    Our own recordings may hold channels of any name: among them only a near miss is a mistake.
    """
    from eha_bench.core.channels import CHANNELS
    from eha_bench.core.errors import InputError, Place
    from eha_bench.core.near_miss import likely, suggest
    from eha_bench.core.yaml_file import line_of, load

    plant = dataset.model.plant
    own = (*plant.inputs, *plant.outputs, *plant.states)
    known = dict.fromkeys((*sorted(mapped), *own, *CHANNELS))
    all_mapped = all(run.channels for run in dataset.runs)
    for number, name in enumerate(dataset.inputs):
        if name not in known and (all_mapped or likely(name, known)):
            line = line_of(load(path), ["inputs", number])
            raise InputError(
                f"no channel map and no plant has an input '{name}'",
                where=Place(file=str(path), line=line, key=f"inputs.{number}"),
                hint=suggest(name, known),
            )


def _schema() -> dict[str, Any]:
    from eha_bench.diagnosis.data.dataset import DatasetFile

    return DatasetFile.model_json_schema()


def _recognises(content: Mapping[Any, Any]) -> bool:
    """Whether a file without `runs` is a dataset: what it has is of another form in a model."""
    own = isinstance(content.get("inputs"), list) or isinstance(content.get("channels"), str)
    return "model" in content and "target" not in content and own


KIND = FileKind(
    "dataset",
    frozenset({"runs"}),
    4,
    _check,
    _schema,
    recognises=_recognises,
    use="eha-bench diagnose FILE",
)
