"""target.yaml of an FMU: which of its variables is which channel, and how it is set up."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel
from eha_bench.targets.sensors import SimulatedSensor

SILENCE: Final = 600.0
"""Time for an FMU to answer, s: large models take minutes to start."""


class VariableFile(StrictModel):
    """A variable of the FMU and the unit of its values."""

    variable: Annotated[str, Field(min_length=1, description="name in the model description")]
    unit: Annotated[
        str | None, Field(description="unit of its values; what the FMU declares by default, or SI")
    ] = None


class PistonVariableFile(StrictModel):
    """The variable that locks the piston, set before the run starts."""

    variable: Annotated[str, Field(min_length=1)]
    locked: float = 1.0
    free: float = 0.0


class BypassVariableFile(StrictModel):
    """The variable that opens the bypass, set before the run starts."""

    variable: Annotated[str, Field(min_length=1)]
    open: float = 1.0
    closed: float = 0.0


class FmuSetupFile(StrictModel):
    """How a trial's setup reaches the FMU."""

    piston: PistonVariableFile | None = None
    bypass: BypassVariableFile | None = None


class FmuFile(StrictModel):
    """A target.yaml for a plant in an FMU (FMI 2 or 3, co-simulation)."""

    target: Literal["fmu"]
    fmu: Annotated[str, Field(description="the .fmu, relative to this file")]
    inputs: Annotated[
        dict[str, VariableFile], Field(description="current_command, and what else is commanded")
    ]
    outputs: Annotated[
        dict[str, VariableFile], Field(min_length=1, description="measured channels")
    ]
    parameters: Annotated[
        dict[str, float | bool | str],
        Field(description="start values by variable: a number as the FMU takes it, or with a unit"),
    ] = Field(default_factory=dict)
    initial: Annotated[
        dict[str, VariableFile],
        Field(description="start variables of channels that a trial may give a start value"),
    ] = Field(default_factory=dict)
    setup: FmuSetupFile = Field(default_factory=FmuSetupFile)
    step: Annotated[
        float | None,
        Unit("s"),
        Field(gt=0, description="largest communication step; a tick by default"),
    ] = None
    answers_within: Annotated[
        float,
        Unit("s"),
        Field(gt=0, description="how long it may take to start or to step; ten minutes by default"),
    ] = SILENCE
    model: Annotated[
        str,
        Field(description="model.yaml with what is known of the plant: geometry, current limit"),
    ] = ""
    controller: Annotated[str, Field(description="controller.yaml, relative to this file")] = ""
    sensors: Annotated[
        dict[str, SimulatedSensor],
        Field(description="noise and resolution by channel; none by default"),
    ] = Field(default_factory=dict)
