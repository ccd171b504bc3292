"""`eha-bench export-fmu`: a model of the knee EHA as an FMU that other tools simulate.

The FMU is a thin shell of PythonFMU around this package: it carries the model file, and finds
eha_bench in the Python of the tool that runs it. Values are SI and say so.
"""

from __future__ import annotations

import importlib
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.atomic_file import replacing, write_text
from eha_bench.core.errors import InputError
from eha_bench.plants.model import Model, load_model
from eha_bench.targets.fmu.description import INSTALL

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_BASES = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "radian": "rad",
}  # fmt: skip

_SCRIPT = '''"""The knee EHA as a slave of FMI {version}; see eha_bench.targets.fmu.slave."""

import {package}
from {package} import Fmi{version}Slave

from eha_bench.targets.fmu.export import completed
from eha_bench.targets.fmu.slave import equip


class {name}(Fmi{version}Slave):
    description = "Electro-hydrostatic knee actuator, all values SI"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = type(self).description
        self.knee = equip(self, {package}, {version})

    def to_xml(self, *args, **kwargs):
        return completed(super().to_xml(*args, **kwargs), self.knee.units, {version})

    def exit_initialization_mode(self):
        self.knee.begin()

    def do_step(self, current_time, step_size):
        self.knee.advance(step_size)
        return {done}
'''


def export_fmu(model: Path, out: Path, version: int = 2) -> Path:
    """Write a model as an FMU for co-simulation; return its path.

    Args:
        model: model.yaml of an eha_knee, with its effects.
        out: the .fmu to write.
        version: FMI's, 2 or 3.

    Raises:
        InputError: PythonFMU is not installed, or the model is not an eha_knee.
    """
    from eha_bench.targets.fmu.slave import Knee

    package = "pythonfmu" if version == 2 else "pythonfmu3"
    loaded = load_model(model)
    Knee(loaded)  # says why it cannot be exported
    try:
        builder = importlib.import_module(f"{package}.builder")
    except ImportError as error:
        raise InputError(f"an export as FMI {version} needs {package}", hint=INSTALL) from error
    if out.suffix != ".fmu":
        raise InputError(f"'{out}' is not a name for an FMU", hint="end it in .fmu")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="eha-bench-") as name:
        folder = Path(name)
        _write_sources(folder, loaded, package, version)
        built = builder.FmuBuilder.build_FMU(
            folder / "eha_knee_slave.py",
            dest=folder / "built",
            project_files=[folder / "model.yaml"],
            needsExecutionTool=True,
            canHandleVariableCommunicationStepSize=True,
        )
        with replacing(out) as part:
            part.write_bytes(Path(built).read_bytes())
    return out


def _write_sources(folder: Path, model: Model, package: str, version: int) -> None:
    done = "True" if version == 2 else "pythonfmu3.fmi3slave.Fmi3StepResult()"
    text = _SCRIPT.format(version=version, package=package, name="EhaKnee", done=done)
    write_text(folder / "eha_knee_slave.py", text)
    model.write(folder / "model.yaml", "the model that this FMU was exported from")


def completed(root: Element, units: dict[str, str], version: int) -> Element:
    """Add to PythonFMU's model description what it lacks: units, and first unknowns (FMI 2)."""
    from xml.etree.ElementTree import Element, SubElement

    definitions = Element("UnitDefinitions")
    for unit in dict.fromkeys(unit for unit in units.values() if unit):
        defined = SubElement(definitions, "Unit", name=unit)
        SubElement(defined, "BaseUnit", **_exponents(unit))
    place = [child.tag for child in root].index("CoSimulation") + 1
    root.insert(place, definitions)
    variables = root.find("ModelVariables")
    assert variables is not None
    for variable in variables:
        unit = "s" if variable.get("name") == "time" else units.get(str(variable.get("name")), "")
        holder = variable.find("Real") if version == 2 else variable
        if unit and holder is not None:
            holder.set("unit", unit)
    structure = root.find("ModelStructure")
    if version == 2 and structure is not None:
        unknowns = SubElement(structure, "InitialUnknowns")
        for index, variable in enumerate(variables, start=1):
            if variable.get("causality") == "output":
                SubElement(unknowns, "Unknown", index=str(index))
    return root


def _exponents(unit: str) -> dict[str, Any]:
    """Return the exponents of FMI's base units."""
    from eha_bench.core.units import base_exponents

    return {_BASES[name]: str(power) for name, power in base_exponents(unit).items()}
