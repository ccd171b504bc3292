"""A controller class of a user's own, in a folder of theirs."""

from pathlib import Path

_CLASS = """\
from typing import Annotated

from eha_bench.control.controller import Controller
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import StrictModel


class Own(StrictModel):
    gain: Annotated[float, Unit("A/Pa")]


class Mine(Controller):
    Gains = Own

    def __init__(self, gains, context):
        self.gain = gains.gain

    def step(self, reference, reading):
        return self.gain * (2.0 * reference - reading["pressure_difference"])
"""


def write_own_controller(folder: Path, name: str) -> None:
    """Write the class as `mine.py`, and a controller file of this name that uses it."""
    (folder / "mine.py").write_text(_CLASS, encoding="utf-8")
    (folder / name).write_text(
        "pressure: {controller: 'mine:Mine', gain: 1 A/MPa}\n", encoding="utf-8"
    )
