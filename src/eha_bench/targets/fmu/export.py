"""`eha-bench export-fmu`: a model as an FMU that other tools simulate.

The FMU is a thin shell of PythonFMU around this package: it carries the model file, and finds
eha_bench in the Python of the tool that runs it. Values are SI and say so.
"""

from __future__ import annotations

import importlib
import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.atomic_file import replacing, write_text
from eha_bench.core.errors import InputError
from eha_bench.core.extras import way_to_install
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.output_folder import spare_inputs
from eha_bench.plants.model import Model, model_from

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_BASES = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "radian": "rad",
}  # fmt: skip

_SCRIPT = '''"""A model as a slave of FMI {version}; see eha_bench.targets.fmu.slave."""

import {package}
from {package} import Fmi{version}Slave

from eha_bench.targets.fmu.export import completed_description
from eha_bench.targets.fmu.slave import equip


class {name}(Fmi{version}Slave):
    description = "{description}"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = type(self).description
        self.plant = equip(self, {package}, {version})

    def to_xml(self, *args, **kwargs):
        return completed_description(super().to_xml(*args, **kwargs), self.plant.units, {version})

    def exit_initialization_mode(self):
        self.plant.begin()

    def do_step(self, current_time, step_size):
        self.plant.advance(step_size)
        return {done}
'''


def export_fmu(model: Path, out: Path, version: int = 2) -> Path:
    """Write a model as an FMU for co-simulation; return its path.

    Args:
        model: model.yaml, with its effects.
        out: the .fmu to write.
        version: FMI's, 2 or 3.

    Raises:
        InputError: PythonFMU is not installed, or no input commands that plant.
    """
    from eha_bench.targets.fmu.slave import ExportedPlant

    package = "pythonfmu" if version == 2 else "pythonfmu3"
    with noting_inputs() as read:
        loaded = model_from(model)
    spare_inputs((out,), read, "name another file with --out")
    ExportedPlant(loaded)  # says why it cannot be exported
    try:
        builder = importlib.import_module(f"{package}.builder")
    except ImportError as error:
        raise InputError(
            f"an export as FMI {version} needs {package}", hint=way_to_install("fmu")
        ) from error
    if out.suffix != ".fmu":
        raise InputError(f"'{out}' is not a name for an FMU", hint="end it in .fmu")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="eha-bench-") as name:
        folder = Path(name)
        script = _write_sources(folder, loaded, package, version)
        built = builder.FmuBuilder.build_FMU(
            script,
            dest=folder / "built",
            project_files=[folder / "model.yaml"],
            needsExecutionTool=True,
            canHandleVariableCommunicationStepSize=True,
        )
        with replacing(out) as part:
            part.write_bytes(Path(built).read_bytes())
    return out


def _write_sources(folder: Path, model: Model, package: str, version: int) -> Path:
    """Write the FMU's script and its model; return the script."""
    words = re.findall(r"[A-Za-z0-9]+", model.plant_id)
    name = "".join(word[:1].upper() + word[1:] for word in words)
    text = _SCRIPT.format(
        version=version,
        package=package,
        name=name if name.isidentifier() else f"Plant{name}",
        done="True" if version == 2 else "pythonfmu3.fmi3slave.Fmi3StepResult()",
        description=f"{model.plant_id} by eha-bench, all values SI",
    )
    script = folder / f"{'_'.join(words).lower()}_slave.py"
    write_text(script, text)
    model.write(folder / "model.yaml", "the model that this FMU was exported from")
    return script


def completed_description(root: Element, units: dict[str, str], version: int) -> Element:
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
