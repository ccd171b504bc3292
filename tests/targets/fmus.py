"""FMUs built while the tests run, of FMI 2 and FMI 3, with a plant that has a known answer."""

import importlib
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

SCRIPT = '''
import math
import os
import signal
import time

from @package@ import *
@more@


class Line(Fmi@v@Slave):
    """p follows gain * i_cmd with one time constant, exactly integrated."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.i_cmd = self.x_start = self.x = self.p = self.speed = 0.0
        self.gain, self.tau = 1.0, 0.02
        self.fails_at = self.broken_from = self.crashes_at = 1e9
        self.raises_at = self.hangs_at = 1e9
        self.locked = False
        self.steps = 0
        parameter = Fmi@v@Causality.parameter
        tunable = Fmi@v@Variability.tunable
        for name in ("gain", "tau", "fails_at", "broken_from", "crashes_at",
                     "raises_at", "hangs_at", "x_start"):
            self.register_variable(@Real@(name, causality=parameter, variability=tunable))
        self.register_variable(Boolean("locked", causality=parameter, variability=tunable))
        self.register_variable(@Real@("i_cmd", causality=Fmi@v@Causality.input))
        for name in ("p", "speed", "x"):
            self.register_variable(@Real@(name, causality=Fmi@v@Causality.output))
        self.register_variable(@Integer@("steps", causality=Fmi@v@Causality.output))

    def to_xml(self, *args, **kwargs):
        root = super().to_xml(*args, **kwargs)
        units = Element("UnitDefinitions")
        for name, base in UNITS.items():
            SubElement(SubElement(units, "Unit", name=name), "BaseUnit", **base)
        root.insert([child.tag for child in root].index("CoSimulation") + 1, units)
        for variable in root.find("ModelVariables"):
            if variable.get("name") in DECLARED:
                place = variable.find("Real") if @v@ == 2 else variable
                place.set("unit", DECLARED[variable.get("name")])
        return root

    def exit_initialization_mode(self):
        self.x = self.x_start

    def do_step(self, current_time, step_size):
        if current_time >= self.fails_at - 1e-9:
            self.log("the line has burst", Fmi@v@Status.error)
            return @failed@
        if current_time >= self.crashes_at - 1e-9:
            os.kill(os.getpid(), signal.SIGSEGV)
        if current_time >= self.raises_at - 1e-9:
            raise RuntimeError("the pump has seized")
        if current_time >= self.hangs_at - 1e-9:
            time.sleep(60.0)
        share = math.exp(-step_size / self.tau)
        self.p = share * self.p + (1.0 - share) * self.gain * self.i_cmd
        self.speed = 0.0 if self.locked else 60.0 * self.i_cmd
        self.steps += 1
        if current_time >= self.broken_from - 1e-9:
            self.p = math.nan
        return @done@


from xml.etree.ElementTree import Element, SubElement

UNITS = {
    "mm": {"m": "1", "factor": "0.001"},
    "bar": {"kg": "1", "m": "-1", "s": "-2", "factor": "100000.0"},
    "rev/min": {"s": "-1", "rad": "1", "factor": "0.10471975511965977"},
}
DECLARED = {"p": "bar", "x": "mm", "x_start": "mm", "speed": "rev/min", "i_cmd": "A", "tau": "s"}
'''

BY_VERSION = {
    2: {
        "package": "pythonfmu", "Real": "Real", "Integer": "Integer",
        "more": "from pythonfmu.enums import Fmi2Status, Fmi2Variability",
        "failed": "False", "done": "True",
    },
    3: {
        "package": "pythonfmu3", "Real": "Float64", "Integer": "Int32",
        "more": "from pythonfmu3.fmi3slave import Fmi3StepResult\n"
                "from pythonfmu3.enums import Fmi3Status, Fmi3Variability",
        "failed": "Fmi3StepResult(status=Fmi3Status.error)", "done": "Fmi3StepResult()",
    },
}  # fmt: skip


def build_line(version: int, folder: Path, **options: bool) -> Path:
    """Write line.fmu of an FMI version into a folder; `options` are FMI's capability flags."""
    text = SCRIPT.replace("@v@", str(version))
    for name, value in BY_VERSION[version].items():
        text = text.replace(f"@{name}@", value)
    script = folder / f"line_slave_{version}.py"
    script.write_text(text)
    builder = importlib.import_module(f"pythonfmu{'3' if version == 3 else ''}.builder")
    built = builder.FmuBuilder.build_FMU(script, dest=folder, **options)
    return built.rename(folder / f"line{version}.fmu")


def rewritten(fmu: Path, change: Callable[[str, bytes], tuple[str, bytes]]) -> None:
    """Change names or contents of what an FMU holds."""
    part = fmu.with_suffix(".part")
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(part, "w") as new:
        for name in old.namelist():
            new.writestr(*change(name, old.read(name)))
    shutil.move(part, fmu)
