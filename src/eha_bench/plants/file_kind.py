"""model.yaml and plant.yaml as kinds of file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.file_kind import FileKind

if TYPE_CHECKING:
    from eha_bench.plants.model import Model


def _model(path: Path) -> Model:
    from eha_bench.plants.model import load_model

    return load_model(path)


def _check(path: Path) -> Model:
    from eha_bench.plants.model import load_model
    from eha_bench.plants.network.plant import NetworkPlant

    model = load_model(path)
    if isinstance(model.plant, NetworkPlant):
        model.plant.check()
    return model


def _remarks(model: Model) -> list[str]:
    from eha_bench.plants.remarks import remarks

    return remarks(model)


def _schema() -> dict[str, Any]:
    from eha_bench.plants.model_file import ModelFile

    return ModelFile.model_json_schema()


def _plant_schema() -> dict[str, Any]:
    from eha_bench.plants.network.schema import plant_schema

    return plant_schema(_schema())


_USE = "eha-bench run SUITE --target FILE, or a line 'model: FILE'"

KIND = FileKind("model", frozenset({"model"}), 1, _check, _schema, _remarks, model=_model, use=_USE)
PLANT = FileKind(
    "plant",
    frozenset({"nodes", "elements"}),
    9,
    _check,
    _plant_schema,
    _remarks,
    model=_model,
    use=_USE,
)
