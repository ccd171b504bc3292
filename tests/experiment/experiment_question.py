"""A diagnosis that has left something open, written without diagnosing anything."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eha_bench.diagnosis.fit.uncertainty import Covariance
from eha_bench.diagnosis.outcome.rival import Rival, Standing
from eha_bench.plants.model import DeclaredEffect, Model, load_model
from eha_bench.posterior.covered import Covered, CoveredSetup

LOCKED: Mapping[str, tuple[float, float]] = {
    "current_command": (-20.0, 20.0),
    "motor_speed": (-250.0, 250.0),
    "pressure_a": (-20e6, 20e6),
    "pressure_b": (-20e6, 20e6),
    "piston_position": (-1e-5, 1e-5),
}
NOISE = {"motor_speed": 0.1, "pressure_a": 3e4, "pressure_b": 3e4}


PAPER = ("viscous_torque", "coulomb_torque")


def rival(
    effect: str | None,
    values: Mapping[str, float] | None = None,
    *,
    share: float = 0.01,
    source: str | dict[str, str] = "paper",
    known: Sequence[str] = PAPER,
) -> Rival:
    """Return a model (the paper's) with an effect; parameters known to a share of their size."""
    model: Model = load_model(source)
    keys = list(known)
    sizes = [model.value(key) for key in keys]
    if effect is not None:
        model = model.with_effect(DeclaredEffect(effect, dict(values or {})))
        keys += [f"{effect}.{name}" for name in values or {}]
        sizes += list((values or {}).values())
    matrix = np.diag((share * np.array(sizes)) ** 2)
    added = () if effect is None else (effect,)
    return Rival(
        effect or "none", added, Standing.FOUND, 0.0, model, Covariance(tuple(keys), matrix)
    )


def write_question(
    folder: Path,
    rivals: Sequence[Rival],
    *,
    noise: Mapping[str, float] = NOISE,
    extremes: Mapping[str, tuple[float, float]] = LOCKED,
    unexplained: Mapping[str, float] | None = None,
    starts: Mapping[str, float] | None = None,
    input_noise: Mapping[str, float] | None = None,
    command: str = "current_command",
    piston: str = "locked",
) -> Path:
    """Write diagnosis.json and its rivals' models; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    covered = Covered(
        1000.0,
        8.0,
        {command: (*extremes[command], 0.0)},
        noise,
        unexplained or {},
        (CoveredSetup(piston, "closed", extremes, starts or {}),),
        input_noise=input_noise or {},
    )
    contents = []
    for number, item in enumerate(rivals):
        (folder / item.file).parent.mkdir(exist_ok=True)
        item.model.write(folder / item.file)
        standing = Standing.EQUIVALENT if number else Standing.FOUND
        contents.append({**item.to_dict(), "standing": standing.value})
    found = {"verdict": "effect", "rivals": contents, "covered": covered.to_dict()}
    rivals[0].model.write(folder / "recalibrated.yaml")
    (folder / "diagnosis.json").write_text(json.dumps(found))
    return folder
