"""Refuses a map of channels whose units are not those that a plant has by these names.

A valve's command that is logged in per cent and taken in volts would be ten times too small, or a
hundred, and a calibration would take that up in a gain: nothing later could tell.
"""

from __future__ import annotations

from pathlib import Path

from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.core.units import factor_and_offset
from eha_bench.plants.plant import Plant


def check_units(channels: Path, plant: Plant) -> None:
    """Refuse a channel whose unit is given and is of another dimension than the plant's.

    Args:
        channels: channels.yaml. plant: that is compared with what is read by it.

    Raises:
        InputError: at the unit, with both, and what turns one into the other.
    """
    # imported here: reading formats pulls in large libraries that a schema check needs not
    from eha_bench.recordings import load_channel_map

    mapped = load_channel_map(channels).channels
    for name, unit in plant.units.items():
        entry = mapped.get(name)
        if entry is None or entry.unit is None or _are_of_one_kind(entry.unit, unit):
            continue
        content = yaml_file.load(channels)
        keys = ("channels", name, "unit")
        raise InputError(
            f"'{name}' is read in '{entry.unit}', and the plant has it in {unit or 'no unit'}",
            where=Place(str(channels), yaml_file.line_of(content, keys), ".".join(keys)),
            hint="give the unit that the plant has, with the scale that turns the logged number "
            "into it: 100 % of 10 V is `scale: 0.1, unit: V`",
        )


def _are_of_one_kind(unit: str, other: str) -> bool:
    try:
        factor_and_offset(unit, other)
    except UnitError:
        return False
    return True
