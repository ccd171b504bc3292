"""What tuning writes: a controller file that `run` takes, a target with it, and the figures."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.core import yaml_file
from eha_bench.core.atomic_file import write_text
from eha_bench.core.finite import finite_or_none
from eha_bench.core.shipped import by_name
from eha_bench.sweeps.factor import Factor
from eha_bench.tuning.tune import Tuned, finite_least

CONTROLLER: Final = "tuned.yaml"
TARGET: Final = "target.yaml"
MODEL: Final = "model.yaml"
SUMMARY: Final = "tuning.json"
WRITTEN: Final = (CONTROLLER, TARGET, MODEL, SUMMARY)
SCHEMA_VERSION: Final = 1


def write_tuned(found: Tuned, out: Path) -> None:
    """Write tuned.yaml, target.yaml, model.yaml and tuning.json into a folder that is there."""
    simulator = found.space.case.simulator
    simulator.model.write(out / MODEL, "What the gains in tuned.yaml were tuned for")
    write_text(out / CONTROLLER, controller_text(found, out))
    target = {"target": "simulator", "model": MODEL, "controller": CONTROLLER}
    write_text(out / TARGET, yaml_file.to_text(target))
    text = json.dumps(to_dict(found), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out / SUMMARY, text + "\n")


def controller_text(found: Tuned, out: Path) -> str:
    """Return a controller.yaml that extends the one that was tuned by the gains that are new."""
    base = Path(found.space.case.simulator.controllers.name)
    shipped = by_name("controllers", base.stem)
    same = shipped is not None and shipped.resolve() == base.resolve()
    named = base.stem if same else os.path.relpath(base.resolve(), out.resolve())
    blocks: dict[str, Any] = {}
    for factor, value in zip(found.space.factors, found.point, strict=True):
        mode = next(
            name
            for name in sorted(found.space.case.simulator.controllers.by_mode, key=len)[::-1]
            if factor.key.startswith(f"{name}.")
        )
        *path, last = factor.key[len(mode) + 1 :].split(".")
        block = blocks.setdefault(mode, {})
        for word in path:
            block = block.setdefault(word, {})
        block[last] = _gain_as_written(factor, value)
    content = {"description": _about(found), "extends": named, **blocks}
    return yaml_file.to_text(content)


def _gain_as_written(factor: Factor, value: float | str) -> str | float:
    """Return a gain as a file takes it: in the unit of the range, to all its digits."""
    shown = factor.in_file_unit(value)
    unit = factor.shown_in or factor.unit
    return f"{shown!r} {unit}" if unit and not isinstance(shown, str) else shown


def _about(found: Tuned) -> str:
    suite = found.space.case.suite.name
    if found.after is None:
        return f"tuned for {suite}"
    return f"tuned for {suite}: P(pass) {found.after.suite}"


def to_dict(found: Tuned) -> dict[str, Any]:
    """Return the content of tuning.json."""
    space, clash = found.space, found.contradiction
    return {
        "schema_version": SCHEMA_VERSION,
        "suite": space.case.suite.name,
        "status": "feasible" if clash is None else "infeasible",
        "complete": found.complete,
        "tried": found.tried,
        "gains": {
            factor.key: {
                "before": before,
                "after": after,
                "unit": factor.unit,
                "written_in": factor.shown_in or factor.unit,
            }
            for factor, before, after in zip(space.factors, found.before, found.point, strict=True)
        },
        "margin": finite_or_none(finite_least(found.margins)),
        "limits": [
            {
                "key": limit.key,
                "limit": limit.text,
                "margin": finite_or_none(found.margins[place]),
                "p_pass": None if found.after is None else found.after.of(place).to_dict(),
                "p_pass_before": None
                if found.declared is None
                else found.declared.of(place).to_dict(),
            }
            for place, limit in enumerate(found.limits)
        ],
        "p_pass": None if found.after is None else found.after.suite.to_dict(),
        "p_pass_before": None if found.declared is None else found.declared.suite.to_dict(),
        "unknowns": [] if found.after is None else found.after.to_dict()["unknowns"],
        "beyond": [] if found.after is None else [item.to_dict() for item in found.after.beyond],
        "infeasible": None if clash is None else {
            "never": [found.limits[k].key for k in clash.never],
            "contradict": [[found.limits[k].key for k in group] for group in clash.together],
            "nearest_miss": [
                found.limits[k].key
                for k in range(len(found.limits))
                if not np.asarray(found.margins)[k] >= 0.0
            ],
            "tried": clash.tried,
        },
        "notes": list(found.notes),
        "controller": CONTROLLER,
        "target": TARGET,
    }  # fmt: skip
