"""A learned curve that is a line says its slope: an element of the plant file is missing."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.unknown.curves import LocatedCurve
from eha_bench.diagnosis.unknown.places import Template
from eha_bench.diagnosis.unknown.straight import straight_line, straight_line_notes
from eha_bench.recordings import write

CART = """\
plant: cart
nodes: {rod: {kind: translation, mass: 10 kg}}
elements:
  damper: {kind: friction, on: rod, viscous: 30 N*s/m}
  pull: {kind: load, on: rod, force: 0 N}
names: {load: pull.force}
inputs: {push: pull.force}
channels: {position: rod.position}
calibrate: [{parameter: rod.mass, within: 20 %}, {parameter: damper.viscous, within: 30 %}]
"""
MASS, DAMPING, STIFFNESS = 10.7, 27.0, 450.0
NAMES = ("low", "high", "scale")


def noted(
    values: np.ndarray, *, equation: str = "force", form: str = "additive", period: float = 0.0,
    unit: str = "m",
) -> str:  # fmt: skip
    """What is said of a curve of a position from -1 to 1 m, doubled."""
    keys = [*(f"learned.{name}" for name in NAMES), "learned.values"]
    layout = SimpleNamespace(
        index={key: k for k, key in enumerate(keys)},
        by_key={"learned.values": SimpleNamespace(size=values.size)},
    )
    plant: Any = SimpleNamespace(layout=layout, units={"position": unit})
    vector = np.concatenate([[-1.0, 1.0, 2.0], values])
    template = Template(equation, form, "rod", "position")
    best = LocatedCurve(template, 0.9, np.zeros(2), np.zeros(2), period)
    return straight_line(best, plant, vector)


KNOTS = np.linspace(-1.0, 1.0, 24)


def test_a_line_says_its_slope_in_the_units_of_its_balance() -> None:
    said = noted(3.0 - 40.0 * KNOTS + 0.5 * np.cos(30.0 * KNOTS))
    assert re.fullmatch("a straight line: -(79|80).* N for each m of position", said)
    (note,) = straight_line_notes(said)
    assert note.startswith(f"the learned curve is {said}: an element that grows in proportion")
    assert " N*m for each m" in noted(KNOTS, equation="torque")
    assert " m^3/s for each m" in noted(KNOTS, equation="flow")


@pytest.mark.parametrize(
    "said",
    [
        pytest.param(noted(KNOTS**3), id="cube"),
        pytest.param(noted(np.abs(KNOTS) * KNOTS), id="square"),
        pytest.param(noted(np.sign(KNOTS)), id="step"),
        pytest.param(noted(np.zeros(24)), id="nothing"),
        pytest.param(noted(KNOTS, form="gain"), id="gain"),
        pytest.param(noted(KNOTS, period=2.0), id="periodic"),
        pytest.param(noted(KNOTS, equation="measurement"), id="sensor"),
        pytest.param(noted(KNOTS, unit="s"), id="time"),
    ],
)
def test_what_is_no_line_of_a_balance_says_nothing(said: str) -> None:
    assert said == ""
    assert straight_line_notes(said) == []


def pushed(seed: int, frequencies: tuple[float, float]) -> Recording:
    """A cart on a spring that its plant file lacks, by SciPy's integrator; a load pulls back."""
    time = np.arange(0.0, 2.0, 2e-3)
    push = sum(40.0 * np.sin(2.0 * np.pi * f * time) for f in frequencies)

    def rates(t: float, y: np.ndarray) -> list[float]:
        force = push[min(int(t / 2e-3 + 1e-9), push.size - 1)]
        return [y[1], (force - DAMPING * y[1] - STIFFNESS * y[0]) / MASS]

    found = solve_ivp(rates, (0.0, time[-1]), [0.0, 0.0], t_eval=time, max_step=2e-3, rtol=1e-8)
    noise = 2e-5 * np.random.default_rng(seed).standard_normal(time.size)
    return Recording(time, {"push": -push, "position": found.y[0] + noise})


@pytest.mark.slow(6)
def test_a_spring_that_nobody_declared_is_a_line_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(CART, encoding="utf-8")
    frequencies = [(0.7, 1.9), (1.3, 2.6), (0.5, 1.1), (0.9, 2.2)]
    for number, own in enumerate(frequencies):
        write(tmp_path / f"run{number}.mcap", pushed(number, own))
    uses = ("train", "train", "holdout", "unseen")
    runs = "".join(f"  - {{log: run{k}.mcap, use: {use}}}\n" for k, use in enumerate(uses))
    (tmp_path / "dataset.yaml").write_text(
        f"model: plant.yaml\ninputs: [push]\nruns:\n{runs}", encoding="utf-8"
    )
    found = diagnose(tmp_path / "dataset.yaml")
    assert found.verdict is Verdict.UNKNOWN
    assert found.unknown is not None
    assert (found.unknown.equation, found.unknown.variables) == ("force", ("position",))
    (slope,) = map(float, re.findall(r"line: (\S+) N", found.unknown.shape))
    assert slope == pytest.approx(-STIFFNESS, rel=0.05)
    assert any(note.startswith("without the learned curve the mean") for note in found.notes)
    assert not any("seem" in note and "differ from run to run" in note for note in found.notes)
