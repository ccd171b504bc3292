"""Plants by name: the shipped networks, and the classes that plug-ins register."""

from __future__ import annotations

from functools import cache

from eha_bench.core import plugins
from eha_bench.core.errors import PluginError
from eha_bench.core.near_miss import suggest
from eha_bench.core.plugin_class import check_attributes, check_class
from eha_bench.plants.effect import registered_effects
from eha_bench.plants.network.file import shipped_names, shipped_plant
from eha_bench.plants.plant import Plant
from eha_bench.plants.signals import with_signals


@cache
def get_plant(name: str) -> Plant:
    """Return the plant of that id: a shipped network, or a registered class.

    Raises:
        PluginError: no such plant.
    """
    if name in shipped_names():
        return shipped_plant(name)
    if name not in plugins.names("plants"):
        known = (*shipped_names(), *plugins.names("plants"))
        raise PluginError(f"unknown plant '{name}'", hint=suggest(name, known))
    plant = plugins.load("plants", name)()
    if not isinstance(plant, Plant):
        raise PluginError(f"plant '{name}' is not a Plant but {type(plant).__name__}")
    check_class(type(plant), Plant, f"plant '{name}'")
    check_attributes(plant, Plant, f"plant '{name}'")
    plant = with_signals(plant, registered_effects())
    plant.origin = (get_plant, (name,))
    return plant
