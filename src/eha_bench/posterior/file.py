"""Reads the posterior of a model from diagnosis.json or calibration.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.core.errors import InputError, Place
from eha_bench.core.json_file import read_object
from eha_bench.plants.model import Model, load_model
from eha_bench.posterior.covered import Covered
from eha_bench.posterior.posterior import Component, Posterior

FILES: Final = ("diagnosis.json", "calibration.json")
_SAME: Final = 1e-6
"""Relative difference of two values that is rounding of a file."""
_RUNNER_UP: Final = "runner_up"


def read_posterior(path: Path, model: Model) -> Posterior:
    """Return the posterior of a model from what `diagnose` or `calibrate` wrote.

    Args:
        path: diagnosis.json or calibration.json, or a folder that holds one.
        model: that is drawn: the one that was fitted; what was not fitted may differ.

    Raises:
        InputError: no such file, one without a covariance, or the posterior of another model.
    """
    file = _file(path)
    content = _content(file)
    if "verdict" in content:
        components, notes = _of_diagnosis(content, file)
    else:
        components, notes = _of_calibration(content, file)
    _check_same(components[0], model, file)
    found = components[0].model
    others = {key: value for key, value in model.parameters.items()
              if key not in components[0].keys and found.parameters.get(key) != value}  # fmt: skip
    # what the caller has declared otherwise than what was fitted holds for every draw
    components = tuple(
        replace(item, model=item.model.with_parameters(others)) for item in components
    )
    runs = content.get("per_run") or {}
    per_run = tuple(
        {key: float(entry["value"]) for key, entry in own.items() if entry["value"] is not None}
        for own in runs.values()
    )
    known = model.plant.layout.by_key
    kept = tuple(own for own in per_run if own and all(key in known for key in own))
    return Posterior(components, kept, tuple(notes), str(file), _covered(content, file))


def beside(model: Path) -> Path | None:
    """Return the diagnosis.json or calibration.json next to a model that wrote it, if any did."""
    for name in FILES:
        file = model.parent / name
        if file.is_file():
            try:
                content = json.loads(file.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                continue
            if isinstance(content, dict) and content.get("model") == model.name:
                return file
    return None


def _file(path: Path) -> Path:
    if path.is_dir():
        found = next((path / name for name in FILES if (path / name).is_file()), None)
        if found is None:
            raise InputError(
                "holds no posterior",
                where=Place(file=str(path)),
                hint=f"name a folder with {' or '.join(FILES)}",
            )
        return found
    return path


def _content(file: Path) -> dict[str, Any]:
    where = Place(file=str(file))
    hint = "give the file that `diagnose` or `calibrate` wrote"
    content = read_object(file, "diagnosis.json or calibration.json", hint)
    if not ("verdict" in content or "covariance" in content):
        raise InputError(
            "is neither a diagnosis.json nor a calibration.json", where=where, hint=hint
        )
    return content


def _of_diagnosis(
    content: Mapping[str, Any], file: Path
) -> tuple[tuple[Component, ...], list[str]]:
    rivals = [item for item in content.get("rivals") or () if item["standing"] != _RUNNER_UP]
    if not rivals:
        raise InputError(
            "it holds no covariance of the fitted parameters",
            where=Place(file=str(file), key="rivals"),
            hint="run `eha-bench diagnose` again with this version",
        )
    found = tuple(
        _component(str(item["id"]), load_model(file.parent / item["model"]), item["covariance"])
        for item in rivals
    )
    notes = []
    if len(found) > 1:
        names = ", ".join(item.id for item in found)
        notes.append(f"draws alternate between models that the data do not distinguish: {names}")
    if content.get("verdict") == "unknown":
        notes.append(
            "the diagnosis left an unexplained part, which draws hold as a slow error of channels"
        )
    return found, notes


def _covered(content: Mapping[str, Any], file: Path) -> Covered | None:
    """Return where the recordings have been, as far as the file says."""
    covered = content.get("covered")
    try:
        return Covered.from_dict(covered) if covered else None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"where its recordings have been cannot be read ({error!r})",
            where=Place(file=str(file), key="covered"),
            hint="give the file that `diagnose` or `calibrate` wrote",
        ) from error


def _of_calibration(
    content: Mapping[str, Any], file: Path
) -> tuple[tuple[Component, ...], list[str]]:
    where = Place(file=str(file), key="covariance")
    covariance = content["covariance"]
    if covariance is None:
        raise InputError(
            "the calibration has no intervals, so nothing can be drawn",
            where=where,
            hint="calibrate again, or with fewer parameters under `calibrate`",
        )
    rows = [
        [math.inf if value is None else float(value) for value in row]
        for row in covariance["matrix"]
    ]
    matrix = np.array(rows, dtype=np.float64).reshape(len(rows), len(rows))
    model = load_model(file.parent / str(content["model"]))
    known = model.plant.layout.by_key
    own = [key.partition("[")[0] in known for key in covariance["parameters"]]
    determined = np.array(own, dtype=np.bool_) & np.isfinite(matrix.diagonal())
    kept = np.flatnonzero(determined)
    determinable = zip(covariance["parameters"], determined, own, strict=True)
    open_ = [key for key, is_determined, is_own in determinable if is_own and not is_determined]
    notes = []
    if open_:
        notes.append(f"these data do not determine {', '.join(open_)}, which no draw moves")
    keys = tuple(str(covariance["parameters"][k]) for k in kept)
    return (Component("calibrated", model, keys, matrix[np.ix_(kept, kept)]),), notes


def _component(name: str, model: Model, covariance: Mapping[str, Any]) -> Component:
    keys = tuple(str(key) for key in covariance["parameters"])
    matrix = np.array(covariance["matrix"], dtype=np.float64).reshape(len(keys), len(keys))
    return Component(name, model, keys, matrix)


def _check_same(component: Component, model: Model, file: Path) -> None:
    """Raise an InputError where a model is not the one that the posterior is of."""

    def refuse(key: str, why: str) -> InputError:
        # only what is refused is read again, for the line
        lines = file.read_text(encoding="utf-8").splitlines()
        # an effect stands in the model that the file names
        named = (
            n for word in (key, "model") for n, item in enumerate(lines, 1) if f'"{word}"' in item
        )
        line = next(named, 0)
        return InputError(
            f"is the posterior of another model: {why}",
            where=Place(file=str(file), line=line, key=key),
            hint="give the model that was written with it",
        )

    found = component.model
    if found.plant.id != model.plant.id:
        raise refuse("model", f"of {found.plant.id}, and this one is of {model.plant.id}")
    declared = {item.id for item in model.effects}
    for effect in found.effects:
        if effect.id not in declared:
            raise refuse(effect.id, f"it has the effect {effect.id}, which this one does not")
    for effect in model.effects:
        if effect.id not in {item.id for item in found.effects}:
            raise refuse("model", f"it has no effect {effect.id}, which this one declares")
    layout = model.plant.layout
    for key in component.keys:
        name = key.partition("[")[0]
        owner = name.rpartition(".")[0]
        if name not in layout.index:
            raise refuse(key, f"it has {key}, which this one does not")
        if owner in {item.id for item in layout.effects} - declared:
            raise refuse(key, f"it has the effect {owner}, which this one does not")
    theirs = Component(component.id, model, component.keys, component.covariance).fitted_values
    for key, ours, given in zip(component.keys, component.fitted_values, theirs, strict=True):
        if not math.isclose(ours, given, rel_tol=_SAME, abs_tol=1e-300):
            raise refuse(key, f"{key} is {ours:.6g} there and {given:.6g} in this one")
