"""Traps: machines without a hidden effect, declared or recorded wrongly.

Every trap is a machine of `fixtures.rigs`, whose equations are not those of the models that are
fitted, and a mistake in what a user declares of it or in how it is logged. The mistakes are those
that were met on real logs: a circuit of another kind, a parameter that is free and hides what is
missing, a start that is far off, a load that differs from run to run, a stall, a channel of
another sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from fixtures.rigs.case import nearly_as_declared
from fixtures.rigs.catalogue import PLANTS
from fixtures.rigs.logs import channels_files, write_csv
from fixtures.rigs.machine import Drive, Machine
from fixtures.rigs.sensors import Sensors
from fixtures.rigs.sheet import FOLDER
from ruamel.yaml import YAML

Document = dict[str, Any]

RUNS = 4
"""Of a machine's training runs, those that are recorded; one more is held out."""
SECONDS = 5.0
"""Of each run."""


@dataclass
class Declaration:
    """What a user declares: documents as they are written, and rows of the dataset.

    Attributes:
        plant: of plant.yaml. runs: rows of the dataset. channels: of channels.yaml.
    """

    plant: Document
    runs: list[Document]
    channels: Document

    def calibrate(self, parameter: str, **about: object) -> None:
        """Declare a parameter free, as one that nothing is known of beyond its start."""
        rest = [row for row in self.plant["calibrate"] if row["parameter"] != parameter]
        self.plant["calibrate"] = [*rest, {"parameter": parameter, **about}]

    def fix(self, *parameters: str) -> None:
        """Take parameters out of the calibration."""
        rows = self.plant["calibrate"]
        self.plant["calibrate"] = [row for row in rows if row["parameter"] not in parameters]

    def remove(self, *names: str) -> None:
        """Take elements and nodes out, with the names and calibrations that stand for them."""
        for name in names:
            for part in ("elements", "nodes"):
                self.plant[part].pop(name, None)
        gone = tuple(f"{name}." for name in names)
        for name, stands_for in list(self.plant.get("names", {}).items()):
            listed = [stands_for] if isinstance(stands_for, str) else stands_for
            if any(item.startswith(gone) for item in listed):
                del self.plant["names"][name]
                self.fix(name)
        rows = self.plant["calibrate"]
        self.plant["calibrate"] = [row for row in rows if not row["parameter"].startswith(gone)]


@dataclass(frozen=True)
class Trap:
    """One mistake.

    Attributes:
        name: of the case. plant: which machine. mistake: in words.
        declare: what is wrong in what is declared. drive: what the machine does otherwise.
        may: effects that would be true, as the machine has what the declaration lacks.
        named: whether something has to be said: a verdict that is not none, or a note.
    """

    name: str
    plant: str
    mistake: str
    declare: Callable[[Declaration], None]
    drive: Callable[[Sequence[Drive]], Sequence[Drive]] = field(default=tuple)
    may: frozenset[str] = frozenset()
    named: bool = True

    def record(self, folder: Path, seed: int, seconds: float = 0.0) -> Path:
        """Write a machine's recordings and what is declared of it; return the dataset.

        Runs are of SECONDS, if of no others.
        """
        plant = PLANTS[self.plant]
        rng = np.random.default_rng([seed, *self.name.encode()])
        settings = plant.drawn(rng, 0.5) | nearly_as_declared(plant, rng)
        drives = plant.drives(rng)
        train = [drive for drive in drives if drive.use == "train"][:RUNS]
        chosen = self.drive([*train, next(drive for drive in drives if drive.use == "holdout")])
        machine, sensors = Machine(plant.kind, settings), Sensors.drawn(plant, rng)
        folder.mkdir(parents=True)
        for drive in (_shortened(drive, seconds or SECONDS) for drive in chosen):
            run = machine.run(drive)
            values = np.column_stack(
                [run.inputs[:, : plant.inputs], sensors.read(run.readings, rng)]
            )
            write_csv(folder / f"{drive.name}.csv", plant, drive.time, values)
        yaml = YAML(typ="safe", pure=True)
        declared = Declaration(
            yaml.load(FOLDER / self.plant / "plant.yaml"),
            [{"log": f"{drive.name}.csv", "use": drive.use} for drive in chosen],
            yaml.load(channels_files(plant)["channels_csv.yaml"]),
        )
        self.declare(declared)
        dataset = {
            "model": "plant.yaml",
            "channels": "channels.yaml",
            "inputs": [channel.name for channel in plant.channels[: plant.inputs]],
            "runs": declared.runs,
        }
        for name, document in (
            ("plant", declared.plant), ("channels", declared.channels), ("dataset", dataset),
        ):  # fmt: skip
            with (folder / f"{name}.yaml").open("w", encoding="utf-8") as file:
                yaml.dump(document, file)
        return folder / "dataset.yaml"


def _shortened(drive: Drive, seconds: float) -> Drive:
    kept = int(np.searchsorted(drive.time, seconds))
    return replace(
        drive, time=drive.time[:kept], reference=drive.reference[:kept],
        forward=drive.forward[:kept],
    )  # fmt: skip


_PUMP, _SERVO, _VALVE = "single_rod_eha", "geared_servo", "valve_cylinder"
_LOOP = ("check_a", "check_b", "return_a", "return_b")


def _closed_circuit(told: Declaration) -> None:
    told.remove(*_LOOP, "gas", "reservoir")


def _no_returns(told: Declaration) -> None:
    told.remove("return_a", "return_b")


def _equal_areas(told: Declaration) -> None:
    told.plant["elements"]["cylinder"]["area_b"] = "19.635 cm^2"


def _free_area(told: Declaration) -> None:
    _closed_circuit(told)
    told.plant["elements"]["cylinder"]["area_b"] = "17 cm^2"
    told.calibrate("cylinder.area_b")
    told.calibrate("oil.bulk_modulus")


def _far_start(told: Declaration) -> None:
    for chamber in ("chamber_a", "chamber_b"):
        told.plant["nodes"][chamber]["bulk_modulus"] = "55 MPa"
    told.plant["elements"]["pump"]["displacement"] = "6.4e-8 m^3/rad"
    told.calibrate("oil.bulk_modulus")
    told.calibrate("pump.displacement")


def _no_leak(told: Declaration) -> None:
    told.plant["elements"]["pump_leakage"]["conductance"] = "0 m^3/(s*Pa)"
    told.calibrate("pump_leakage.conductance")


def _one_load(told: Declaration) -> None:
    del told.plant["per_run"]


def _loads(drives: Sequence[Drive]) -> Sequence[Drive]:
    return [
        replace(drive, values={**drive.values, "load": 2e3 * number})
        for number, drive in enumerate(drives)
    ]


def _bolted(drives: Sequence[Drive]) -> Sequence[Drive]:
    first, *others = drives
    return [replace(first, values={**first.values, "added_mass": 120.0}), *others]


def _stalls(drives: Sequence[Drive]) -> Sequence[Drive]:
    """The second run asks for less than what breaks the friction loose."""
    first, second, *others = drives
    still = replace(
        second, reference=0.0 * second.time, gains=(0.0, 0.0, 1.0, 0.001),
        forward=np.where(second.time > 1.0, 0.01, 0.0),
    )  # fmt: skip
    return [first, still, *others]


def _gear(told: Declaration) -> None:
    told.plant["elements"]["gear"]["ratio"] = 250


def _all_free(told: Declaration) -> None:
    for row in list(told.plant["calibrate"]):
        told.calibrate(row["parameter"])
    told.calibrate("pendulum.mass")


def _long_pendulum(told: Declaration) -> None:
    told.plant["elements"]["pendulum"]["length"] = "240 mm"


def _no_friction(told: Declaration) -> None:
    for name in ("coulomb", "viscous"):
        told.plant["elements"]["gear_friction"][name] = (
            f"0 {'N*m' if name == 'coulomb' else 'N*m*s/rad'}"
        )
    told.fix("gear_friction.coulomb", "gear_friction.viscous")


def _ports(told: Declaration) -> None:
    valve = told.plant["elements"]["valve"]
    valve["a"], valve["b"] = valve["b"], valve["a"]


def _swapped_sensors(told: Declaration) -> None:
    rows = told.channels["channels"]
    rows["pressure_a"], rows["pressure_b"] = rows["pressure_b"], rows["pressure_a"]


def _half_supply(told: Declaration) -> None:
    told.plant["nodes"]["supply"]["pressure"] = "7 MPa"


def _soft_oil(told: Declaration) -> None:
    for chamber in ("inlet", "chamber_a", "chamber_b"):
        told.plant["nodes"][chamber]["bulk_modulus"] = "120 MPa"
    told.fix("oil.bulk_modulus")


def _scaled(channel: str, factor: float) -> Callable[[Declaration], None]:
    def declare(told: Declaration) -> None:
        told.channels["channels"][channel]["scale"] = factor

    return declare


def _nothing(told: Declaration) -> None:
    """Everything is declared as it is."""


_FRICTION = frozenset({"coulomb_friction", "load_dependent_friction", "viscosity_drift"})

TRAPS: tuple[Trap, ...] = (
    Trap("closed_circuit", _PUMP, "no reservoir and no check valves", _closed_circuit,
         may=frozenset({"anti_cavitation"})),
    Trap("no_returns", _PUMP, "no piloted return to the reservoir", _no_returns),
    Trap("equal_areas", _PUMP, "a double rod for a single one", _equal_areas),
    Trap("free_area", _PUMP, "no reservoir, and area and modulus free to hide it", _free_area,
         may=frozenset({"anti_cavitation"})),
    Trap("far_start", _PUMP, "displacement and modulus 20 times too small, free", _far_start),
    Trap("no_leak", _PUMP, "a leak declared as none, free", _no_leak, named=False),
    Trap("one_load", _PUMP, "a load that differs from run to run is not said to", _one_load,
         _loads),
    Trap("bolted_mass", _PUMP, "a mass bolted on in one run and not declared", _nothing, _bolted),
    Trap("pump_sign", _PUMP, "the pump's speed of the other sign", _scaled("motor_speed", -1.0)),
    Trap("gear_ratio", _SERVO, "a gear ratio of 250 for 193", _gear, named=False),
    Trap("all_free", _SERVO, "all parameters free that can be scaled together", _all_free),
    Trap("long_pendulum", _SERVO, "a pendulum a third too long", _long_pendulum,
         may=frozenset({"gravity_load"})),
    Trap("no_friction", _SERVO, "no friction in the gear, and none calibrated", _no_friction,
         may=_FRICTION),
    Trap("stall", _SERVO, "a run that does not move", _nothing, _stalls, named=False),
    Trap("speed_sign", _SERVO, "the speed of the other sign", _scaled("velocity", -1.0)),
    Trap("angle_unit", _SERVO, "the angle ten times too large", _scaled("angle", 10.0)),
    Trap("ports", _VALVE, "the valve's ports exchanged", _ports),
    Trap("swapped_sensors", _VALVE, "the pressure sensors exchanged", _swapped_sensors),
    Trap("half_supply", _VALVE, "half of the supply's pressure, good to 10 %", _half_supply),
    Trap("soft_oil", _VALVE, "a tenth of the oil's modulus, not calibrated", _soft_oil),
)  # fmt: skip
