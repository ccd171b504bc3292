"""A load or a mass that differs from run to run, and that nobody declares as such."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.errors import PluginError
from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.fit.evidence import excess
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.outcome.differing_runs import (
    DifferingParameters,
    differing_parameters,
)
from eha_bench.plants.elements.mass import KIND as MASS
from eha_bench.plants.model import load_model
from eha_bench.plants.network.element import ElementKind
from eha_bench.plants.plant import Drive
from eha_bench.recordings import write

PLANT = """\
plant: cart
nodes: {rod: {kind: translation, mass: 10 kg}}
elements:
  damper: {kind: friction, on: rod, viscous: 30 N*s/m}
  bolted: {kind: mass, on: rod, mass: 0 kg}
  pull: {kind: load, on: rod, force: 0 N}
names: {load: pull.force, added_mass: bolted.mass}
inputs: {push: pull.force}
channels: {position: rod.position}
calibrate: [rod.mass, damper.viscous]
"""


def calibrated(
    folder: Path,
    loads: list[float],
    masses: list[float],
    declared: str = PLANT,
    drags: tuple[float, ...] = (30.0, 30.0, 30.0),
) -> Baseline:
    """Calibrate on three runs of a cart, of which the plant says that all are alike."""
    (folder / "plant.yaml").write_text(declared, encoding="utf-8")
    plant = load_model(folder / "plant.yaml").plant
    noise = np.random.default_rng(4)
    time = np.arange(0.0, 1.5, 2e-3)
    rows = []
    for number, (load, mass, drag) in enumerate(zip(loads, masses, drags, strict=True)):
        vector = load_model(folder / "plant.yaml").vector()
        for key, value in (("load", load), ("added_mass", mass), ("damper.viscous", drag)):
            vector[plant.layout.index[key]] = value
        push = 8.0 * np.sin(2.0 * np.pi * (1.0 + number) * time)
        out = plant.simulate(vector, Drive(time, {"push": push}, {"position": 0.0}), 1e-3)
        position = out[:, plant.outputs.index("position")] + 1e-5 * noise.standard_normal(time.size)
        write(folder / f"{number}.mcap", Recording(time, {"push": push, "position": position}))
        rows.append(f"  - {{log: {number}.mcap}}\n")
    text = "model: plant.yaml\ninputs: [push]\nruns:\n" + "".join(rows)
    (folder / "dataset.yaml").write_text(text, encoding="utf-8")
    return calibrated_baseline(load_dataset(folder / "dataset.yaml"))


def differing(base: Baseline) -> DifferingParameters | None:
    return differing_parameters(base, excess(base.problem, base.fit))


@pytest.fixture(scope="module")
def of_three_loads(tmp_path_factory: pytest.TempPathFactory) -> Baseline:
    """Calibrated once, on three runs of which each has its own load."""
    return calibrated(tmp_path_factory.mktemp("loads"), [2.0, -3.0, 5.0], [0.0, 0.0, 0.0])


@pytest.mark.slow  # a whole calibration
def test_a_load_that_differs_is_found_with_its_value_in_each_run(of_three_loads: Baseline) -> None:
    found = differing(of_three_loads)
    assert found is not None
    assert found.units == {"load": "N"}
    assert list(found.values["load"].values()) == pytest.approx([2.0, -3.0, 5.0], abs=0.05)
    assert found.share > 0.95
    assert "declare it under `per_run`" in found.note
    assert "-2.999 in 1" in found.note


@pytest.mark.slow  # a whole calibration
def test_parts_of_one_log_do_not_differ(of_three_loads: Baseline) -> None:
    base = of_three_loads
    log = base.measured[0].run.log
    parts = tuple(replace(item, run=replace(item.run, log=log)) for item in base.measured)
    assert differing(replace(base, measured=parts)) is None


@pytest.mark.slow  # two whole calibrations
def test_a_mass_of_no_such_machine_is_not_suggested(tmp_path: Path) -> None:
    heavy = PLANT.replace("mass: 0 kg", "mass: 0.1 kg")
    found = differing(calibrated(tmp_path, [0.0, 0.0, 0.0], [0.1, 6.1, 0.1], heavy))
    assert found is None


@pytest.mark.slow  # a whole calibration
def test_a_mass_that_was_bolted_on_in_one_run_is_found(tmp_path: Path) -> None:
    found = differing(calibrated(tmp_path, [0.0, 0.0, 0.0], [0.0, 6.0, 0.0]))
    assert found is not None
    first, second, third = found.values["added_mass"].values()
    assert second - first == pytest.approx(6.0, abs=0.3)
    assert third == pytest.approx(first, abs=0.3)


@pytest.mark.slow  # a whole calibration
def test_a_mass_that_is_calibrated_may_differ_as_well(tmp_path: Path) -> None:
    declared = PLANT.replace("[rod.mass, damper", "[{parameter: added_mass, within: 3 kg}, damper")
    found = differing(calibrated(tmp_path, [0.0, 0.0, 0.0], [1.0, 1.0, 4.0], declared))
    assert found is not None
    assert [*found.values["added_mass"].values()] == pytest.approx([1.0, 1.0, 4.0], abs=0.3)


@pytest.mark.slow  # a whole calibration
def test_friction_that_falls_from_run_to_run_is_found_with_its_values(tmp_path: Path) -> None:
    drags = (40.0, 30.0, 20.0)
    found = differing(calibrated(tmp_path, [0.0] * 3, [0.0] * 3, drags=drags))
    assert found is not None
    assert [*found.values["damper.viscous"].values()] == pytest.approx(drags, rel=0.02)
    assert "damper.viscous seems to differ from run to run" in found.note


def test_friction_and_leakage_that_differ_are_one_sentence() -> None:
    values = {
        "damper.viscous": {"first": 40.0, "second": 30.0},
        "gap.conductance": {"first": 1e-12, "second": 2e-12},
        "gap.turbulent": {"first": 1.00e-9, "second": 1.01e-9},
    }
    units = {"damper.viscous": "N*s/m", **dict.fromkeys(("gap.conductance", "gap.turbulent"), "SI")}
    note = DifferingParameters(values, units, 0.97).note
    assert note.startswith("friction and leakage seem to differ from run to run, as with oil that")
    assert "damper.viscous, N*s/m: 40 in first, 30 in second; gap.conductance" in note
    assert "gap.turbulent" not in note  # which is the same in both
    assert "97 % of what is missing goes" in note


def test_runs_that_are_alike_do_not_differ(tmp_path: Path) -> None:
    # the same load in all of them is something else that is missing
    assert differing(calibrated(tmp_path, [4.0, 4.0, 4.0], [0.0, 0.0, 0.0])) is None


@pytest.mark.slow(8)
def test_a_diagnosis_notes_it_where_nothing_else_explains_what_is_missing(
    of_three_loads: Baseline,
) -> None:
    found = diagnose(of_three_loads.measured[0].run.log.with_name("dataset.yaml"))
    assert found.verdict is Verdict.UNKNOWN
    assert any(note.startswith("load seems to differ from run to run") for note in found.notes)


def test_an_element_cannot_change_what_it_does_not_have() -> None:
    with pytest.raises(PluginError, match="changes 'mess', which is no parameter"):
        ElementKind("heap", "", MASS.ports, MASS.parameters, MASS.anatomy,
                    changed_between_runs=("mess",))  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "share", "whole"),
    [(["arm.inertia"], 0.85, True), (["arm.inertia"], 0.7, False), (["a", "b"], 0.99, False)],
)
def test_one_value_that_leaves_nothing_is_all_of_it(
    keys: list[str], share: float, whole: bool
) -> None:
    """Frictions and leaks of each run are so many that they take nearly anything."""
    values = {key: {"one": 1.0, "two": 2.0} for key in keys}
    assert DifferingParameters(values, dict.fromkeys(keys, ""), share).is_all_of_it is whole
