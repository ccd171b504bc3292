"""`eha-bench before-after`: one page from recordings to the machine's result with tuned gains.

Each folder says by itself what it is: of `diagnose` (diagnosis.json), of `tune` (tuning.json) or of
`run` (result.json). The page is true only where they belong together, so that is
looked at: the gains were tuned for the revised model, and the later result was made with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError, Place
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.json_file import read_object
from eha_bench.core.output_folder import spare_inputs
from eha_bench.core.result import Result
from eha_bench.diagnosis.outcome.diagnosis import DIAGNOSIS_FILE
from eha_bench.plants.model import load_model
from eha_bench.report.before_after_page import BeforeAfter, write_before_after
from eha_bench.tuning.files import CONTROLLER, MODEL
from eha_bench.tuning.files import SUMMARY as TUNING_FILE

RESULT_FILE: Final = "result.json"
_SAME: Final = 1e-9
"""Relative difference of two parameters that is rounding of a file."""


def before_after(folders: Sequence[str | Path], out: str | Path) -> Path:
    """Write one page of a machine: recordings, diagnosis, revised model, tuned gains, its results.

    Args:
        folders: of one diagnosis, one tuning, and one result or two, in any order: that with the
            tuned gains is known by their digest.
        out: the page, *.html.

    Raises:
        InputError: a folder is none of these, there are two of a kind, or one is missing.
    """
    kinds = _folder_kinds([Path(folder) for folder in folders])
    diagnosis, tuning = kinds.diagnosis, kinds.tuning
    with noting_inputs() as read:
        digest = load_controllers(tuning / CONTROLLER).sha256
        results = sorted(
            (Result.read(folder / RESULT_FILE) for folder in kinds.results),
            key=lambda item: (_digest(item) == digest, item.provenance.get("started", "")),
        )
        notes = _model_notes(diagnosis, tuning)
        found, tuned = _json(diagnosis / DIAGNOSIS_FILE), _json(tuning / TUNING_FILE)
    page = Path(out)
    spare_inputs((page,), read, "name another page with --out")
    after = results[-1] if results else None
    if after is not None and _digest(after) != digest:
        notes.append(
            "no result was made with the tuned gains"
            if _digest(after)
            else "the result does not say with which gains it was made"
        )
    page.resolve().parent.mkdir(parents=True, exist_ok=True)
    content = BeforeAfter(
        found,
        tuned,
        results[0] if len(results) > 1 else None,
        after,
        tuple(notes),
        diagnosis,
        tuning,
        kinds.results,
    )
    return write_before_after(content, page)


@dataclass(frozen=True)
class _Kinds:
    diagnosis: Path
    tuning: Path
    results: tuple[Path, ...]


def _folder_kinds(folders: Sequence[Path]) -> _Kinds:
    """Return which folder is what."""
    found: dict[str, list[Path]] = {DIAGNOSIS_FILE: [], TUNING_FILE: [], RESULT_FILE: []}
    for folder in folders:
        kind = next((name for name in found if (folder / name).is_file()), None)
        if kind is None:
            raise InputError(
                f"holds none of {', '.join(found)}" if folder.is_dir() else "no such folder",
                where=Place(file=str(folder)),
                hint="give the folders that `diagnose`, `tune` and `run` wrote",
            )
        found[kind].append(folder)
    for name, command, most in (
        (DIAGNOSIS_FILE, "diagnose", 1), (TUNING_FILE, "tune", 1), (RESULT_FILE, "run", 2),
    ):  # fmt: skip
        if len(found[name]) > most:
            raise InputError(
                f"there are {len(found[name])} folders of `{command}`, and {most} is expected",
                where=Place(file=str(found[name][most])),
                hint="name the one that the others follow from",
            )
        if not found[name] and name != RESULT_FILE:
            raise InputError(
                f"no folder of `{command}` is given",
                hint=f"add the one that holds {name}",
            )
    return _Kinds(found[DIAGNOSIS_FILE][0], found[TUNING_FILE][0], tuple(found[RESULT_FILE]))


def _json(file: Path) -> Mapping[str, Any]:
    return read_object(file, file.name, "give the folder that the command wrote")


def _model_notes(diagnosis: Path, tuning: Path) -> list[str]:
    """Return a note where the gains were tuned for another model than the diagnosis revised."""
    content = _json(diagnosis / DIAGNOSIS_FILE)
    revised = load_model(diagnosis / str(content["model"]))
    tuned = load_model(tuning / MODEL)
    same = revised.plant.id == tuned.plant.id and (
        [item.id for item in revised.effects] == [item.id for item in tuned.effects]
    )
    if same:
        same = bool(np.allclose(revised.vector(), tuned.vector(), rtol=_SAME, atol=0.0))
    if same:
        return []
    return ["the gains were tuned for another model than the one that this diagnosis revised"]


def _digest(result: Result) -> str:
    """Return the digest of the gains that a result was made with; "" where it does not say."""
    return result.provenance.get("controller_sha256", "")
