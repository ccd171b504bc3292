"""The keys of model.yaml (contract, section 3)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from eha_bench.core.yaml_file import Real, StrictModel


class CalibrateEntry(StrictModel):
    """A parameter that calibration may estimate, with how well its value is believed."""

    parameter: Annotated[str, Field(min_length=1)]
    within: Annotated[
        Real | str | None,
        Field(description="what the true value may be off by: 10 % of it, or an amount"),
    ] = None


def _at_one_place(effect: Any) -> Any:
    if isinstance(effect, dict) and isinstance(effect.get("at"), list):
        raise ValueError("`at` names one place, or all of its kind by the word 'all'")
    return effect


class ModelFile(StrictModel):
    """model.yaml: a plant, what differs from its defaults, and its declared effects.

    The plant is named under `model`, or declared as a network right here (plant.yaml).
    """

    model: Annotated[
        str, Field(description="a shipped plant, a plug-in's, or the path of a plant.yaml")
    ] = ""
    plant: Annotated[str, Field(description="name of the plant that is declared here")] = ""
    nodes: dict[str, Any] | None = Field(
        default=None, description="what holds state: rotation, translation, volume, reservoir"
    )
    elements: dict[str, Any] | None = Field(default=None, description="what joins nodes")
    inputs: dict[str, Any] | None = Field(
        default=None, description="channel: element.port that it drives"
    )
    channels: dict[str, Any] | None = Field(
        default=None, description="channel: node.quantity, or element.quantity"
    )
    names: dict[str, Any] | None = Field(
        default=None, description="a name for one parameter, or for several of one value"
    )
    assumed: dict[str, Any] | None = Field(
        default=None, description="parameters whose value is a guess: why it is this one"
    )
    parameters: dict[str, Real | str] = Field(
        default_factory=dict,
        description="what differs from the plant's defaults, SI or with a unit",
    )
    calibrate: list[str | CalibrateEntry] = Field(
        default_factory=list,
        description="parameters that calibration may estimate, also effect.parameter of a "
        "declared effect; stands for the whole list of the model or plant below, where there is "
        "one",
    )
    per_run: list[str] = Field(
        default_factory=list,
        description="unmeasured parameters that differ from run to run; stands for the whole list "
        "of the model or plant below, where there is one",
    )
    effects: list[Annotated[dict[str, Real | str | list[Real]], BeforeValidator(_at_one_place)]] = (
        Field(default_factory=list, description="declared effects, in the order they were added")
    )

    @model_validator(mode="after")
    def _one_plant(self) -> ModelFile:
        if bool(self.model) == bool(self.plant):
            raise ValueError(
                "name a plant under `model`, or declare one under `plant`, with nodes and elements"
            )
        return self
