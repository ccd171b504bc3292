"""Plants from plant.yaml: by path, by what it says, and the shipped ones by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from eha_bench.core.errors import InputError, Place
from eha_bench.core.near_miss import suggest
from eha_bench.core.shipped import names, shipped_file
from eha_bench.plants.effect import registered_effects
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.network.plant_file import NETWORK_KEYS, Locate, parse_network

SHIPPED = "plants"
"""Folder of the shipped plants."""


def plant_of(content: Mapping[str, Any], locate: Locate | None = None) -> NetworkPlant:
    """Return the plant that the content of a plant.yaml describes, compiled on first use.

    Raises:
        InputError: a mistake in it, with file, line and key.
    """
    from eha_bench.core.yaml_file import plain

    own = plain({key: content[key] for key in NETWORK_KEYS if key in content})
    text = json.dumps(own)
    if text not in _KEPT:
        where = locate or _nowhere
        plant = NetworkPlant(parse_network(content, where), registered_effects(), where)
        plant.origin = (plant_of, (own,))
        _KEPT[text] = plant
    return _KEPT[text]


_KEPT: dict[str, NetworkPlant] = {}


def refuse_unknown_keys(content: Mapping[str, Any], locate: Locate) -> None:
    """Refuse what neither a plant nor a model that stands on it has.

    Raises:
        InputError: a key that there is not.
    """
    from eha_bench.plants.model_file import ModelFile

    known = [key for key in ModelFile.model_fields if key != "model"]
    for key in content:
        if key not in known:
            raise InputError(
                f"unknown key '{key}'", where=locate(key), hint=suggest(str(key), known)
            )


def _nowhere(*keys: int | str) -> Place:
    return Place(key=".".join(str(key) for key in keys))


@cache
def shipped_plant(name: str) -> NetworkPlant:
    """Return a shipped plant by its id.

    Raises:
        InputError: none of that name is shipped.
    """
    return load_plant(shipped_file(f"{SHIPPED}/{name}.yaml"))


@cache
def shipped_names() -> tuple[str, ...]:
    """Return the ids of the shipped plants."""
    return names(SHIPPED)


def load_plant(path: Path) -> NetworkPlant:
    """Return the plant of a plant.yaml.

    Raises:
        InputError: a mistake in it, with file, line and key.
    """
    from eha_bench.core import yaml_file

    content = yaml_file.load(path)

    def locate(*keys: int | str) -> Place:
        line = yaml_file.line_of(content, keys)
        return Place(file=str(path), line=line, key=".".join(str(key) for key in keys))

    if isinstance(content, Mapping):
        refuse_unknown_keys(content, locate)
    return plant_of(content, locate)
