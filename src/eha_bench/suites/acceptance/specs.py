"""What is known of a metric that a suite names: its own come before the installed ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeAlias

from eha_bench.core import plugins
from eha_bench.core.errors import InputError, Place
from eha_bench.core.metric import MetricSpec, metric_spec
from eha_bench.core.near_miss import likely

Specs: TypeAlias = Mapping[str, MetricSpec]

NONE: Final[Specs] = {}


def spec_named(name: str, own: Specs, where: Place) -> MetricSpec:
    """Return the specification of a metric by its id.

    Raises:
        InputError: neither the suite nor an installed package has it.
        PluginError: a plug-in cannot be loaded, or has no specification.
    """
    if name in own:
        return own[name]
    try:
        return metric_spec(name, where=where)
    except InputError as error:
        near = likely(name, own)
        if near and not likely(name, plugins.names("metrics")):
            raise InputError(error.what, where=where, hint=near) from error
        raise
