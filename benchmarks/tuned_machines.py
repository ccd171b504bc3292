"""Rigs with an undeclared effect that have made recordings, and the gains that may be varied."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from benchmarks.foreign_machine import LEVELS, ForeignMachine
from benchmarks.rig_loop import Rig
from fixtures.rig.case import Conditions, draw_hidden, draw_true, record_case
from fixtures.rig.parameters import CALIBRATED
from fixtures.rig.plans import make_plans
from fixtures.rigs.catalogue import PLANTS
from fixtures.rigs.machine import Drive, Settings

KNEE, SERVO, VALVE = "eha_knee", "geared_servo", "valve_cylinder"
VARY = {
    KNEE: {
        "pressure.k_p": {"from": "2 A/MPa", "to": "14 A/MPa", "scale": "log"},
        "pressure.k_2": {"from": "0.5 A*s/rad", "to": "6 A*s/rad", "scale": "log"},
        "pressure.k_i": {"from": "10 A/(MPa*s)", "to": "200 A/(MPa*s)", "scale": "log"},
    },
    SERVO: {
        "angle.k_p": {"from": "2 1/rad", "to": "40 1/rad", "scale": "log"},
        "angle.k_i": {"from": "2 1/(rad*s)", "to": "200 1/(rad*s)", "scale": "log"},
        "angle.k_d": {"from": "0.05 s/rad", "to": "2 s/rad", "scale": "log"},
    },
    VALVE: {
        "piston_position.k_p": {"from": "100 V/m", "to": "3000 V/m", "scale": "log"},
        "piston_position.k_i": {"from": "1 V/(m*s)", "to": "3000 V/(m*s)", "scale": "log"},
    },
}
SECONDS = {KNEE: 2.0, SERVO: 15.0, VALVE: 5.0}
"""Length of each run."""
DRIVES = {
    SERVO: ("slow_triangle", "multisine", "angle_steps", "angle_steps_2"),
    VALVE: ("slow_triangle", "steps", "hold_prbs", "multisine_2"),
}
"""Runs that a foreign plant records; the last is held out."""


@dataclass(frozen=True)
class Recorded:
    """A rig that has made its recordings.

    Attributes:
        plant: its name. truth: the undeclared effect. settings: of its equations.
        dataset: of its recordings. model: as declared, beside the dataset.
    """

    plant: str
    truth: str
    settings: Mapping[str, float] | Settings
    dataset: Path
    model: Path

    @property
    def rig(self) -> Rig:
        """The rig, to run trials on."""
        if isinstance(self.settings, Settings):
            return Rig.foreign(PLANTS[self.plant], self.settings)
        return Rig.knee(self.settings)


def recorded(plant: str, number: int, folder: Path, seconds: float = 0.0) -> Recorded:
    """Draw a rig and record its runs, of the plant's own length unless given.

    What was recorded in the folder before is taken again.
    """
    kept = folder / "recorded.pickle"
    if kept.exists():
        found = pickle.loads(kept.read_bytes())
        assert isinstance(found, Recorded)
        return replace(found, dataset=folder / found.dataset, model=folder / found.model)
    folder.mkdir(parents=True, exist_ok=True)
    seconds = seconds or SECONDS[plant]
    found = (
        _knee(number, folder, seconds) if plant == KNEE
        else _foreign(plant, number, folder, seconds)
    )  # fmt: skip
    # a folder may be moved
    within = [path.relative_to(folder) for path in (found.dataset, found.model)]
    kept.write_bytes(pickle.dumps(replace(found, dataset=within[0], model=within[1])))
    return found


def _knee(number: int, folder: Path, seconds: float) -> Recorded:
    """Draw a knee with an effect, and record its runs."""
    plans = make_plans(4000 + number // 60, 60, strengths=LEVELS)
    plan = replace(plans[number % 60], name="case")
    conditions = Conditions(duration=seconds)
    rng = np.random.default_rng(np.random.SeedSequence(plan.seed))
    undeclared = {name for effect in plan.hidden for name in effect.undeclared}
    calibrate = tuple(name for name in CALIBRATED if name not in undeclared)
    values, _, _ = draw_true(rng, conditions, calibrate)
    hidden, _ = draw_hidden(plan, rng, conditions)
    dataset = record_case(plan, folder, conditions)
    settings, model = {**values, **hidden}, dataset.parent / "model.yaml"
    return Recorded(KNEE, plan.hidden[0].id, settings, dataset, model)


def _foreign(name: str, number: int, folder: Path, seconds: float) -> Recorded:
    """Draw a foreign plant with an effect, and record the first seconds of some runs."""
    whole = PLANTS[name]

    def drives(rng: np.random.Generator) -> list[Drive]:
        return [_first(seconds, drive) for drive in whole.drives(rng) if drive.name in DRIVES[name]]

    plant = replace(whole, drives=drives)
    # tick by tick this rig cannot look back on commands, so nothing is late in it
    known = [effect for effect in plant.listed if effect.id != "command_delay"]
    effect = known[number % len(known)]
    rig = ForeignMachine(plant, effect, number)
    case = folder / "case"
    case.mkdir(parents=True, exist_ok=True)
    rows = []
    for drive in plant.drives(np.random.default_rng([number, 17])):
        rig.record(drive, case / f"{drive.name}.csv")
        rows.append(f"  - {{log: {drive.name}.csv, use: {drive.use}}}\n")
    dataset = rig.declare(case, rows)
    return Recorded(name, effect.id, rig.machine.settings, dataset, case / "plant.yaml")


def _first(seconds: float, drive: Drive) -> Drive:
    """Return the first seconds of a drive."""
    kept = drive.time < seconds
    return replace(
        drive, time=drive.time[kept], reference=drive.reference[kept], forward=drive.forward[kept]
    )
