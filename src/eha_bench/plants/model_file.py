"""The keys of model.yaml (contract, section 3)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from eha_bench.core.yaml_file import Real, StrictModel


class ModelFile(StrictModel):
    """model.yaml: a plant, what differs from its defaults, and its declared effects."""

    model: Annotated[str, Field(description="plant: eha_knee, linear_drive, or a plug-in's")]
    parameters: dict[str, Real | str] = Field(
        default_factory=dict,
        description="what differs from the plant's defaults, SI or with a unit",
    )
    calibrate: list[str] = Field(
        default_factory=list, description="parameters that calibration may estimate"
    )
    effects: list[dict[str, Real | str | list[Real]]] = Field(
        default_factory=list, description="declared effects, in the order they were added"
    )
